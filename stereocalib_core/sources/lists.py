"""Lists that go with the pictures (times, poses, extrinsics): used as far as they go, and said so.

None of them is needed for a drive: one that cannot be read is a note, never an end.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.config.reading import UNSTATED_FPS
from stereocalib_core.errors import SourceError
from stereocalib_core.frames import GroundTruth
from stereocalib_core.geometry import invert_transform
from stereocalib_core.sources.times import Times, read_times
from stereocalib_core.sources.truth import at_frames, forward_axes, read_poses
from stereocalib_core.system.tables import read_table
from stereocalib_core.system.text_file import lines

NO_POSES = "no ground-truth poses: errors are not computed"


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


def times_or_note(path: Path | None) -> Times | None:
    """The times of a file; where it cannot be read none, and the reason as its note."""
    try:
        return None if path is None else read_times(path)
    except SourceError as error:
        name = "" if path is None else path.name
        return Times(np.zeros(0), (f"{name} is not used: {error.what}, {_short(error)}",))


def frame_times(
    times: Times | None, rows: Sequence[int], fps: float, name: str
) -> tuple[NDArray[np.float64], float, list[str]]:
    """(N,) seconds per frame since an epoch, that epoch, and what had to be assumed.

    Without a list, or with one that does not increase, frames come at `fps`; a list that ends early goes
    on with its own median step, a row without a time lies halfway between its neighbours.
    """
    count = len(rows)
    uniform = np.arange(count) / fps
    notes = [] if times is None else list(times.notes)
    if times is None or len(times.seconds) == 0:
        return uniform, 0.0, [*notes, f"no {name}: {fps:g} frames a second assumed"]
    picked = pick_rows(times.seconds, rows)
    known = np.nonzero(np.isfinite(picked))[0]
    if len(known) < 1 or np.any(np.diff(picked[known]) <= 0):
        return uniform, 0.0, [*notes, f"{name} does not increase: {fps:g} frames a second assumed"]
    first, end = int(known[0]), int(known[-1]) + 1
    step = float(np.median(np.diff(picked[known]) / np.diff(known))) if len(known) > 1 else 1.0 / fps
    empty = [i for i in range(end) if not np.isfinite(picked[i])]
    if empty:
        picked[first:end] = np.interp(np.arange(first, end), known, picked[known])
        picked[:first] = picked[first] - step * np.arange(first, 0, -1)
        notes.append(
            f"{name} has no time for {len(empty)} frames ({empty[0]} ...): taken between their neighbours'"
        )
    if end < count:
        picked[end:] = picked[end - 1] + step * np.arange(1, count - end + 1)
        notes.append(f"{name} ends after {end} of {count} frames: continued in steps of {step:.4g} s")
    return picked, times.epoch_s, notes


def from_first(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 4, 4) poses re-expressed in the first frame that has one; frames without one become all NaN."""
    known = np.isfinite(poses).all(axis=(1, 2))
    out = np.full_like(poses, np.nan)
    if known.any():
        first = poses[int(np.argmax(known))]
        out[known] = invert_transform(first) @ poses[known]
    return out


def read_ground_truth(
    poses_file: Path | None,
    extrinsics_file: Path | None,
    rows: Sequence[int],
    times_s: NDArray[np.float64] | None = None,
    T_body_camera: NDArray[np.float64] | None = None,
) -> tuple[GroundTruth | None, list[str]]:
    """The truth from a list of poses and from extrinsics (frame, m, deg, deg, deg), as far as given.

    times_s: (N,) of the frames, for lists that go by time. T_body_camera: (4, 4) where the poses are of another
    body than the left camera.
    """
    poses = extrinsics = None
    notices: list[str] = []
    if poses_file is not None and poses_file.is_file():
        try:
            poses, said = _poses(poses_file, rows, times_s, T_body_camera)
            notices += said
        except SourceError as error:
            notices.append(f"ground truth {poses_file.name} is not used: {error.what}, {_short(error)}")
    else:
        notices.append(NO_POSES)
    if extrinsics_file is not None and extrinsics_file.is_file():
        try:
            extrinsics = pick_rows(_read_extrinsics(extrinsics_file), rows)
        except SourceError as error:
            notices.append(f"{extrinsics_file.name} is not used: {error.what}, {_short(error)}")
    if poses is None and extrinsics is None:
        return None, notices
    return GroundTruth(poses, extrinsics), notices


def _short(error: SourceError) -> str:
    where, _, line = error.where.partition(", line ")
    return f"line {line}: {error.remedy}" if line else error.remedy


def _poses(
    path: Path,
    rows: Sequence[int],
    times_s: NDArray[np.float64] | None,
    T_body_camera: NDArray[np.float64] | None,
) -> tuple[NDArray[np.float64] | None, list[str]]:
    given = read_poses(path)
    times = np.arange(len(rows)) / UNSTATED_FPS if times_s is None else times_s
    poses, notices = at_frames(given, times, rows)
    if T_body_camera is not None:
        poses = poses @ T_body_camera
    elif given.stamps_s is not None and (R := forward_axes(poses)) is not None:
        poses = poses.copy()
        poses[:, :3, :3] = poses[:, :3, :3] @ R
        notices.append(f"poses of {path.name} travel along their x: taken as a vehicle's, x ahead and z up")
    known = int(np.isfinite(poses).all(axis=(1, 2)).sum())
    if known < len(rows):
        notices.append(f"ground truth {path.name} has poses for {known} of {len(rows)} frames")
    return from_first(poses) if known else None, notices


def _read_extrinsics(path: Path) -> NDArray[np.float64]:
    header = next(lines(path, 1 << 30, "extrinsics"), "")
    skip = 1 if header.lstrip().lower().startswith("frame") else 0
    table = read_table(path, 5, "extrinsics", skip)[:, 1:]
    return np.column_stack([table[:, 0], np.deg2rad(table[:, 1:])])
