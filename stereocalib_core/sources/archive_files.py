"""Unpacking a zip: only what a drive needs, never more than is allowed, nothing outside the folder, in a stream."""

from __future__ import annotations

import lzma
import os
import shutil
import stat
import time
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import BinaryIO

from stereocalib_core.config.reading import (
    MOST_BYTES_OF_A_CALIBRATION,
    MOST_BYTES_OF_A_LIST,
    MOST_BYTES_OF_A_PICTURE,
    MOST_RATIO,
)
from stereocalib_core.errors import SourceError
from stereocalib_core.sources.pictures import PICTURE_SUFFIXES
from stereocalib_core.system import opening

DAMAGED = (
    zipfile.BadZipFile, zlib.error, lzma.LZMAError, EOFError, OSError, ValueError, RuntimeError, OverflowError,
)  # fmt: skip
"""What reading a damaged, encrypted or unusual zip raises."""
LIMITS = {
    **dict.fromkeys(PICTURE_SUFFIXES, MOST_BYTES_OF_A_PICTURE),
    **dict.fromkeys((".bin", ".pcd", ".npy", ".ply"), MOST_BYTES_OF_A_PICTURE),
    **dict.fromkeys((".txt", ".csv", ".tum", ".kitti"), MOST_BYTES_OF_A_LIST),
    **dict.fromkeys((".yaml", ".yml", ".xml", ".json", ".calib", ".cfg"), MOST_BYTES_OF_A_CALIBRATION),
}
"""What a drive is made of, and how large one such file may be: a picture of 64 million pixels with 16 bits and three
colours, a list of a million rows, a calibration."""
CHUNK = 1 << 20


def unpack(file: BinaryIO | Path, name: str, folder: Path, most_bytes: int, most_files: int) -> int:
    """The parts of a drive in a zip, below `folder`; their bytes. Raises SourceError, and leaves nothing then.

    most_bytes, most_files: of all that is unpacked. Refuses links, names that lead outside, and files that are
    larger than they say.
    """
    try:
        with zipfile.ZipFile(file) as archive:
            wanted = list(_wanted(archive, name))
            total = sum(entry.file_size for entry, _ in wanted)
            if len(wanted) > most_files or total > most_bytes:
                limit = f"at most {most_files} files and {most_bytes / 1e9:.3g} GB"
                raise SourceError("zip unpacks to too much", name, limit)
            if not wanted:
                raise SourceError(
                    "no stereo drive in the zip", name, "pack left/ right/ camera.yaml, or KITTI"
                )
            for done, (entry, path) in enumerate(wanted):
                opening.tell(done, len(wanted))
                _write(archive, entry, folder / path, name)
            return total
    except DAMAGED as error:
        shutil.rmtree(folder, ignore_errors=True)
        raise SourceError("zip cannot be read", name, str(error)[:200] or "it ends too early") from error
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise


def _wanted(archive: zipfile.ZipFile, name: str) -> Iterator[tuple[zipfile.ZipInfo, PurePosixPath]]:
    for entry in archive.infolist():
        path = PurePosixPath(entry.filename.replace("\\", "/"))
        link = stat.S_ISLNK(entry.external_attr >> 16)
        if path.is_absolute() or ".." in path.parts or ":" in entry.filename or link:
            raise SourceError("zip with an unsafe name", entry.filename[:100], "pack plain files only")
        hidden = any(part.startswith((".", "__MACOSX")) for part in path.parts)
        limit = LIMITS.get(path.suffix.lower())
        if entry.is_dir() or hidden or limit is None:
            continue
        if entry.file_size > limit:
            what = f"{path.name[:60]} of {entry.file_size >> 20} MB"
            raise SourceError(f"zip with {what}", name, f"at most {limit >> 10} kB are read of such a file")
        if entry.file_size > CHUNK and entry.file_size > MOST_RATIO * max(entry.compress_size, 1):
            raise SourceError("zip that unfolds too far", f"{name}, {path.name[:60]}", "pack the real files")
        yield entry, path


def _write(archive: zipfile.ZipFile, entry: zipfile.ZipInfo, target: Path, name: str) -> None:
    """One file in a stream, with the time it has in the archive, so that it is the same when unpacked again."""
    target.parent.mkdir(parents=True, exist_ok=True)
    left = entry.file_size
    with archive.open(entry) as source, open(target, "wb") as out:
        while data := source.read(min(CHUNK, left + 1)):
            left -= len(data)
            if left < 0:
                raise SourceError("zip lies about its size", name, "pack it again")
            out.write(data)
    try:
        moment = time.mktime((*entry.date_time, 0, 0, -1))
    except (ValueError, OverflowError):
        moment = 0.0
    os.utime(target, (moment, moment))
