"""The fast way to unpack a grey PNG gives what the general decoder gives, or says that it cannot."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from stereocalib_core.numeric.arrays import Grey
from stereocalib_core.sources.pictures import UnreadablePicture, decode
from stereocalib_core.sources.png import decode_grey8


def chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(image: Grey, rows: bytes, header: bytes = bytes([8, 0, 0, 0, 0]), parts: int = 1) -> bytes:
    """A PNG by the letter of its specification, its compressed rows cut into `parts` chunks."""
    height, width = image.shape
    packed = zlib.compress(rows)
    cuts = np.linspace(0, len(packed), parts + 1).astype(int)
    data = b"".join(chunk(b"IDAT", packed[a:b]) for a, b in zip(cuts[:-1], cuts[1:], strict=True))
    head = struct.pack(">II", width, height) + header
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + data + chunk(b"IEND", b"")


def filtered(image: Grey, kinds: list[int]) -> bytes:
    """Rows filtered by the formulas of the specification, slowly."""
    out = bytearray()
    for y, row in enumerate(image.astype(int)):
        out.append(kinds[y])
        above = image[y - 1].astype(int) if y else np.zeros_like(row)
        for x, value in enumerate(row):
            a, b = (row[x - 1] if x else 0), above[x]
            c = above[x - 1] if x else 0
            p = a + b - c
            paeth = min((abs(p - a), 0, a), (abs(p - b), 1, b), (abs(p - c), 2, c))[2]
            out.append((value - [0, a, b, (a + b) // 2, paeth][kinds[y]]) % 256)
    return bytes(out)


@pytest.mark.parametrize("parts", [1, 3])
def test_every_filter(parts: int) -> None:
    rng = np.random.default_rng(3)
    image = rng.integers(0, 256, (25, 17), dtype=np.uint8)
    data = png(image, filtered(image, [(k * 2 + 1) % 5 for k in range(25)]), parts=parts)
    found = decode_grey8(data)
    assert found is not None
    np.testing.assert_array_equal(found, image)
    np.testing.assert_array_equal(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE), image)


def test_other_kinds_are_left_to_the_general_decoder() -> None:
    rng = np.random.default_rng(4)
    for image in (
        rng.integers(0, 256, (9, 8, 3), dtype=np.uint8),
        rng.integers(0, 2**16, (9, 8), dtype=np.uint16),
    ):
        data = cv2.imencode(".png", image)[1].tobytes()
        assert decode_grey8(data) is None
        assert decode(data).shape == (9, 8)


def test_rows_that_are_too_few_or_damaged_are_named() -> None:
    image = np.zeros((6, 5), dtype=np.uint8)
    rows = filtered(image, [0] * 6)
    for data in (
        png(image, rows[:-1]),
        png(image, rows + b"\0"),
        png(image, b"\7" + rows[1:]),
        png(image, rows).replace(zlib.compress(rows)[-4:], b"\0\0\0\1"),
    ):
        with pytest.raises(UnreadablePicture, match="damaged PNG"):
            decode(data)


def test_libpng_has_nothing_to_say(capfd: pytest.CaptureFixture[str]) -> None:
    """Its lines on stderr would go through those of a run."""
    rng = np.random.default_rng(5)
    image = rng.integers(0, 256, (9, 8, 3), dtype=np.uint8)
    deep = rng.integers(0, 2**16, (9, 8), dtype=np.uint16)
    profile = chunk(b"iCCP", b"wrong\0\0" + zlib.compress(b"no profile"))
    for picture in (image, deep):
        data = cv2.imencode(".png", picture)[1].tobytes()
        with_profile = data[:33] + profile + data[33:]
        np.testing.assert_array_equal(decode(with_profile), decode(data))
    grey = np.zeros((6, 5), dtype=np.uint8)
    rows = b"\0" * 6 * 16
    kinds = {
        "rgb": bytes([8, 2, 0, 0, 0]),
        "palette": bytes([8, 3, 0, 0, 0]),
        "depth 3": bytes([3, 0, 0, 0, 0]),
    }
    for data in (
        png(grey, rows[:-1], kinds["rgb"]),
        png(grey, b"\7" + rows[1:], kinds["rgb"]),
        png(grey, rows, kinds["rgb"]).replace(zlib.compress(rows)[2:5], b"\xff\xff\xff"),
        png(grey, rows[:36], kinds["palette"]),
        png(grey, rows, kinds["depth 3"]),
    ):
        with pytest.raises(UnreadablePicture):
            decode(data)
    assert capfd.readouterr() == ("", "")


def test_real_pictures(kitti_06: Path, data_dir: Path) -> None:
    for path in (kitti_06 / "image_0" / "000007.png", data_dir / "karlsruhe" / "left"):
        path = next(iter(sorted(path.glob("*.png")))) if path.is_dir() else path
        data = path.read_bytes()
        general = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
        np.testing.assert_array_equal(decode_grey8(data), general)
