"""True poses in the forms that people keep: KITTI (12 or 16 numbers, with a frame number or without), TUM, EuRoC."""

from __future__ import annotations

import re
from array import array
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.config.reading import (
    EPOCHS,
    LARGEST_FRAME_NUMBER,
    LONGEST_BRIDGE,
    MOST_BYTES_OF_A_TABLE,
    MOST_ROWS,
    SAME_MOMENT,
)
from stereocalib_core.errors import SourceError
from stereocalib_core.geometry import Array
from stereocalib_core.system.tables import split_words
from stereocalib_core.system.text_file import lines


@dataclass(frozen=True)
class Poses:
    """T_world_body (N, 4, 4), NaN = unknown; `stamps_s` (N,) or `frames` (N,) say whose they are, else their row."""

    poses: Array
    stamps_s: Array | None = None
    frames: NDArray[np.int64] | None = None


def read_poses(path: Path) -> Poses:
    """A list of poses, recognised by its columns; raises SourceError in one line, which names the bad line."""
    rows = array("d")
    width = 0
    header = ""
    stamps: list[int | float] = []
    for number, line in enumerate(lines(path, MOST_BYTES_OF_A_TABLE, "pose"), start=1):
        text = line.strip()
        if not text or text.startswith(("#", "%", "//")):
            header = header or text
            continue
        words = split_words(text)
        values = _numbers(words)
        if values is None and not rows:
            header = text
            continue
        if values is None or (width and len(values) != width):
            expected = f"expected {width or 12} numbers"
            raise SourceError("bad pose", f"{path}, line {number}", expected)
        if not width:
            width = len(values)
            if width not in (8, 12, 13, 16, 17) and not 8 < width <= 20:
                raise SourceError("bad pose", f"{path}, line {number}", "expected 12 numbers, or 8 as in TUM")
        if len(stamps) >= MOST_ROWS:
            raise SourceError("poses too many", path, f"at most {MOST_ROWS} are read")
        stamps.append(int(words[0]) if re.fullmatch(r"\d{10,20}", words[0]) else values[0])
        rows.extend(values)
    if not width:
        raise SourceError("no pose", path, "the file is empty")
    table = np.array(rows, dtype=np.float64).reshape(-1, width)
    if width == 12:
        return Poses(_matrices(table))
    if width == 16:
        return Poses(_matrices(table[:, :12]))
    numbered = np.all(np.isfinite(table[:, 0])) and np.all(table[:, 0] == np.floor(table[:, 0]))
    if width in (13, 17) and numbered and table[:, 0].max() < LARGEST_FRAME_NUMBER:
        return Poses(_matrices(table[:, 1:13]), frames=table[:, 0].astype(np.int64))
    w_first = _w_first(header, width, path)
    stamps_s = np.array([stamp / _per_second(stamps[0]) for stamp in stamps], dtype=np.float64)
    return Poses(from_quaternions(table[:, 1:4], table[:, 4:8], w_first), stamps_s)


def _numbers(words: Sequence[str]) -> list[float] | None:
    """Words to numbers, NaN allowed; None where one is none."""
    try:
        return [float(word.replace(",", ".")) for word in words]
    except ValueError:
        return None


def _w_first(header: str, width: int, path: Path) -> bool:
    """Whether a quaternion begins with w: EuRoC's do, TUM's end with it."""
    text = header.lower()
    w = min((p for p in (text.find(k) for k in ("q_w", "qw", "q_rs_w")) if p >= 0), default=-1)
    x = min((p for p in (text.find(k) for k in ("q_x", "qx", "q_rs_x")) if p >= 0), default=-1)
    if w >= 0 and x >= 0:
        return w < x
    return width > 8 or path.suffix.lower() == ".csv"


def _per_second(first: float) -> int:
    return next((unit for unit, (low, high) in EPOCHS.items() if low <= abs(first) <= high), 1)


def _matrices(rows_12: Array) -> Array:
    """(N, 12) to (N, 4, 4); a row that holds anything not finite becomes NaN, as does one that is no rotation."""
    poses = np.full((len(rows_12), 4, 4), np.nan)
    with np.errstate(all="ignore"):
        good = np.isfinite(rows_12).all(axis=1) & (np.abs(rows_12) < 1e9).all(axis=1)
    poses[good, :3, :] = rows_12[good].reshape(-1, 3, 4)
    poses[good, 3, :] = [0.0, 0.0, 0.0, 1.0]
    return poses


