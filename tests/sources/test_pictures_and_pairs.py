"""Pictures as other programs leave them, and which left one belongs to which right one."""

from __future__ import annotations

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
from drive_writer import CAMERA_YAML, HEIGHT, WIDTH, odometry_drive, picture, plain_drive, write_picture

from stereocalib_core.errors import FailureReason, SourceError
from stereocalib_core.sources import open_source


def _smooth(frame: int) -> np.ndarray:
    image = np.random.default_rng(frame).integers(0, 256, (HEIGHT, WIDTH)).astype(np.uint8)
    return cv2.GaussianBlur(image, (0, 0), 4)


def _jpegs(folder: Path, change: object) -> None:
    for side in ("left", "right"):
        for i in range(5):
            (folder / side / f"{i:03d}.png").unlink()
            data = cv2.imencode(".jpg", _smooth(i), [cv2.IMWRITE_JPEG_QUALITY, 98])[1].tobytes()
            (folder / side / f"{i:03d}.jpg").write_bytes(change(data))  # type: ignore[operator]


def _exif(data: bytes) -> bytes:
    """An EXIF block that says: turn by 180 degrees."""
    tiff = b"II*\0" + struct.pack("<IHHHIHHI", 8, 1, 0x0112, 3, 1, 3, 0, 0)
    block = b"Exif\0\0" + tiff
    return data[:2] + b"\xff\xe1" + struct.pack(">H", len(block) + 2) + block + data[2:]


@pytest.mark.parametrize("change", [lambda d: d + b"\0" * 500, lambda d: d + b"maker's own bytes" * 9, _exif])
def test_jpegs_with_bytes_after_their_end_or_an_orientation(tmp_path: Path, change: object) -> None:
    folder = plain_drive(tmp_path)
    _jpegs(folder, change)
    source = open_source(str(folder))
    for i in range(5):
        left = source[i].left
        assert left is not None, source[i].failure
        assert np.abs(left.astype(int) - _smooth(i)).max() < 12


def test_a_jpeg_that_is_cut_off_fails_even_with_a_preview_inside(tmp_path: Path) -> None:
    folder = plain_drive(tmp_path)
    preview = cv2.imencode(".jpg", _smooth(9)[:16, :16])[1].tobytes()
    block = b"Exif\0\0" + preview
    _jpegs(folder, lambda d: d[:2] + b"\xff\xe1" + struct.pack(">H", len(block) + 2) + block + d[2:])
    path = folder / "left" / "002.jpg"
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
    source = open_source(str(folder))
    assert source[1].failure is None
    failure = source[2].failure
    assert failure is not None and failure.reason is FailureReason.UNREADABLE
    assert "cut off" in failure.detail


@pytest.mark.parametrize(
    "header", [b"P5\n60000 60000\n255\n", b"BM" + b"\0" * 12 + struct.pack("<Iii", 40, 60000, 60000)]
)
def test_pictures_that_claim_to_be_enormous_are_not_unpacked(tmp_path: Path, header: bytes) -> None:
    folder = plain_drive(tmp_path)
    (folder / "left" / "002.png").write_bytes(header + b"\0" * 100)
    failure = open_source(str(folder))[2].failure
    assert failure is not None
    assert failure.reason in (FailureReason.SIZE_MISMATCH, FailureReason.UNREADABLE)


@pytest.mark.parametrize(
    "names",
    [
        ("left01", "right01"), ("left_1", "right_1"), ("1_L", "1_R"), ("frame_l_1", "frame_r_1"), ("cam0_1", "cam1_1"),
        ("IMG_LEFT_1", "IMG_RIGHT_1"), ("1-left", "1-right"),
    ],
)  # fmt: skip
def test_both_cameras_in_one_folder(tmp_path: Path, names: tuple[str, str]) -> None:
    for i in range(12):
        for side, name in zip(("left", "right"), names, strict=True):
            head, _, tail = name.rpartition("1") if not name.startswith("1") else ("", "", name[1:])
            write_picture(tmp_path / f"{head}{i}{tail}.png", picture(i, side))
    (tmp_path / "camera.yaml").write_text(CAMERA_YAML)
    source = open_source(str(tmp_path))
    assert len(source) == 12
    for i in range(12):
        left, right = source[i].left, source[i].right
        assert left is not None and right is not None
        assert (left[0, 0], left[0, 1], right[0, 0], right[0, 1]) == (i, 0, i, 1)


