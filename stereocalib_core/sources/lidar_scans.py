"""Velodyne scans of a recording: (N, 4) float32 binary files, matched to the frames by their number."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.frames import StereoFrame

MAX_BYTES = 256 * 1024 * 1024


def scans_by_number(folder: Path) -> dict[int, Path]:
    """The numbered `.bin` files of a folder; empty where there is none."""
    try:
        names = sorted(os.listdir(folder))
    except OSError:
        return {}
    return {
        int(name[:-4]): folder / name for name in names if name.endswith(".bin") and name[:-4].isdecimal()
    }


def read_scan(path: Path) -> NDArray[np.float32] | None:
    """(N, 4) float32 x y z [m] and intensity, finite points only; None for a damaged file."""
    try:
        size = path.stat().st_size
        if size == 0 or size % 16 or size > MAX_BYTES:
            return None
        points = np.fromfile(path, dtype=np.float32).reshape(-1, 4)
    except OSError:
        return None
    return points[np.isfinite(points).all(axis=1)]


def with_scan(
    load: Callable[[int], StereoFrame],
    scans: dict[int, Path],
    rows: Sequence[int],
    sweep: float | None = None,
) -> tuple[Callable[[int], StereoFrame], list[str]]:
    """The same reader with each frame's scan added where there is one, and a notice when some have none.

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
    return load_with_scan, notices
