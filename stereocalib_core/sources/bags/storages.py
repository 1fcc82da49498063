"""When each message of a topic came and where it lies, without reading the messages; and one message at a time.

A bag of gigabytes opens in the time that its index takes. `rosbags` opens the file, knows the topics and decodes
messages; the index and single reads are here, because it offers messages in the order of the file only.
"""

from __future__ import annotations

import sqlite3
import struct
import threading
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Protocol

from stereocalib_core.config.reading import MOST_BYTES_OF_A_MESSAGE

STAMP_BYTES = 16


@dataclass(frozen=True)
class Entry:
    """One message: when it was recorded and what its own header says [ns], None unknown; place: where it lies."""

    log_ns: int
    header_ns: int | None
    place: Any


class Storage(Protocol):
    """One file of a bag."""

    def entries(self, topic: str) -> list[Entry]:
        """The messages of a topic, in the order in which they were recorded."""

    def raw(self, entry: Entry) -> bytes:
        """The bytes of one message."""


def cdr_stamp(data: bytes) -> int | None:
    """The header's stamp [ns] at the start of a ROS 2 message."""
    if len(data) < 12:
        return None
    seconds, nanoseconds = struct.unpack_from("<iI" if data[1] & 1 else ">iI", data, 4)
    return seconds * 10**9 + nanoseconds if seconds >= 0 and nanoseconds < 10**9 else None


def ros1_stamp(data: bytes) -> int | None:
    """The header's stamp [ns] at the start of a ROS 1 message: after its sequence number."""
    if len(data) < 12:
        return None
    seconds, nanoseconds = struct.unpack_from("<II", data, 4)
    return seconds * 10**9 + nanoseconds if nanoseconds < 10**9 else None


class Ros1Storage:
    """A ROS 1 bag by its own index."""

    def __init__(self, reader: Any) -> None:
        self._reader = reader
        self._lock = threading.Lock()
        self._file: BinaryIO = open(reader.path, "rb")  # noqa: SIM115
        self._chunk: tuple[int, bytes] = (-1, b"")

    def entries(self, topic: str) -> list[Entry]:
        """See `Storage`."""
        ids = [c.id for c in self._reader.connections if c.topic == topic]
        places = sorted(place for i in ids for place in self._reader.indexes[i])
        found = []
        for place in places:
            packed = not self._plain(place.chunk_pos)
            stamp = None if packed else ros1_stamp(self._record(place, STAMP_BYTES))
            found.append(Entry(place.time, stamp, place))
        return found

    def _plain(self, chunk_pos: int) -> bool:
        probe = b"?"
        try:
            return self._reader.chunks[chunk_pos].decompressor(probe) is probe
        except Exception:  # noqa: BLE001 - bz2 and lz4 each raise their own kind for what is not theirs
            return False

    def _record(self, place: Any, most: int = MOST_BYTES_OF_A_MESSAGE) -> bytes:
        chunk = self._reader.chunks[place.chunk_pos]
        if self._plain(place.chunk_pos):
            at = chunk.datapos + place.offset
            while True:
                self._file.seek(at)
                header = self._file.read(_u32(self._file.read(4)))
                size = _u32(self._file.read(4))
                if b"op=\x02" in header:
                    return self._file.read(min(size, most))
                at = self._file.tell() + size
        if self._chunk[0] != place.chunk_pos:
            self._file.seek(chunk.datapos)
            self._chunk = (place.chunk_pos, chunk.decompressor(self._file.read(chunk.datasize)))
        data, at = self._chunk[1], place.offset
        while True:
            length = _u32(data[at : at + 4])
            header = data[at + 4 : at + 4 + length]
            size = _u32(data[at + 4 + length : at + 8 + length])
            at += 8 + length
            if b"op=\x02" in header:
                return data[at : at + min(size, most)]
            at += size

    def raw(self, entry: Entry) -> bytes:
        """See `Storage`."""
        with self._lock:
            return self._record(entry.place)


def _u32(data: bytes) -> int:
    if len(data) != 4:
        raise EOFError("the bag ends too early")
    return int.from_bytes(data, "little")


class SqliteStorage:
    """A file of a ROS 2 bag in SQLite."""

    def __init__(self, path: Path, packed: bool) -> None:
        self._packed = packed
        self._lock = threading.Lock()
        self._base = sqlite3.connect(f"file:{path}?immutable=1", uri=True, check_same_thread=False)

    def entries(self, topic: str) -> list[Entry]:
        """See `Storage`."""
        query = (
            "SELECT messages.id, timestamp FROM messages JOIN topics ON topics.id = topic_id "
            "WHERE topics.name = ? ORDER BY timestamp, messages.id"
        )
        with self._lock:
            rows = self._base.execute(query, (topic,)).fetchall()
            return [Entry(log_ns, None if self._packed else self._stamp(row), row) for row, log_ns in rows]

    def _stamp(self, row: int) -> int | None:
        """The header's stamp. A function of SQL on the message would read all of it, an open blob its first page."""
        with self._base.blobopen("messages", "data", row, readonly=True) as blob:
            return cdr_stamp(blob.read(STAMP_BYTES))

    def raw(self, entry: Entry) -> bytes:
        """See `Storage`."""
        with self._lock:
            row = self._base.execute("SELECT data FROM messages WHERE id = ?", (entry.place,)).fetchone()
        data = bytes(row[0])
        return _unpacked("zstd", data, 0) if self._packed else data