def from_quaternions(positions: Array, quaternions: Array, w_first: bool) -> Array:
    """(N, 3) [m] and (N, 4), x y z w or w x y z, to (N, 4, 4)."""
    x, y, z, w = (quaternions[:, [1, 2, 3, 0]] if w_first else quaternions).T
    norm = np.sqrt(x * x + y * y + z * z + w * w)
    with np.errstate(all="ignore"):
        x, y, z, w = x / norm, y / norm, z / norm, w / norm
        good = (norm > 0.5) & (norm < 2.0) & np.isfinite(positions).all(axis=1)
    poses = np.full((len(positions), 4, 4), np.nan)
    R = np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)], -1),
            np.stack([2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)], -1),
            np.stack([2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)], -1),
        ],
        -2,
    )
    poses[good, :3, :3] = R[good]
    poses[good, :3, 3] = positions[good]
    poses[good, 3] = [0.0, 0.0, 0.0, 1.0]
    return poses


def at_frames(
    given: Poses, times_s: Array, rows: Sequence[int], numbers: Sequence[int] | None = None
) -> tuple[Array, list[str]]:
    """(N, 4, 4) the pose of every frame, NaN where there is none, and what had to be assumed.

    rows: the line of each frame in lists. numbers: the frames' own numbers, for lists that state them.
    """
    if given.frames is not None:
        lines_of = {int(frame): line for line, frame in enumerate(given.frames)}
        wanted = [lines_of.get(int(number), -1) for number in (rows if numbers is None else numbers)]
        return _picked(given.poses, wanted), []
    if given.stamps_s is None:
        wanted_rows = np.asarray(rows)
        if wanted_rows[0] > 0 and len(given.poses) == len(wanted_rows):
            wanted_rows = wanted_rows - wanted_rows[0]
        return _picked(given.poses, [int(row) if row < len(given.poses) else -1 for row in wanted_rows]), []
    stamps = given.stamps_s
    if stamps.max() < times_s[0] or stamps.min() > times_s[-1]:
        if len(stamps) == len(times_s):
            return given.poses, ["the truth's times are of another clock: taken row by row"]
        return np.full((len(times_s), 4, 4), np.nan), ["the truth has no time in common with the pictures"]
    return interpolated(given.poses, stamps, times_s), []


def _picked(poses: Array, wanted: Sequence[int]) -> Array:
    index = np.asarray(wanted)
    out = np.full((len(index), 4, 4), np.nan)
    out[index >= 0] = poses[index[index >= 0]]
    return out


def interpolated(poses: Array, stamps_s: Array, times_s: Array) -> Array:
    """(N, 4, 4) poses at `times_s`; NaN outside the list and across its gaps."""
    good = np.isfinite(stamps_s) & np.isfinite(poses).all(axis=(1, 2))
    order = np.argsort(stamps_s[good], kind="stable")
    poses, stamps = poses[good][order], stamps_s[good][order]
    out = np.full((len(times_s), 4, 4), np.nan)
    if len(stamps) == 0:
        return out
    step = float(np.median(np.diff(stamps))) if len(stamps) > 1 else 0.0
    period = float(np.median(np.diff(times_s))) if len(times_s) > 1 else step
    after = np.clip(np.searchsorted(stamps, times_s), 1, max(len(stamps) - 1, 1))
    for i, time_s in enumerate(times_s):
        nearest = min(
            (max(after[i] - 1, 0), min(after[i], len(stamps) - 1)), key=lambda j: abs(stamps[j] - time_s)
        )
        if abs(stamps[nearest] - time_s) <= SAME_MOMENT * period:
            out[i] = poses[nearest]
            continue
        if len(stamps) < 2:
            continue
        a, b = int(after[i]) - 1, int(after[i])
        gap = stamps[b] - stamps[a]
        if stamps[a] <= time_s <= stamps[b] and 0 < gap <= LONGEST_BRIDGE * step:
            out[i] = between(poses[a], poses[b], (time_s - stamps[a]) / gap)
    return out


def between(T_a: Array, T_b: Array, share: float) -> Array:
    """The pose a share of the way from one to another: straight in position, even in rotation."""
    import cv2

    turn, _ = cv2.Rodrigues(T_a[:3, :3].T @ T_b[:3, :3])
    out = np.eye(4)
    out[:3, :3] = T_a[:3, :3] @ cv2.Rodrigues(turn * share)[0]
    out[:3, 3] = T_a[:3, 3] + share * (T_b[:3, 3] - T_a[:3, 3])
    return out


def forward_axes(poses: Array) -> Array | None:
    """(3, 3) R_body_camera for bodies that are not a camera, from how they travel; None where they travel along z.

    A car drives ahead: poses whose motion lies along their own x, as in ROS (x ahead, y left, z up), are turned
    into a camera's axes (x right, y down, z ahead).
    """
    good = poses[np.isfinite(poses).all(axis=(1, 2))]
    if len(good) < 2:
        return None
    steps = np.einsum("nji,nj->ni", good[:-1, :3, :3], np.diff(good[:, :3, 3], axis=0))
    mean = steps.sum(axis=0)
    if np.linalg.norm(mean) < 0.5 or abs(mean[2]) >= abs(mean[0]):
        return None
    return np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
