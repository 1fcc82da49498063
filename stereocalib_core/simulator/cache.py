"""Rendered frames on disk between runs: one file a frame, checked when read, bounded in size.

A file is written beside its place and renamed into it, so that a killed run leaves whole files only; a file
that was cut short or changed fails its checksum and is rendered again. A disk that cannot be written costs
time, never a frame.
"""

from __future__ import annotations

import contextlib
import os
import struct
import threading
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.system.user_cache import user_cache

LIMIT_BYTES = 2 * 1024**3
_MAGIC = b"SCF1"
_HEADER = struct.Struct("<4sIIIII")
_CHECK_EVERY = 64

Pictures = tuple[NDArray[np.uint8], NDArray[np.uint8], NDArray[np.float32] | None]


def cache_folder() -> Path:
    """The folder for rendered frames."""
    return user_cache() / "synthetic"


class FrameCache:
    """The frames of one drive under `folder`/`key`; oldest files of any drive go when `limit_bytes` is full."""

    def __init__(self, key: str, folder: Path | None = None, limit_bytes: int = LIMIT_BYTES) -> None:
        self.root = cache_folder() if folder is None else folder
        self.folder = self.root / key
        self.limit_bytes = limit_bytes
        self._writes = 0
        self._usable = True
        self._lock = threading.Lock()

    def path(self, frame: int) -> Path:
        """The file of a frame."""
        return self.folder / f"{frame:06d}.frame"

    def read(self, frame: int) -> Pictures | None:
        """Left, right and the LiDAR scan of a frame; None where they are not there whole."""
        try:
            data = self.path(frame).read_bytes()
        except OSError:
            return None
        pictures = unpack(data)
        if pictures is None:
            with contextlib.suppress(OSError):
                self.path(frame).unlink()
        return pictures

    def write(self, frame: int, pictures: Pictures) -> None:
        """Keep a frame, if the disk lets us."""
        if not self._usable:
            return
        target = self.path(frame)
        temporary = target.with_name(f".{target.name}.{os.getpid()}.{threading.get_ident()}")
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            temporary.write_bytes(pack(pictures))
            os.replace(temporary, target)
        except OSError:
            self._usable = False
            with contextlib.suppress(OSError):
                temporary.unlink()
            return
        with self._lock:
            due = self._writes % _CHECK_EVERY == 0
            self._writes += 1
        if due:
            trim(self.root, self.limit_bytes)


def pack(pictures: Pictures) -> bytes:
    """One frame as bytes: header, checksum, left, right, scan."""
    left, right, scan = pictures
    height, width = left.shape
    body = left.tobytes() + right.tobytes()
    points = 0
    if scan is not None:
        points = len(scan) + 1
        body += np.ascontiguousarray(scan, dtype=np.float32).tobytes()
    return _HEADER.pack(_MAGIC, height, width, points, len(body), zlib.crc32(body)) + body


def unpack(data: bytes) -> Pictures | None:
    """The inverse of `pack`; None for bytes that are not exactly what was packed."""
    if len(data) < _HEADER.size:
        return None
    magic, height, width, points, length, checksum = _HEADER.unpack_from(data)
    body = memoryview(data)[_HEADER.size :]
    size = height * width
    whole = 2 * size + (16 * (points - 1) if points else 0)
    if magic != _MAGIC or len(body) != length or length != whole or zlib.crc32(body) != checksum:
        return None
    left = np.frombuffer(body, np.uint8, size).reshape(height, width)
    right = np.frombuffer(body, np.uint8, size, size).reshape(height, width)
    scan = np.frombuffer(body[2 * size :], np.float32).reshape(-1, 4) if points else None
    return left, right, scan


def trim(root: Path, limit_bytes: int) -> None:
    """Delete the oldest frames under `root` until nine tenths of the limit are left, if it is exceeded.

    Others may do the same at the same time: what is gone meanwhile is gone.
    """
    files = []
    folders = list(_within(root))
    for path in (path for folder in folders for path in _within(folder)):
        with contextlib.suppress(OSError):
            status = path.stat()
            files.append((status.st_mtime, status.st_size, path))
    total = sum(size for _, size, _ in files)
    if total <= limit_bytes:
        return
    for _, size, path in sorted(files, key=lambda item: item[:2]):
        with contextlib.suppress(OSError):
            path.unlink()
        total -= size
        if total <= 0.9 * limit_bytes:
            break
    for folder in folders:
        # only empty ones can be removed
        with contextlib.suppress(OSError):
            folder.rmdir()


def _within(folder: Path) -> list[Path]:
    """What is in a folder; nothing where there is none any more."""
    try:
        return list(folder.iterdir())
    except OSError:
        return []
