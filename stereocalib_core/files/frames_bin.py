"""An append-only file of finished frames, from which a killed run goes on; a finished run leaves it as `frames.bin`.

Layout: `MAGIC`, then records of `length, checksum, payload` (little endian). The checksum is the CRC-32 of this
payload and of all before it, so that no record can be lost, doubled or moved unnoticed. The first payload is a JSON
header that names source, settings and first frame; every other one is the next frame: the length of a JSON part,
the JSON, and the raw arrays that it describes. Nothing in it is executed. A record cut off by a kill is dropped, and
so are the zeros that a power cut leaves at the end of a file.
"""

from __future__ import annotations

import contextlib
import json
import os
import struct
import time
import zlib
from array import array
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, overload

from stereocalib_core import config
from stereocalib_core.config import PipelineConfig
from stereocalib_core.config.running import MOST_BYTES_OF_A_RECORD, SYNC_S
from stereocalib_core.errors import OutputError, StereoCalibError
from stereocalib_core.files.frame_record import Done, pack, unpack
from stereocalib_core.geometry import StereoCamera
from stereocalib_core.numeric.spill import Shelf
from stereocalib_core.results import (
    Rig,
    Tolerance,
)
from stereocalib_core.system.collecting import without_collecting

MAGIC = b"stereocalib checkpoint 7\n"
_HEAD = struct.Struct("<II")


@dataclass(frozen=True)
class RunKey:
    """What must be equal for a stopped run to go on.

    source: the content key of the recording. mended: that of the mended one, where the pair is mended.
    """

    source: str
    camera: StereoCamera
    settings: PipelineConfig
    rig: Rig | None = None
    tolerances: Mapping[str, Tolerance] = field(default_factory=lambda: MappingProxyType({}))
    first_frame: int = 0
    mended: str | None = None
    version: str = ""

    def to_json(self) -> bytes:
        """The same key gives the same bytes."""
        values = {
            "version": self.version,
            "source": self.source,
            "camera": asdict(self.camera),
            "settings": config.to_dict(self.settings),
            "rig": None if self.rig is None else asdict(self.rig),
            "tolerances": {axis: asdict(limit) for axis, limit in self.tolerances.items()},
            "first frame": self.first_frame,
            "mended": self.mended,
        }
        return json.dumps(values, sort_keys=True).encode()


class Checkpoint(Sequence[Done]):
    """Writes one, and is the frames that it holds: read when asked for, so that a long drive waits on the disk for
    its end. Every record reaches the operating system before the next frame begins, so that a kill loses none,
    and the disk within `SYNC_S`, which is all that a power cut takes."""

    def __init__(self, path: Path, key: RunKey, keep: int | None = None) -> None:
        """Start a file, or go on after its first `keep` bytes."""
        self.path = path
        self._places = array("Q")  # begin and end of every frame's payload
        flags = os.O_RDWR | os.O_CREAT | (0 if keep else os.O_TRUNC)
        try:
            self._file, self._synced = os.open(path, flags, 0o644), 0.0
            if keep:
                os.ftruncate(self._file, keep)
                os.lseek(self._file, 0, os.SEEK_END)
                for i, record in enumerate(_walk(path)):
                    self._chain = record.chain
                    if i > 0:
                        self._places.extend((record.end - len(record.payload), record.end))
            else:
                _write(self._file, MAGIC)
                self._chain = 0
                self._add(key.to_json())
        except OSError as error:
            raise OutputError(
                "checkpoint cannot be written", path, error.strerror or "check the disk"
            ) from error

    def append(self, done: Done) -> Done:
        """Add a finished frame; gives it as it will be read again, so that both ways lead to the same bits."""
        payload = pack(done)
        try:
            self._add(payload)
        except OSError as error:
            remedy = error.strerror or "check the disk"
            raise OutputError("checkpoint cannot be written", self.path, remedy) from error
        end = os.lseek(self._file, 0, os.SEEK_CUR)
        self._places.extend((end - len(payload), end))
        return unpack(payload)

    def __len__(self) -> int:
        return len(self._places) // 2

    @overload
    def __getitem__(self, index: int) -> Done: ...

    @overload
    def __getitem__(self, index: slice) -> list[Done]: ...

    def __getitem__(self, index: int | slice) -> Done | list[Done]:
        if isinstance(index, slice):
            shelf = Shelf()
            with without_collecting():
                return [self._read(i, shelf) for i in range(*index.indices(len(self)))]
        return self._read(range(len(self))[index])

    def _read(self, at: int, shelf: Shelf | None = None) -> Done:
        begin, end = self._places[2 * at], self._places[2 * at + 1]
        return unpack(os.pread(self._file, end - begin, begin), shelf)

    def _add(self, payload: bytes) -> None:
        self._chain = zlib.crc32(payload, self._chain)
        _write(self._file, _HEAD.pack(len(payload), self._chain) + payload)
        if time.monotonic() - self._synced > SYNC_S:
            os.fsync(self._file)
            self._synced = time.monotonic()

    def close(self) -> None:
        """Close the file and leave it."""
        with contextlib.suppress(OSError):
            os.fsync(self._file)
        os.close(self._file)


