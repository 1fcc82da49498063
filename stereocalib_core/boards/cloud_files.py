"""Point clouds from files: PCD, KITTI .bin, PLY, NPY, CSV and XYZ, all to (N, 3) metres.

Every reader checks what a header claims against what the file holds before it allocates anything.
Points that are not finite, sit in the sensor's origin (no return) or lie absurdly far are dropped.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.boards import pcd, ply
from stereocalib_core.config.boards import CLOUD_FILE
from stereocalib_core.errors import SourceError
from stereocalib_core.numeric.arrays import Array


def read_cloud(path: Path) -> Array:
    """A cloud file, recognised by its ending, to (N, 3) points [m] in the LiDAR frame.

    Raises SourceError (one line) for a file that is missing, cut off, none of the known kinds, or empty.
    """
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise SourceError("cloud of unknown kind", path, f"use one of {' '.join(sorted(_READERS))}")
    try:
        size = path.stat().st_size
        if size > CLOUD_FILE.largest_file_bytes:
            raise SourceError("cloud file is too large", path, "give one sweep per file")
        points = reader(path)
    except OSError as error:
        raise SourceError("cloud cannot be read", path, error.strerror or "check the file") from error
    except (ValueError, UnicodeDecodeError, EOFError, MemoryError) as error:
        raise SourceError("cloud is damaged", path, f"write it again ({str(error)[:120]})") from error
    return usable_points(points, path)


def usable_points(points: NDArray[np.floating], where: object) -> Array:
    """(N, 3) raw points to those that are real returns, as float64."""
    points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    with np.errstate(invalid="ignore", over="ignore"):
        reach = np.sqrt(np.sum(points * points, axis=1))
        kept = points[
            np.isfinite(points).all(axis=1) & (reach > CLOUD_FILE.nearest_m) & (reach < CLOUD_FILE.farthest_m)
        ]
    if len(kept) < CLOUD_FILE.least_points:
        raise SourceError(
            "cloud has no points", where, f"{len(kept)} of {len(points)} are returns; record it again"
        )
    return kept


def _read_bin(path: Path) -> Array:
    """KITTI: float32 x, y, z, reflectance."""
    size = path.stat().st_size
    if size % 16:
        raise SourceError("cloud is cut off or no KITTI .bin", path, "expected float32 x y z reflectance")
    return np.fromfile(path, dtype="<f4").reshape(-1, 4)[:, :3].astype(np.float64)


def _read_npy(path: Path) -> Array:
    """(N, 3 or more) numbers, or a structured array with fields x, y, z."""
    # Mapping the file refuses a header that claims more than the file holds, and pickles are never run.
    array = np.load(path, mmap_mode="r", allow_pickle=False)
    if array.dtype.names:
        missing = {"x", "y", "z"} - set(array.dtype.names)
        if missing:
            raise SourceError("cloud has no x, y, z", path, f"fields are {' '.join(array.dtype.names)}")
        return np.stack([np.asarray(array[name], dtype=np.float64).reshape(-1) for name in "xyz"], axis=1)
    if array.ndim < 2 or array.shape[-1] < 3 or array.dtype.kind not in "fiu":
        raise SourceError("cloud is no list of points", path, f"expected (N, 3) numbers, found {array.shape}")
    return np.array(array.reshape(-1, array.shape[-1])[:, :3], dtype=np.float64)


def _read_text(path: Path) -> Array:
    """Comma, semicolon or blank separated; a first line with names may say which columns are x, y, z."""
    lines = path.read_text(encoding="utf-8-sig").replace(",", " ").replace(";", " ").splitlines()
    rows = [line for line in lines if line.strip() and not line.lstrip().startswith(("#", "//"))]
    if not rows:
        raise SourceError("cloud has no points", path, "the file is empty")
    columns = [0, 1, 2]
    first = rows[0].split()
    if not _is_number(first[0]):
        names = [name.strip("\"'").lower() for name in first]
        if all(axis in names for axis in "xyz"):
            columns = [names.index(axis) for axis in "xyz"]
        rows = rows[1:]
    width = len(rows[0].split()) if rows else 0
    values = np.array(" ".join(rows).split(), dtype=np.float64)
    if width < max(columns) + 1 or len(values) != width * len(rows):
        raise SourceError(
            "cloud is cut off", path, "every line must hold the same number of columns, at least x y z"
        )
    return np.asarray(values.reshape(-1, width)[:, columns])


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


_READERS: dict[str, Callable[[Path], NDArray[np.floating]]] = {
    ".pcd": pcd.read,
    ".bin": _read_bin,
    ".ply": ply.read,
    ".npy": _read_npy,
    ".csv": _read_text,
    ".xyz": _read_text,
    ".txt": _read_text,
}
SUFFIXES = (".pcd", ".bin", ".ply", ".npy", ".csv", ".xyz")
