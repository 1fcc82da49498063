"""Pictures from files: any common format to 8-bit grey, and damaged files to a reason instead of noise."""

from __future__ import annotations

import os
import struct
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from isal import isal_zlib
from numpy.typing import NDArray

from stereocalib_core.config.reading import MOST_BYTES_OF_A_PICTURE, MOST_PIXELS
from stereocalib_core.errors import Failure, FailureReason, SourceError
from stereocalib_core.sources.picture_size import jpeg_segments, size_of
from stereocalib_core.sources.png import DamagedPng, decode_grey8, for_general_decoder

PICTURE_SUFFIXES = (".png", ".jpg", ".jpeg", ".pgm", ".ppm", ".bmp", ".tif", ".tiff", ".webp")
_FLAGS = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION
"""A camera on a car does not turn over: an orientation that its files claim is ignored."""
_PNG = b"\x89PNG\r\n\x1a\n"
_JPEG = b"\xff\xd8"


@dataclass(frozen=True)
class PictureFormat:
    """What all pictures of a recording share: size in pixels and bits of grey really used (8...16)."""

    width: int
    height: int
    bits: int = 8


class UnreadablePicture(Exception):
    """A picture file that is damaged; `str()` says how. Becomes the `Failure` of its frame."""


def check_png(data: bytes) -> tuple[int, int]:
    """Width and height of a PNG whose chunks are all there and undamaged.

    Checked here because a decoder fills the rest of a cut file with grey, or writes to stderr.
    """
    at, size = len(_PNG), (0, 0)
    while at + 12 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, at)
        end = at + 12 + length
        if end > len(data):
            break
        if isal_zlib.crc32(memoryview(data)[at + 4 : end - 4]) != int.from_bytes(data[end - 4 : end], "big"):
            raise UnreadablePicture(f"damaged PNG, wrong checksum at byte {at}")
        if kind == b"IHDR" and length == 13:
            size = struct.unpack_from(">II", data, at + 8)
        if kind == b"IEND":
            return size
        at = end
    raise UnreadablePicture(f"PNG cut off after {len(data)} bytes")


def read_bytes(path: Path) -> bytes:
    """The bytes of a picture file; raises UnreadablePicture where there are none."""
    try:
        with open(path, "rb") as file:
            # what a picture says it needs is read at once; a file that is larger than any picture is not
            if os.fstat(file.fileno()).st_size > MOST_BYTES_OF_A_PICTURE:
                raise UnreadablePicture(f"over {MOST_BYTES_OF_A_PICTURE >> 20} MB, no picture is that large")
            data = file.read()
    except OSError as error:
        raise UnreadablePicture(error.strerror or "cannot be read") from error
    if not data:
        raise UnreadablePicture("empty file")
    return data


def check_other(data: bytes, size: tuple[int, int] | None) -> None:
    """Refuse what is cut off, of another size, or claims more pixels than any camera has, before it is unpacked."""
    if data.startswith(_JPEG):
        found, start = jpeg_segments(data)
        # the end mark may come before bytes that others have added; in the compressed data it cannot come by chance
        if start == 0 or data.find(b"\xff\xd9", start) < 0:
            raise UnreadablePicture(f"JPEG cut off after {len(data)} bytes")
    else:
        found = size_of(data)
    if found is None:
        return
    if size is not None and found != size:
        raise WrongSize(*found)
    if found[0] * found[1] > MOST_PIXELS:
        raise UnreadablePicture(f"{found[0]}x{found[1]} pixels are too many")


def decode(data: bytes, size: tuple[int, int] | None = None) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """Bytes of a picture file to (H, W) grey, uint8 or uint16 as stored; colour becomes luminance.

    size: the (width, height) expected; a PNG of another size is refused before it is unpacked.
    Raises UnreadablePicture, or WrongSize.
    """
    if data.startswith(_PNG):
        found = check_png(data)
        if size is not None and found != size:
            raise WrongSize(*found)
        if found[0] * found[1] > MOST_PIXELS:
            raise UnreadablePicture(f"{found[0]}x{found[1]} pixels are too many")
        try:
            if (grey := decode_grey8(data)) is not None:
                return grey
            data = for_general_decoder(data)
        except DamagedPng as error:
            raise UnreadablePicture(f"damaged PNG, {error}") from error
    else:
        check_other(data, size)
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), _FLAGS)
    except cv2.error as error:
        raise UnreadablePicture("not a picture that can be decoded") from error
    if image is None or image.dtype not in (np.uint8, np.uint16):
        raise UnreadablePicture("not a picture of 8 or 16 bit that can be decoded")
    if size is not None and (image.shape[1], image.shape[0]) != size:
        raise WrongSize(image.shape[1], image.shape[0])
    return image  # type: ignore[return-value]


class WrongSize(Exception):
    """A picture of another size than the camera's."""

    def __init__(self, width: int, height: int) -> None:
        super().__init__(f"{width}x{height}")


def to_8_bit(image: NDArray[np.uint8] | NDArray[np.uint16], bits: int) -> NDArray[np.uint8]:
    """(H, W) grey to uint8; `bits` is the depth that deeper pictures really use, 12 for a 12-bit sensor."""
    if image.dtype == np.uint8:
        return image  # type: ignore[return-value]
    return np.minimum(image >> (bits - 8), 255).astype(np.uint8)


def read_side(path: Path | None, picture: PictureFormat, side: str) -> NDArray[np.uint8] | Failure:
    """One side of a pair, or why there is none: MISSING_PAIR, UNREADABLE or SIZE_MISMATCH."""
    if path is None:
        return Failure(FailureReason.MISSING_PAIR, f"no {side} picture of this name")
    try:
        return to_8_bit(decode(read_bytes(path), (picture.width, picture.height)), picture.bits)
    except UnreadablePicture as error:
        return Failure(FailureReason.UNREADABLE, f"{side} picture {path.name}: {error}")
    except WrongSize as error:
        detail = f"{side} picture {path.name} is {error}, the camera {picture.width}x{picture.height}"
        return Failure(FailureReason.SIZE_MISMATCH, detail)


def survey(paths: Sequence[Path], where: Path) -> PictureFormat:
    """The format most of a recording's pictures have, from up to nine of them evenly spread.

    Raises SourceError when none of them can be read.
    """
    sizes: Counter[tuple[int, int]] = Counter()
    peak, last = 0, "check the file names"
    for i in sorted({int(i) for i in np.linspace(0, len(paths) - 1, 9).round()} if paths else ()):
        try:
            image = decode(read_bytes(paths[i]))
        except UnreadablePicture as error:
            last = f"{paths[i].name}: {error}"
            continue
        sizes[(image.shape[1], image.shape[0])] += 1
        peak = max(peak, int(image.max()) if image.dtype == np.uint16 else 0)
    if not sizes:
        raise SourceError("no picture can be read", where, last)
    (width, height), _ = sizes.most_common(1)[0]
    return PictureFormat(width, height, max(8, -(-peak.bit_length() // 2) * 2))
