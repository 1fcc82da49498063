"""KITTI odometry folders: what is there is used, what is missing is said, nothing shifts."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from drive_writer import (
    BASELINE,
    CX,
    FOCAL,
    HEIGHT,
    WIDTH,
    odometry_drive,
    picture,
    poses_text,
    write_picture,
)

from stereocalib_core.errors import FailureReason, SourceError
from stereocalib_core.frames import StereoFrame
from stereocalib_core.sources import SourceKind, open_source, prefetch, source_kind


def marks(frame: StereoFrame) -> tuple[int, int, int, int]:
    """Frame number and side written into both pictures."""
    assert frame.left is not None
    assert frame.right is not None
    return (*map(int, frame.left[0, :2]), *map(int, frame.right[0, :2]))  # type: ignore[return-value]


def test_reads_camera_times_poses_and_pictures(tmp_path: Path) -> None:
    source = open_source(str(odometry_drive(tmp_path, frames=6, poses=6)))
    assert source_kind(str(tmp_path / "sequences" / "00")) is SourceKind.KITTI_ODOMETRY
    assert len(source) == 6
    assert source.notices == ()
    camera = source.camera
    assert (camera.width, camera.height, camera.focal_px, camera.cx_px) == (WIDTH, HEIGHT, FOCAL, CX)
    assert camera.baseline_m == pytest.approx(BASELINE, abs=1e-12)
    assert camera.disparity_offset_px == 0.0
    np.testing.assert_allclose(source.timestamps_s, 0.1 * np.arange(6), atol=1e-12)
    assert source.ground_truth is not None
    assert source.ground_truth.poses is not None
    np.testing.assert_allclose(source.ground_truth.poses[:, 2, 3], np.arange(6))
    for i in range(6):
        assert marks(source[i]) == (i, 0, i, 1)
    np.testing.assert_array_equal(source[3].left, picture(3, "left"))


def test_lists_longer_than_the_pictures_are_cut(tmp_path: Path) -> None:
    source = open_source(str(odometry_drive(tmp_path, frames=4, poses=9, times=12)))
    assert source.timestamps_s.shape == (4,)
    assert source.ground_truth is not None
    assert source.ground_truth.poses is not None
    assert source.ground_truth.poses.shape == (4, 4, 4)
    assert source.notices == ()


def test_lists_shorter_than_the_pictures_end_in_unknown_and_say_so(tmp_path: Path) -> None:
    source = open_source(str(odometry_drive(tmp_path, frames=6, poses=4, times=3)))
    truth = source.ground_truth
    assert truth is not None
    assert truth.poses is not None
    assert np.isfinite(truth.poses).all(axis=(1, 2)).tolist() == [True] * 4 + [False] * 2
    np.testing.assert_allclose(source.timestamps_s, 0.1 * np.arange(6), atol=1e-12)
    assert any("4 of 6" in notice for notice in source.notices)
    assert any("ends after 3 of 6" in notice for notice in source.notices)


def test_without_truth_or_times_it_still_opens_and_says_so(tmp_path: Path) -> None:
    sequence = odometry_drive(tmp_path)
    (sequence / "times.txt").unlink()
    source = open_source(str(sequence))
    assert source.ground_truth is None
    assert len(source.notices) == 2


def test_a_missing_right_picture_is_one_failed_frame_and_shifts_nothing(tmp_path: Path) -> None:
    sequence = odometry_drive(tmp_path)
    (sequence / "image_1" / "000002.png").unlink()
    source = open_source(str(sequence))
    assert len(source) == 6
    failure = source[2].failure
    assert failure is not None
    assert failure.reason is FailureReason.MISSING_PAIR
    assert marks(source[3]) == (3, 0, 3, 1)
    assert any("000002" in notice for notice in source.notices)


def test_a_number_missing_on_both_sides_keeps_its_place(tmp_path: Path) -> None:
    sequence = odometry_drive(tmp_path, poses=6)
    for side in ("image_0", "image_1"):
        (sequence / side / "000002.png").unlink()
    source = open_source(str(sequence))
    assert len(source) == 6
    assert source[2].failure is not None
    assert source[2].failure.reason is FailureReason.MISSING_PAIR
    assert marks(source[3]) == (3, 0, 3, 1)
    assert source.timestamps_s[3] == pytest.approx(0.3)


def test_a_right_list_that_ends_early_shortens_the_drive(tmp_path: Path) -> None:
    sequence = odometry_drive(tmp_path)
    for i in (4, 5):
        (sequence / "image_1" / f"{i:06d}.png").unlink()
    source = open_source(str(sequence))
    assert len(source) == 4
    assert any("2 pictures of image_0 have no partner" in notice for notice in source.notices)


def test_a_drive_cut_at_its_start_keeps_its_lines(tmp_path: Path) -> None:
    sequence = odometry_drive(tmp_path, poses=6)
    for i in (0, 1):
        (sequence / "image_0" / f"{i:06d}.png").unlink()
    source = open_source(str(sequence))
    assert len(source) == 4
    assert source.timestamps_s[0] == pytest.approx(0.2)
    assert marks(source[0]) == (2, 0, 2, 1)
    assert source.ground_truth is not None
    assert source.ground_truth.poses is not None
    np.testing.assert_allclose(source.ground_truth.poses[:, 2, 3], np.arange(4))


def test_damaged_pictures_fail_alone(tmp_path: Path) -> None:
    sequence = odometry_drive(tmp_path, frames=9)
    whole = (sequence / "image_0" / "000001.png").read_bytes()
    (sequence / "image_0" / "000001.png").write_bytes(whole[: len(whole) // 2])
    (sequence / "image_1" / "000002.png").write_bytes(b"")
    flipped = bytearray(whole)
    flipped[len(whole) // 2] ^= 0x55
    (sequence / "image_0" / "000003.png").write_bytes(bytes(flipped))
    (sequence / "image_1" / "000004.png").write_text("no picture at all")
    write_picture(sequence / "image_1" / "000005.png", picture(5, "right", WIDTH - 8))
    source = open_source(str(sequence))
    reasons = [frame.failure.reason if frame.failure else None for frame in map(source.__getitem__, range(9))]
    unreadable, size = FailureReason.UNREADABLE, FailureReason.SIZE_MISMATCH
    assert reasons == [None, unreadable, unreadable, unreadable, unreadable, size, None, None, None]
    assert source[5].left is None
    assert source[5].failure is not None
    assert "88x64" in source[5].failure.detail


def test_a_picture_that_claims_to_be_enormous_is_not_unpacked(tmp_path: Path) -> None:
    import struct
    import zlib

    sequence = odometry_drive(tmp_path)
    path = sequence / "image_0" / "000002.png"
    data = bytearray(path.read_bytes())
    data[16:24] = struct.pack(">II", 300000, 300000)
    data[29:33] = struct.pack(">I", zlib.crc32(bytes(data[12:29])))
    path.write_bytes(bytes(data))
    failure = open_source(str(sequence))[2].failure
    assert failure is not None
    assert failure.reason is FailureReason.SIZE_MISMATCH


def test_colour_and_deep_pictures_become_8_bit_grey(tmp_path: Path) -> None:
    sequence = odometry_drive(tmp_path, frames=3)
    grey = picture(1, "left")
    for side in ("image_0", "image_1"):
        for i in range(3):
            deep = grey.astype(np.uint16) << 4  # a 12-bit sensor in 16-bit files
            cv2.imwrite(str(sequence / side / f"{i:06d}.png"), deep)
    source = open_source(str(sequence))
    np.testing.assert_array_equal(source[1].left, grey)
    for side in ("image_0", "image_1"):
        for i in range(3):
            cv2.imwrite(str(sequence / side / f"{i:06d}.png"), cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR))
    colour = open_source(str(sequence))[1].left
    assert colour is not None
    assert colour.dtype == np.uint8
    np.testing.assert_allclose(colour, grey, atol=1)


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("P0: nan 0 1 0 0 1 1 0 0 0 1 0\n", "P0"),
        ("P0: 1 2 3\n", "P0"),
        ("", "no P0"),
        ("P0: 80 0 47 0 0 80 31 0 0 0 1 0\nP1: 80 0 47 0 0 80 31 0 0 0 1 0\n", "baseline"),
        ("P0: 80 0 47 0 0 80 31 0 0 0 1 0\nP1: 80 0 47 40 0 80 31 0 0 0 1 0\n", "baseline"),
        ("P0: 0 0 47 0 0 80 31 0 0 0 1 0\nP1: 80 0 47 -40 0 80 31 0 0 0 1 0\n", "focal"),
        ("P0: 80 0 47000 0 0 80 31 0 0 0 1 0\nP1: 80 0 47 -40 0 80 31 0 0 0 1 0\n", "principal point"),
    ],
)
def test_a_bad_calibration_is_one_clear_line(tmp_path: Path, text: str, part: str) -> None:
    sequence = odometry_drive(tmp_path)
    (sequence / "calib.txt").write_text(text)
    with pytest.raises(SourceError) as caught:
        open_source(str(sequence))
    assert part in str(caught.value)
    assert "\n" not in str(caught.value)
    assert "calib.txt" in str(caught.value)


def test_a_bad_pose_or_time_is_a_note_that_names_its_line(tmp_path: Path) -> None:
    sequence = odometry_drive(tmp_path, poses=6)
    (tmp_path / "poses" / "00.txt").write_text(poses_text(2) + "1 2 three\n")
    (sequence / "times.txt").write_text("0\n0.1\nsoon\n")
    source = open_source(str(sequence))
    assert source.ground_truth is None
    assert any("00.txt" in note and "line 3" in note for note in source.notices)
    assert any("times.txt" in note and "line 3" in note for note in source.notices)
    np.testing.assert_allclose(source.timestamps_s, np.arange(6) / 10)


def test_a_damaged_place_of_the_lidar_is_a_note(tmp_path: Path) -> None:
    sequence = odometry_drive(tmp_path)
    (sequence / "velodyne").mkdir()
    for i in range(6):
        np.ones((30, 4), np.float32).tofile(sequence / "velodyne" / f"{i:06d}.bin")
    with (sequence / "calib.txt").open("a") as file:
        file.write("Tr: 1 0 0 x 0 1 0 0 0 0 1 0\n")
    source = open_source(str(sequence))
    assert source[3].failure is None
    assert source[3].lidar is None
    assert any("LiDAR is not used" in note for note in source.notices)


def test_times_that_do_not_increase_are_replaced_and_said(tmp_path: Path) -> None:
    sequence = odometry_drive(tmp_path)
    (sequence / "times.txt").write_text("0\n1\n1\n2\n3\n4\n")
    source = open_source(str(sequence))
    np.testing.assert_allclose(source.timestamps_s, np.arange(6) / 10)
    assert any("does not increase" in notice for notice in source.notices)


def test_folders_that_are_no_drive(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "readme").write_text("hello")
    cases = {
        "empty": "the folder is empty",
        "other": "no stereo drive",
        "missing": "no such folder",
        "other/readme": "a file",
    }
    for name, part in cases.items():
        with pytest.raises(SourceError) as caught:
            open_source(str(tmp_path / name))
        assert part in str(caught.value)
    with pytest.raises(SourceError):
        open_source("")


def test_all_right_pictures_of_another_size_are_refused(tmp_path: Path) -> None:
    sequence = odometry_drive(tmp_path)
    for i in range(6):
        write_picture(sequence / "image_1" / f"{i:06d}.png", picture(i, "right", WIDTH + 8))
    with pytest.raises(SourceError, match="do not fit"):
        open_source(str(sequence))


def test_the_content_key_follows_the_content(tmp_path: Path) -> None:
    sequence = odometry_drive(tmp_path)
    before = open_source(str(sequence)).content_key
    assert open_source(str(sequence)).content_key == before
    write_picture(sequence / "image_0" / "000003.png", 255 - picture(3, "left"))
    assert open_source(str(sequence)).content_key != before


def test_prefetch_gives_every_frame_in_order_and_reads_no_further_than_told(tmp_path: Path) -> None:
    source = open_source(str(odometry_drive(tmp_path, frames=9)))
    read: list[int] = []

    class Spy:
        live = False

        def __getitem__(self, index: int) -> StereoFrame:
            read.append(index)
            return source[index]

    frames = prefetch(Spy(), 2, 8, ahead=2)  # type: ignore[arg-type]
    first = next(frames)
    assert first.index == 2
    assert max(read) <= 2 + 2
    assert [frame.index for frame in frames] == [3, 4, 5, 6, 7]
    assert sorted(read) == [2, 3, 4, 5, 6, 7]
    assert list(prefetch(source, 3, 3)) == []


def test_real_drives_open_without_a_word(kitti_06: Path, kitti_03: Path) -> None:
    for folder, count, path_m in ((kitti_06, 51, 59.8), (kitti_03, 99, None)):
        source = open_source(str(folder))
        assert len(source) == count
        assert source.notices == ()
        assert source[count - 1].failure is None
        if path_m is not None:
            assert source.ground_truth is not None
            assert source.ground_truth.poses is not None
            assert source.ground_truth.poses[50, 2, 3] == pytest.approx(path_m, abs=0.1)


def test_the_truth_beside_a_link_comes_before_that_of_its_target(tmp_path: Path) -> None:
    drive = odometry_drive(tmp_path / "there", frames=6, poses=6)
    link = tmp_path / "here" / "sequences" / "00"
    link.parent.mkdir(parents=True)
    link.symlink_to(drive)
    truth = open_source(str(link)).ground_truth
    assert truth is not None and truth.poses is not None and truth.poses[5, 2, 3] == 5.0
    (tmp_path / "here" / "poses").mkdir()
    (tmp_path / "here" / "poses" / "00.txt").write_text(poses_text(6).replace(" 5.0\n", " 7.0\n"))
    truth = open_source(str(link)).ground_truth
    assert truth is not None and truth.poses is not None and truth.poses[5, 2, 3] == 7.0
