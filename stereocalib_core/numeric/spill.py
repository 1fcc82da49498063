"""Large arrays of a long drive on the disk instead of in memory, as far as nobody works on them.

An hour's drive has tens of millions of tracked points, and every pass over them needs a stretch at a time. Such arrays
lie in a file without a name, mapped into memory: the system reads what is touched and takes it back when it is let go.
Small arrays, and all of them where the disk has no room, are ordinary ones; nobody needs to ask which.
"""

from __future__ import annotations

import contextlib
import ctypes
import mmap
import os
import sys
import tempfile
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

LEAST_BYTES = 1024 * 1024
"""Smaller arrays are not worth a file."""
SEGMENT_BYTES = 16 * 1024 * 1024
FIRST_SEGMENT_BYTES = 4 * 1024 * 1024
"""Of a `Shelf`: what a short drive needs stays in memory."""


def roomy(shape: int | tuple[int, ...], dtype: DTypeLike = np.float64) -> NDArray[Any]:
    """Zeros of this shape, on the disk where they are large."""
    size = int(np.prod(shape, dtype=np.int64)) * np.dtype(dtype).itemsize
    found = _mapped(size) if size >= LEAST_BYTES else None
    return np.zeros(shape, dtype) if found is None else np.ndarray(shape, dtype, found)


def _mapped(size: int) -> mmap.mmap | None:
    """So many zero bytes on the disk, reserved: a full disk is told now, not by a crash. None: no room, or no way."""
    if not hasattr(os, "posix_fallocate") or not hasattr(mmap, "MADV_DONTNEED"):
        return None
    try:
        with tempfile.TemporaryFile() as file:
            os.posix_fallocate(file.fileno(), 0, size)
            return mmap.mmap(file.fileno(), size)
    except OSError:
        return None


def _file_of(array: NDArray[Any]) -> mmap.mmap | None:
    base: Any = array
    while isinstance(base, np.ndarray):
        base = base.base
    return base if isinstance(base, mmap.mmap) else None


def let_go(*arrays: Any) -> None:
    """Nobody works on these for the moment: what lies on the disk leaves the memory. Contents stay what they are."""
    for array in arrays:
        file = _file_of(array) if isinstance(array, np.ndarray) else None
        if file is not None:
            file.madvise(mmap.MADV_DONTNEED)


def put_away(array: NDArray[Any]) -> NDArray[Any]:
    """The same array, on the disk where it is large."""
    if array.nbytes < LEAST_BYTES:
        return array
    if _file_of(array) is None:
        place = roomy(array.shape, array.dtype)
        place[...] = array
        array = place
    let_go(array)
    return array


def spilled(arguments: Sequence[Any]) -> list[NDArray[Any]]:
    """Those that are arrays on the disk."""
    return [a for a in arguments if isinstance(a, np.ndarray) and _file_of(a) is not None]


def give_back() -> None:
    """Memory that is free again goes back to the system, where the allocator can be told so: after many small things
    were made and forgotten."""
    if sys.platform == "linux":
        with contextlib.suppress(OSError, AttributeError):
            ctypes.CDLL(None).malloc_trim(0)


class Shelf:
    """Puts many small arrays aside in few large ones, on the disk once there are enough of them."""

    def __init__(self) -> None:
        self._segment, self._used = np.empty(FIRST_SEGMENT_BYTES, np.uint8), 0

    def put(self, array: NDArray[Any]) -> NDArray[Any]:
        """The same array, elsewhere."""
        size = -(-array.nbytes // 16) * 16
        if size > len(self._segment) - self._used:
            let_go(self._segment)
            self._segment, self._used = roomy(max(SEGMENT_BYTES, size), np.uint8), 0
        place = np.ndarray(array.shape, array.dtype, self._segment, self._used)
        place[...] = array
        self._used += size
        return place
