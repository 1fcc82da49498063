"""Lists that go with the pictures (times, poses, extrinsics): used as far as they go, and said so."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.frames import GroundTruth
from stereocalib_core.geometry import invert_transform
from stereocalib_core.system.tables import read_table

KITTI_FPS = 10.0


def pick_rows(table: NDArray[np.float64], rows: Sequence[int]) -> NDArray[np.float64]:
    """The line of `table` (M, ...) for every frame, (N, ...); NaN where the list ends before it.

    `rows` counts from the recording's own first number; a list of exactly one line per frame is taken as
    cut together with the pictures.
    """
    wanted = np.asarray(rows)
    if wanted[0] > 0 and len(table) == len(wanted):
        wanted = wanted - wanted[0]
    out = np.full((len(wanted), *table.shape[1:]), np.nan)
    inside = wanted < len(table)
    out[inside] = table[wanted[inside]]
    return out


def frame_times(
    times_s: NDArray[np.float64] | None, rows: Sequence[int], fps: float, name: str
) -> tuple[NDArray[np.float64], list[str]]:
    """(N,) seconds per frame, and what had to be assumed.

    Without a list, or with one that does not increase, frames come at `fps`; a list that ends early goes
    on with its own median step.
    """
    count = len(rows)
    uniform = np.arange(count) / fps
    if times_s is None or len(times_s) == 0:
        return uniform, [f"no {name}: {fps:g} frames a second assumed"]
    picked = pick_rows(times_s, rows)
    known = int(np.isfinite(picked).sum())
    if known < 1 or np.any(np.diff(picked[:known]) <= 0):
        return uniform, [f"{name} does not increase: {fps:g} frames a second assumed"]
    if known == count:
        return picked, []
    step = float(np.median(np.diff(picked[:known]))) if known > 1 else 1.0 / fps
    picked[known:] = picked[known - 1] + step * np.arange(1, count - known + 1)
    return picked, [f"{name} ends after {known} of {count} frames: continued in steps of {step:.4g} s"]


def read_times(path: Path) -> NDArray[np.float64] | None:
    """A list of seconds, None where there is no such file."""
    return read_table(path, 1, "time")[:, 0] if path.is_file() else None


def poses_from_rows(rows_12: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 12) KITTI rows to (N, 4, 4) poses in the first frame's own axes; NaN rows stay NaN."""
    poses = np.full((len(rows_12), 4, 4), np.nan)
    poses[:, :3, :] = rows_12.reshape(-1, 3, 4)
    poses[:, 3, :] = [0.0, 0.0, 0.0, 1.0]
    return from_first(poses)


def from_first(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 4, 4) poses re-expressed in the first frame that has one; frames without one become all NaN."""
    known = np.isfinite(poses).all(axis=(1, 2))
    out = np.full_like(poses, np.nan)
    if known.any():
        first = poses[int(np.argmax(known))]
        out[known] = invert_transform(first) @ poses[known]
    return out


def read_ground_truth(
    poses_file: Path | None, extrinsics_file: Path | None, rows: Sequence[int]
) -> tuple[GroundTruth | None, list[str]]:
    """The truth from KITTI poses and from extrinsics (frame, m, deg, deg, deg), as far as given."""
    poses = extrinsics = None
    notices: list[str] = []
    if poses_file is not None and poses_file.is_file():
        table = read_table(poses_file, 12, "pose")
        poses = poses_from_rows(pick_rows(table, rows))
        known = int(np.isfinite(poses).all(axis=(1, 2)).sum())
        if known == 0:
            poses = None
        if known < len(rows):
            notices.append(f"ground truth {poses_file.name} has poses for {known} of {len(rows)} frames")
    else:
        notices.append("no ground-truth poses: errors are not computed")
    if extrinsics_file is not None and extrinsics_file.is_file():
        extrinsics = pick_rows(_read_extrinsics(extrinsics_file), rows)
    if poses is None and extrinsics is None:
        return None, notices
    return GroundTruth(poses, extrinsics), notices


def _read_extrinsics(path: Path) -> NDArray[np.float64]:
    header = path.read_text(encoding="ascii", errors="replace").splitlines()[:1]
    skip = 1 if header and header[0].lstrip().lower().startswith("frame") else 0
    table = read_table(path, 5, "extrinsics", skip)[:, 1:]
    return np.column_stack([table[:, 0], np.deg2rad(table[:, 1:])])
