"""Point clouds from files: PCD, float32 .bin, PLY, NPY, LAS and text, all to (N, 3) metres.

Every reader checks what a header claims against what the file holds before it allocates anything.
Points that are not finite, sit in the sensor's origin (no return) or lie absurdly far are dropped.
"""

from __future__ import annotations

import importlib
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.boards import pcd, ply
from stereocalib_core.config.boards_search import CLOUD_FILE
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
        real = np.isfinite(points).all(axis=1) & (reach > CLOUD_FILE.nearest_m)
        usual = float(np.median(reach[real])) if real.any() else 0.0
        if usual > CLOUD_FILE.farthest_usual_m:
            raise SourceError(
                f"cloud is not in metres (half of its points lie beyond {usual:.0f})", where,
                "write x y z in metres, in the sensor's own frame",
            )  # fmt: skip
        kept = points[real & (reach < CLOUD_FILE.farthest_m)]
    if len(kept) < CLOUD_FILE.least_points:
        raise SourceError(
            "cloud has no points", where, f"{len(kept)} of {len(points)} are returns; record it again"
        )
    return kept


def _read_bin(path: Path) -> Array:
    """float32 records that begin with x, y, z: four numbers as KITTI writes them, or 5 (nuScenes), 6, 8 or 3.

    The file does not say how many. Neighbours in it are neighbours in space when it is read rightly, and far apart
    when it is not; four are taken unless another number is clearly better.
    """
    size = path.stat().st_size
    values = np.fromfile(path, dtype="<f4")
    widths = [w for w in (4, 5, 3, 6, 8) if size % (4 * w) == 0 and size > 0]
    if not widths:
        raise SourceError("cloud is cut off or no KITTI .bin", path, "expected float32 x y z reflectance")
    steps = {w: _usual_step(values.reshape(-1, w)[:, :3].astype(np.float64)) for w in widths}
    best = min(widths, key=lambda w: steps[w] * (1.0 if w == 4 else CLOUD_FILE.clearly_better))
    if not np.isfinite(steps[best]):
        raise SourceError("cloud is no list of float32 points", path, "expected x y z reflectance")
    return values.reshape(-1, best)[:, :3].astype(np.float64)


def _usual_step(points: Array) -> float:
    """Median distance of neighbours in the file over the median distance from the sensor; inf for no numbers."""
    with np.errstate(invalid="ignore", over="ignore"):
        real = points[np.isfinite(points).all(axis=1)]
        real = real[np.abs(real).max(axis=1, initial=0.0) < CLOUD_FILE.absurd]
        if len(real) < 0.5 * len(points) or len(real) < 2:
            return float("inf")
        reach = float(np.median(np.linalg.norm(real, axis=1)))
        return float(np.median(np.linalg.norm(np.diff(real, axis=0), axis=1))) / max(reach, 1e-12)


def _read_las(path: Path) -> Array:
    """LAS and LAZ by laspy, which is an extra of its own."""
    try:
        laspy = importlib.import_module("laspy")
    except ImportError as error:
        raise SourceError("LAS needs laspy", path, "pip install 'stereocalib[las]'") from error
    try:
        with laspy.open(str(path)) as reader:
            points = reader.read()
            return np.stack([np.asarray(getattr(points, axis), dtype=np.float64) for axis in "xyz"], axis=1)
    except OSError:
        raise
    except Exception as error:  # laspy raises a dozen kinds for a damaged file
        raise SourceError("cloud is damaged", path, f"write it again ({str(error)[:120]})") from error


def _read_npy(path: Path) -> Array:
    """(N, 3 or more) numbers, or a structured array with fields x, y, z."""
    # Mapping the file refuses a header that claims more than the file holds, and pickles are never run.
    array = np.load(path, mmap_mode="r", allow_pickle=False)
    if array.dtype.names:
        own = {name.lower(): name for name in array.dtype.names}
        if not set("xyz") <= set(own):
            raise SourceError("cloud has no x, y, z", path, f"fields are {' '.join(array.dtype.names)}")
        return np.stack(
            [np.asarray(array[own[axis]], dtype=np.float64).reshape(-1) for axis in "xyz"], axis=1
        )
    if array.ndim < 2 or array.shape[-1] < 3 or array.dtype.kind not in "fiu":
        raise SourceError("cloud is no list of points", path, f"expected (N, 3) numbers, found {array.shape}")
    return np.array(array.reshape(-1, array.shape[-1])[:, :3], dtype=np.float64)


def _read_text(path: Path) -> Array:
    """Comma, semicolon or blank separated, decimal points or commas; a first line may name the columns x, y, z."""
    lines = _decoded(path.read_bytes()).splitlines()
    lines = [line for line in lines if line.strip() and not line.lstrip().startswith(("#", "//"))]
    if not lines:
        raise SourceError("cloud has no points", path, "the file is empty")
    comma = _decimal_comma(lines[-1])
    rows = [(line.replace(",", ".") if comma else line.replace(",", " ")).replace(";", " ") for line in lines]
    columns = [0, 1, 2]
    first = rows[0].split()
    if not _is_number(first[0]):
        names = [name.strip("\"'").lower() for name in first]
        if all(axis in names for axis in "xyz"):
            columns = [names.index(axis) for axis in "xyz"]
        rows = rows[1:]
    elif len(first) == 1 and len(rows) > 1 and len(rows[1].split()) >= 3:
        rows = rows[1:]  # PTS begins with the number of points
    width = len(rows[0].split()) if rows else 0
    values = np.array(" ".join(rows).split(), dtype=np.float64)
    if width < max(columns) + 1 or len(values) != width * len(rows):
        raise SourceError(
            "cloud is cut off", path, "every line must hold the same number of columns, at least x y z"
        )
    return np.asarray(values.reshape(-1, width)[:, columns])


def _decoded(raw: bytes) -> str:
    """Text with or without a byte-order mark, also as UTF-16."""
    if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return raw.decode("utf-16")
    return raw.decode("utf-8-sig")


def _decimal_comma(line: str) -> bool:
    """Whether commas in a line of numbers are decimal commas: other things separate, and a digit follows each."""
    parts = line.split(";") if ";" in line else line.split()
    parts = [part.strip() for part in parts if part.strip()]
    return len(parts) >= 3 and any("," in p for p in parts) and all(_DECIMAL.fullmatch(p) for p in parts)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


_DECIMAL = re.compile(r"[-+]?\d*(,\d+)?([eE][-+]?\d+)?")
_READERS: dict[str, Callable[[Path], NDArray[np.floating]]] = {
    ".pcd": pcd.read,
    ".bin": _read_bin,
    ".ply": ply.read,
    ".npy": _read_npy,
    ".csv": _read_text,
    ".xyz": _read_text,
    ".txt": _read_text,
    ".pts": _read_text,
    ".las": _read_las,
    ".laz": _read_las,
}
SUFFIXES = tuple(_READERS)
