"""Width and height of a picture from its header, before anything is unpacked."""

from __future__ import annotations

import re
import struct
from pathlib import Path

HEADER_BYTES = 1 << 16
_PNM = re.compile(rb"^P[1-7]\s+(?:#[^\n]*\n\s*)*(\d{1,7})\s+(?:#[^\n]*\n\s*)*(\d{1,7})\s")
Size = tuple[int, int]


def size_of_file(path: Path) -> Size | None:
    """(width, height) of a picture file; None where its header does not say."""
    try:
        with open(path, "rb") as file:
            return size_of(file.read(HEADER_BYTES))
    except OSError:
        return None


def size_of(data: bytes) -> Size | None:
    """(width, height) from the first bytes of a PNG, JPEG, BMP, PNM, TIFF or WebP; None for anything else."""
    try:
        if data.startswith(b"\x89PNG\r\n\x1a\n") and data[12:16] == b"IHDR":
            return struct.unpack_from(">II", data, 16)
        if data.startswith(b"\xff\xd8"):
            return _jpeg(data)
        if data.startswith(b"BM"):
            if struct.unpack_from("<I", data, 14)[0] == 12:
                return struct.unpack_from("<HH", data, 18)
            width, height = struct.unpack_from("<ii", data, 18)
            return abs(width), abs(height)
        if data[:4] in (b"II*\0", b"MM\0*"):
            return _tiff(data)
        if data.startswith(b"RIFF") and data[8:12] == b"WEBP":
            return _webp(data)
        if (match := _PNM.match(data)) is not None:
            return int(match.group(1)), int(match.group(2))
    except (struct.error, IndexError):
        return None
    return None


def jpeg_segments(data: bytes) -> tuple[Size | None, int]:
    """The size from a JPEG's frame header, and where its compressed data begin; 0 where they do not."""
    at, size = 2, None
    while at + 4 <= len(data):
        if data[at] != 0xFF:
            return size, 0
        kind = data[at + 1]
        if kind == 0xFF:
            at += 1
            continue
        if kind in (0x01, *range(0xD0, 0xD9)):
            at += 2
            continue
        length = int.from_bytes(data[at + 2 : at + 4], "big")
        if 0xC0 <= kind <= 0xCF and kind not in (0xC4, 0xC8, 0xCC) and at + 9 <= len(data):
            height, width = struct.unpack_from(">HH", data, at + 5)
            size = (width, height)
        if kind == 0xDA:
            return size, at + 2 + length
        at += 2 + max(length, 2)
    return size, 0


def _jpeg(data: bytes) -> Size | None:
    return jpeg_segments(data)[0]


def _tiff(data: bytes) -> Size | None:
    order = "<" if data.startswith(b"II") else ">"
    at = struct.unpack_from(order + "I", data, 4)[0]
    count = struct.unpack_from(order + "H", data, at)[0]
    found: dict[int, int] = {}
    for i in range(min(count, 200)):
        tag, kind, _, value = struct.unpack_from(order + "HHI4s", data, at + 2 + 12 * i)
        if tag in (256, 257):
            found[tag] = struct.unpack(order + ("H" if kind == 3 else "I"), value[: 2 if kind == 3 else 4])[0]
    return (found[256], found[257]) if len(found) == 2 else None


def _webp(data: bytes) -> Size | None:
    kind = data[12:16]
    if kind == b"VP8X":
        width, height = (int.from_bytes(data[i : i + 3], "little") + 1 for i in (24, 27))
        return width, height
    if kind == b"VP8L":
        bits = int.from_bytes(data[21:25], "little")
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    if kind == b"VP8 ":
        width, height = struct.unpack_from("<HH", data, 26)
        return width & 0x3FFF, height & 0x3FFF
    return None