def read_checkpoint(path: Path, key: RunKey) -> tuple[list[Done], int]:
    """The finished frames of an earlier run of the same `key`, and how many bytes of the file are whole.

    Raises OutputError for a file of other source or settings, or one that is no checkpoint.
    """
    stored, frames, whole = _read(path)
    now = json.loads(key.to_json())
    if stored != now:
        changed = " and ".join(name for name in now if stored.get(name) != now[name]) or "something"
        remedy = f"{changed} changed; give the same options, or start afresh with --overwrite"
        raise OutputError("run of another source or other settings", path.parent, remedy)
    return frames, whole


def read_frames(path: Path) -> tuple[StereoCamera, list[Done]]:
    """Camera and frames of the file that a finished run leaves, whatever made it; raises OutputError."""
    header, frames, _ = _read(path)
    try:
        return StereoCamera(**header["camera"]), frames
    except (KeyError, TypeError, ValueError, StereoCalibError) as error:
        raise OutputError("frames without a camera", path, "run the drive again") from error


def read_outline(path: Path) -> tuple[StereoCamera, int]:
    """Camera and number of frames of such a file, by the lengths that stand before its records: of an hour's drive in
    a moment. Whether the frames are whole only `read_frames` tells. Raises OutputError."""
    try:
        with path.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise OutputError("no checkpoint", path, "start afresh with --overwrite")
            end = os.fstat(file.fileno()).st_size
            length, _ = _HEAD.unpack(file.read(_HEAD.size))
            header = json.loads(file.read(length))
            place, frames = file.tell(), 0
            while place + _HEAD.size <= end:
                length, _ = _HEAD.unpack(os.pread(file.fileno(), _HEAD.size, place))
                place += _HEAD.size + length
                if not 0 < length <= MOST_BYTES_OF_A_RECORD or place > end:
                    break
                frames += 1
        return StereoCamera(**header["camera"]), frames
    except OSError as error:
        raise OutputError("checkpoint cannot be read", path, error.strerror or "check its rights") from error
    except (struct.error, KeyError, TypeError, ValueError, StereoCalibError) as error:
        raise OutputError("frames without a camera", path, "run the drive again") from error


@dataclass(frozen=True)
class _Record:
    """payload; chain: the checksum up to and with it; end: where it ends in the file."""

    payload: bytes
    chain: int
    end: int


def _walk(path: Path) -> Iterator[_Record]:
    """The whole records from the beginning of a file, as far as their checksums hold."""
    try:
        with path.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise OutputError("no checkpoint", path, "start afresh with --overwrite")
            chain = 0
            while len(head := file.read(_HEAD.size)) == _HEAD.size:
                length, checksum = _HEAD.unpack(head)
                payload = file.read(length) if 0 < length <= MOST_BYTES_OF_A_RECORD else b""
                if not payload or len(payload) < length:
                    return
                chain = zlib.crc32(payload, chain)
                if chain != checksum:
                    return
                yield _Record(payload, chain, file.tell())
    except OSError as error:
        raise OutputError("checkpoint cannot be read", path, error.strerror or "check its rights") from error


def _read(path: Path) -> tuple[dict[str, Any], list[Done], int]:
    """Header, frames, and how many bytes of the file are whole."""
    records = _walk(path)
    try:
        first = next(records)
        header = dict(json.loads(first.payload))
    except (StopIteration, ValueError, TypeError) as error:
        raise OutputError("checkpoint without a header", path, "start afresh with --overwrite") from error
    frames, whole, shelf = [], first.end, Shelf()
    try:
        with without_collecting():
            for record in records:
                frames.append(unpack(record.payload, shelf))
                whole = record.end
    except (ValueError, KeyError, TypeError, IndexError, struct.error) as error:
        raise OutputError("damaged checkpoint", path, "start afresh with --overwrite") from error
    begin = header.get("first frame", frames[0].result.frame if frames else 0)
    if any(done.result.frame != begin + i for i, done in enumerate(frames)):
        raise OutputError("checkpoint without all of its frames", path, "start afresh with --overwrite")
    return header, frames, whole


def _write(file: int, data: bytes) -> None:
    view = memoryview(data)
    while view:
        view = view[os.write(file, view) :]