class McapStorage:
    """An MCAP file, by its records' headers and its chunks' own indexes."""

    def __init__(self, path: Path, channels: dict[int, str], packed: bool) -> None:
        """channels: number to topic. packed: every message is compressed by itself."""
        self._channels, self._packed = channels, packed
        self._lock = threading.Lock()
        self._file: BinaryIO = open(path, "rb")  # noqa: SIM115
        self._size = path.stat().st_size
        self._chunk: tuple[int, bytes] = (-1, b"")
        self._found: dict[str, list[Entry]] | None = None

    def entries(self, topic: str) -> list[Entry]:
        """See `Storage`."""
        with self._lock:
            if self._found is None:
                self._found = self._scan()
            return sorted(self._found.get(topic, []), key=lambda entry: entry.log_ns)

    def _scan(self) -> dict[str, list[Entry]]:
        """All records in turn, their content passed over."""
        found: dict[str, list[Entry]] = defaultdict(list)
        at, chunk, indexed = 8, -1, True
        while at + 9 <= self._size - 8:
            self._file.seek(at)
            head = self._file.read(9)
            op, length = head[0], int.from_bytes(head[1:], "little")
            if op in (0x06, 0x0F, 0x02, 0x08) and not indexed:
                self._index_chunk(chunk, found)
                indexed = True
            if op == 0x05:
                channel, _, log_ns = struct.unpack("<HIQ", self._file.read(14))
                self._add(found, channel, log_ns, (-1, at + 9 + 22, length - 22))
            elif op == 0x06:
                chunk, indexed = at, False
            elif op == 0x07 and chunk >= 0:
                indexed = True
                self._read_index(chunk, self._file.read(length), found)
            elif op in (0x0F, 0x02):
                break
            at += 9 + length
        return found

    def _read_index(self, chunk: int, data: bytes, found: dict[str, list[Entry]]) -> None:
        channel, size = struct.unpack_from("<HI", data, 0)
        if channel in self._channels:
            for log_ns, offset in struct.iter_unpack("<QQ", data[6 : 6 + size]):
                self._add(found, channel, log_ns, (chunk, offset, -1))

    def _index_chunk(self, chunk: int, found: dict[str, list[Entry]]) -> None:
        """A chunk without an index of its own: it is unpacked to see what is in it."""
        data = self._unpacked_chunk(chunk)
        at = 0
        while at + 9 <= len(data):
            op, length = data[at], int.from_bytes(data[at + 1 : at + 9], "little")
            if op == 0x05:
                channel, _, log_ns = struct.unpack_from("<HIQ", data, at + 9)
                self._add(found, channel, log_ns, (chunk, at, -1))
            at += 9 + length

    def _add(
        self, found: dict[str, list[Entry]], channel: int, log_ns: int, place: tuple[int, int, int]
    ) -> None:
        topic = self._channels.get(channel)
        if topic is None:
            return
        stamp = None if self._packed else self._stamp(place)
        found[topic].append(Entry(log_ns, stamp, place))

    def _stamp(self, place: tuple[int, int, int]) -> int | None:
        """The header's stamp, where it can be read without unpacking a chunk."""
        chunk, at, _ = place
        if chunk >= 0:
            start, compression, _, _ = self._chunk_head(chunk)
            if compression:
                return None
            at = start + at + 9 + 22
        here = self._file.tell()
        self._file.seek(at)
        stamp = cdr_stamp(self._file.read(STAMP_BYTES))
        self._file.seek(here)
        return stamp

    def _chunk_head(self, chunk: int) -> tuple[int, str, int, int]:
        """Where the chunk's records begin, how and to what size they are packed, and their size unpacked."""
        here = self._file.tell()
        self._file.seek(chunk + 9 + 16)
        size, _, name = struct.unpack("<QII", self._file.read(16))
        compression = self._file.read(min(name, 32)).decode("ascii", "replace")
        packed = int.from_bytes(self._file.read(8), "little")
        start = self._file.tell()
        self._file.seek(here)
        return start, compression, packed, size

    def _unpacked_chunk(self, chunk: int) -> bytes:
        if self._chunk[0] != chunk:
            start, compression, packed, size = self._chunk_head(chunk)
            if max(packed, size) > MOST_BYTES_OF_A_MESSAGE:
                raise EOFError("a chunk of over 1 GB")
            here = self._file.tell()
            self._file.seek(start)
            data = self._file.read(packed)
            self._file.seek(here)
            self._chunk = (chunk, _unpacked(compression, data, size))
        return self._chunk[1]

    def raw(self, entry: Entry) -> bytes:
        """See `Storage`."""
        chunk, at, size = entry.place
        with self._lock:
            if chunk < 0:
                self._file.seek(at)
                data = self._file.read(min(size, MOST_BYTES_OF_A_MESSAGE))
            else:
                start, compression, _, _ = self._chunk_head(chunk)
                if compression:
                    whole = self._unpacked_chunk(chunk)
                    length = int.from_bytes(whole[at + 1 : at + 9], "little")
                    data = whole[at + 9 + 22 : at + 9 + length]
                else:
                    self._file.seek(start + at + 1)
                    length = int.from_bytes(self._file.read(8), "little")
                    self._file.seek(start + at + 9 + 22)
                    data = self._file.read(min(length - 22, MOST_BYTES_OF_A_MESSAGE))
        return _unpacked("zstd", data, 0) if self._packed else data


def _unpacked(compression: str, data: bytes, size: int) -> bytes:
    """Bytes of a chunk or message, unpacked with what `rosbags` brings."""
    if not compression:
        return data
    if compression == "lz4":
        from lz4.frame import decompress

        return bytes(decompress(data))
    if compression == "zstd":
        try:
            from compression import zstd  # Python 3.14
        except ImportError:
            from backports import zstd  # type: ignore[no-redef]
        return bytes(zstd.decompress(data))
    raise EOFError(f"chunk compression {compression[:20]} is not known")
