"""8-bit grey PNG, which nearly all recordings are made of: unpacked in a quarter of a general decoder's time.

Inflating is `isal`'s, undoing the row filters (PNG specification, section 9) is one compiled pass. What is not plain
(palettes, 16 bit, interlacing, transparency) is left to the general decoder.
"""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
from isal import isal_zlib
from numba import njit

from stereocalib_core.numeric.arrays import Grey

_GREY8 = struct.pack(">BBBBB", 8, 0, 0, 0, 0)
"""Bit depth 8, colour type grey, deflate, the standard filters, not interlaced."""

_INFLATE_ERROR: Any = isal_zlib.error


class DamagedPng(Exception):
    """The compressed rows do not make the picture that the header announces."""


@njit(cache=True, nogil=True)
def _unfilter(rows: Grey, image: Grey) -> bool:
    """(H, 1 + W) filter type and filtered bytes per row to (H, W); False = a filter that does not exist."""
    height, width = image.shape
    for y in range(height):
        kind, row = rows[y, 0], rows[y, 1:]
        out = image[y]
        if kind == 0:
            for x in range(width):
                out[x] = row[x]
        elif kind == 1:
            left: Any = np.uint8(0)
            for x in range(width):
                left = np.uint8(row[x] + left)
                out[x] = left
        elif kind == 2:
            for x in range(width):
                out[x] = row[x] + (image[y - 1, x] if y > 0 else np.uint8(0))
        elif kind == 3:
            left = 0
            for x in range(width):
                up = int(image[y - 1, x]) if y > 0 else 0
                left = (row[x] + ((left + up) >> 1)) & 255
                out[x] = left
        elif kind == 4:
            left, corner = 0, 0
            for x in range(width):
                up = int(image[y - 1, x]) if y > 0 else 0
                p = left + up - corner
                pa, pb, pc = abs(p - left), abs(p - up), abs(p - corner)
                best = left if pa <= pb and pa <= pc else (up if pb <= pc else corner)
                left = (row[x] + best) & 255
                out[x] = left
                corner = up
        else:
            return False
    return True


def decode_grey8(data: bytes) -> Grey | None:
    """Bytes of a PNG whose chunks are known to be whole to (H, W) uint8; None = not a plain 8-bit grey picture.

    Raises DamagedPng.
    """
    width, height = struct.unpack_from(">II", data, 16)
    if data[24:29] != _GREY8:
        return None
    parts, at = [], 8
    while at + 12 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, at)
        if kind == b"tRNS":
            return None
        if kind == b"IDAT":
            parts.append(memoryview(data)[at + 8 : at + 8 + length])
        at += 12 + length
    size = height * (width + 1)
    unpacker = isal_zlib.decompressobj()
    try:
        packed = parts[0] if len(parts) == 1 else b"".join(parts)
        raw = unpacker.decompress(packed, size)
        whole = len(raw) == size and (unpacker.eof or not unpacker.decompress(unpacker.unconsumed_tail, 1))
    except _INFLATE_ERROR as error:
        raise DamagedPng(str(error)) from error
    image = np.empty((height, width), dtype=np.uint8)
    if not whole or not _unfilter(np.frombuffer(raw, np.uint8).reshape(height, width + 1), image):
        raise DamagedPng("its rows are not whole")
    return image


_CHANNELS = {
    0: (1, (1, 2, 4, 8, 16)),
    2: (3, (8, 16)),
    3: (1, (1, 2, 4, 8)),
    4: (2, (8, 16)),
    6: (4, (8, 16)),
}
"""Samples of a pixel and their depths, by colour type (PNG specification, table 11.1)."""
_CRITICAL = (b"IHDR", b"PLTE", b"IDAT", b"IEND", b"tRNS")


def for_general_decoder(data: bytes) -> bytes:
    """A PNG whose chunks are known to be whole, with nothing in it that libpng would write to stderr about.

    Chunks that do not touch the pixels (colour profiles, texts, times) are left out. Raises DamagedPng.
    """
    width, height, depth, colour, _, _, interlaced = struct.unpack_from(">IIBBBBB", data, 16)
    channels, depths = _CHANNELS.get(colour, (0, ()))
    if depth not in depths or interlaced > 1 or data[26:28] != b"\0\0":
        raise DamagedPng("no such kind of pixels")
    kept, packed, at = [data[:8]], [], 8
    while at + 12 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, at)
        if kind in _CRITICAL:
            kept.append(data[at : at + 12 + length])
        if kind == b"IDAT":
            packed.append(data[at + 8 : at + 8 + length])
        if kind == b"IEND":
            break
        at += 12 + length
    if colour == 3 and not any(chunk[4:8] == b"PLTE" for chunk in kept):
        raise DamagedPng("no palette")
    row = 1 + (width * channels * depth + 7) // 8
    size = height * row if not interlaced else 2 * (height + 8) * (row + 8)
    unpacker = isal_zlib.decompressobj()
    try:
        raw = unpacker.decompress(b"".join(packed), size + 1)
    except _INFLATE_ERROR as error:
        raise DamagedPng(str(error)) from error
    if not interlaced and (len(raw) != size or max(raw[::row]) > 4):
        raise DamagedPng("its rows are not whole")
    return b"".join(kept)


def warm_up() -> None:
    """Compile what this module compiles."""
    _unfilter(np.zeros((1, 2), dtype=np.uint8), np.zeros((1, 1), dtype=np.uint8))