@pytest.mark.parametrize(
    "folders",
    [
        ("Left", "Right"), ("LEFT", "RIGHT"), ("L", "R"), ("cam0", "cam1"), ("cam_1", "cam_2"),
        ("image_left", "image_right"), ("image_02", "image_03"), ("leftImg8bit", "rightImg8bit"),
        ("left/data", "right/data"), ("images/left", "images/right"),
    ],
)  # fmt: skip
def test_both_cameras_in_two_folders(tmp_path: Path, folders: tuple[str, str]) -> None:
    for i in range(3):
        for side, name in zip(("left", "right"), folders, strict=True):
            write_picture(tmp_path / name / f"{i:04d}.png", picture(i, side))
    (tmp_path / "camera.yaml").write_text(CAMERA_YAML)
    source = open_source(str(tmp_path))
    left, right = source[2].left, source[2].right
    assert left is not None and right is not None
    assert (left[0, 0], left[0, 1], right[0, 0], right[0, 1]) == (2, 0, 2, 1)


def test_pictures_are_paired_by_number_where_names_differ(tmp_path: Path) -> None:
    folder = plain_drive(tmp_path)
    for i, path in enumerate(sorted((folder / "right").iterdir())):
        path.rename(path.with_name(f"shot{i}.png"))
    source = open_source(str(folder))
    right = source[3].right
    assert right is not None and right[0, 0] == 3
    assert any("paired by their numbers" in note for note in source.notices)


def test_stamps_are_paired_with_the_nearest_and_the_rest_is_counted(tmp_path: Path) -> None:
    start, step = 1403636579763555584, 50_000_000
    folder = plain_drive(tmp_path, [str(start + step * i) for i in range(8)])
    for i, path in enumerate(sorted((folder / "right").iterdir())):
        late = {3: step * 0.7, 6: None}.get(i, step * 0.2)
        if late is None:
            path.unlink()
        else:
            path.rename(path.with_name(f"{start + step * i + int(late)}.png"))
    # the left one of 5 and the right one of 6 are missing: what is left of both lies 0.8 of a period apart
    (folder / "left" / f"{start + step * 5}.png").unlink()
    source = open_source(str(folder))
    pairs = [
        (f.left[0, 0], f.right[0, 0])
        for f in map(source.__getitem__, range(len(source)))
        if f.left is not None
    ]
    # the right picture of frame 3 comes nearer to frame 4, whose own is nearer still: both of its own kind are alone
    assert [(int(a), int(b)) for a, b in pairs] == [(0, 0), (1, 1), (2, 2), (4, 4), (7, 7)]
    assert any("names are times" in note for note in source.notices)
    assert any("lack one side" in note for note in source.notices)
    assert source.epoch_s == start // 10**9
    assert source.timestamps_s[0] == start % 10**9 / 1e9


@pytest.mark.parametrize("scale", [0.5, 0.8, 2.0])
def test_a_calibration_of_other_pictures_is_named_with_the_scale(tmp_path: Path, scale: float) -> None:
    """Pictures resized, calibration not: the file's own size says so, else its principal point."""
    size = round(WIDTH * scale), round(HEIGHT * scale)
    folder = plain_drive(tmp_path / "plain")
    for side in ("left", "right"):
        for path in (folder / side).iterdir():
            write_picture(path, cv2.resize(cv2.imread(str(path), 0), size, interpolation=cv2.INTER_AREA))
    with pytest.raises(SourceError) as caught:
        open_source(str(folder))
    text = str(caught.value)
    assert f"{size[0]}x{size[1]}" in text and f"{WIDTH}x{HEIGHT}" in text and f"by {scale:g}" in text
    sequence = odometry_drive(tmp_path / "kitti")
    for side in ("image_0", "image_1"):
        for path in (sequence / side).iterdir():
            write_picture(path, cv2.resize(cv2.imread(str(path), 0), size, interpolation=cv2.INTER_AREA))
    with pytest.raises(SourceError, match=rf"another size.*by {scale:.2f}"):
        open_source(str(sequence))


def test_pictures_squeezed_to_half_their_width_are_named(tmp_path: Path) -> None:
    sequence = odometry_drive(tmp_path / "kitti")
    for side in ("image_0", "image_1"):
        for path in (sequence / side).iterdir():
            write_picture(path, cv2.resize(cv2.imread(str(path), 0), (WIDTH // 2, HEIGHT)))
    with pytest.raises(
        SourceError, match=r"squeezed.* of the width of .*stretch the pictures to a width of about"
    ):
        open_source(str(sequence))


def test_what_is_missing_is_named(tmp_path: Path) -> None:
    dead = tmp_path / "dead"
    dead.mkdir()
    (dead / "left").symlink_to(tmp_path / "gone")
    with pytest.raises(SourceError, match="link to nothing"):
        open_source(str(dead))
    one = odometry_drive(tmp_path / "one")
    for path in (one / "image_1").iterdir():
        path.unlink()
    with pytest.raises(SourceError, match=r"image_1.*expected left and right"):
        open_source(str(one))
