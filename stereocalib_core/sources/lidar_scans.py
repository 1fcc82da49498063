"""LiDAR scans of a recording, one file a frame, matched to the frames by their number."""

from __future__ import annotations

import dataclasses
import os
import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.config.reading import FARTHEST_M, LOOKED_AT, MOST_BYTES_OF_A_SCAN, MOST_RINGS
from stereocalib_core.errors import SourceError
from stereocalib_core.frames import StereoFrame

OTHER_SUFFIXES = (".pcd", ".npy", ".ply")


def scans_by_number(folder: Path) -> dict[int, Path]:
    """The numbered `.bin`, `.pcd`, `.npy` or `.ply` files of a folder; empty where there are none."""
    try:
        names = sorted(os.listdir(folder))
    except OSError:
        return {}
    found: dict[int, Path] = {}
    for suffix in (".bin", *OTHER_SUFFIXES):
        for name in names:
            number = re.fullmatch(r"\D*(\d{1,12})(?:\.pcd)?", name.removesuffix(suffix))
            if name.endswith(suffix) and number is not None:
                found.setdefault(int(number.group(1)), folder / name)
        if found:
            break
    return found


def read_scan(path: Path) -> NDArray[np.float32] | None:
    """(N, 4) float32 x y z [m] and intensity, finite points only; None for a damaged file."""
    try:
        size = path.stat().st_size
        if size == 0 or size > MOST_BYTES_OF_A_SCAN:
            return None
        if path.suffix.lower() != ".bin":
            from stereocalib_core.boards.cloud_files import (
                read_cloud,
            )  # with all of its room: most drives have none

            points = read_cloud(path).astype(np.float32)
            points = np.column_stack([points, np.zeros(len(points), np.float32)])
        else:
            if size % 4:
                return None
            numbers = np.fromfile(path, dtype="<f4")
            columns = _columns(numbers)
            if columns is None:
                return None
            points = np.ascontiguousarray(numbers.reshape(-1, columns)[:, :4])
    except (OSError, SourceError):
        return None
    return points[np.isfinite(points).all(axis=1)]


def _columns(numbers: NDArray[np.float32]) -> int | None:
    """Numbers a point: four, or five with the beam's number at the end; None where neither fits."""
    if len(numbers) % 5 == 0 and len(numbers):
        rings = numbers[4::5]
        whole = bool(
            np.all(np.isfinite(rings))
            and np.all((rings >= 0) & (rings < MOST_RINGS) & (rings == np.floor(rings)))
        )
        several = len(numbers) % 4 != 0 or (
            rings.min() != rings.max() and np.any(numbers != np.floor(numbers))
        )
        if whole and several:
            return 5
    return 4 if len(numbers) % 4 == 0 else None


def with_scan(
    load: Callable[[int], StereoFrame],
    scans: dict[int, Path],
    rows: Sequence[int],
    sweep: float | None = None,
) -> tuple[Callable[[int], StereoFrame], list[str]]:
    """The same reader with each frame's scan added where there is one, and notices of what is lacking or absurd.

    sweep: as `StereoFrame.lidar_sweep`.
    """

    def load_with_scan(index: int) -> StereoFrame:
        frame = load(index)
        path = scans.get(rows[index])
        if path is None:
            return frame
        return dataclasses.replace(frame, lidar=read_scan(path), lidar_sweep=sweep)

    count = sum(row in scans for row in rows)
    notices = [] if count == len(rows) else [f"LiDAR scans for {count} of {len(rows)} frames"]
    paths = [scans[row] for row in rows if row in scans][:: max(1, count // LOOKED_AT)]
    read = [scan for path in paths if (scan := read_scan(path)) is not None and len(scan)]
    if paths and not read:
        return load, [f"LiDAR scans of {paths[0].parent.name}/ cannot be read: left unused"]
    reach = [float(np.median(np.linalg.norm(scan[:, :3].astype(np.float64), axis=1))) for scan in read]
    if reach and min(reach) > FARTHEST_M:
        told = f"half of their points lie beyond {min(reach):.0f} m: left unused; are they in mm?"
        return load, [f"LiDAR scans of {paths[0].parent.name}/ are no scans in metres: {told}"]
    return load_with_scan, notices
