"""KITTI raw drives: partial downloads, OXTS truth, LiDAR in the rectified left camera's frame."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from drive_writer import raw_drive

from stereocalib_core.errors import FailureReason, SourceError
from stereocalib_core.sources import SourceKind, open_source, source_kind


def test_reads_everything(tmp_path: Path) -> None:
    drive = raw_drive(tmp_path, frames=12, oxts=20, scans=3)
    source = open_source(str(drive))
    assert source_kind(str(drive)) is SourceKind.KITTI_RAW
    assert len(source) == 12
    np.testing.assert_allclose(source.timestamps_s, 0.1 * np.arange(12), atol=1e-9)
    truth = source.ground_truth
    assert truth is not None
    assert truth.poses is not None
    assert not truth.heading_reliable
    # The car drives along its own x; the camera looks along it, so its z advances by 1 m a frame.
    np.testing.assert_allclose(truth.poses[:, 2, 3], np.arange(12), atol=1e-3)
    np.testing.assert_allclose(truth.poses[:, :2, 3], 0, atol=1e-3)
    assert [source[i].lidar is not None for i in range(5)] == [True, True, True, False, False]
    assert any("3 of 12" in notice for notice in source.notices)


def test_a_car_that_turns_right_goes_right(tmp_path: Path) -> None:
    """Longitude, latitude and yaw (from east, counter-clockwise) of a right bend: x and heading of the camera grow."""
    drive = raw_drive(tmp_path, frames=10, oxts=10)
    turned = np.deg2rad(4.0) * np.arange(10)
    east, north = np.cumsum(np.cos(turned)), -np.cumsum(np.sin(turned))
    for i, file in enumerate(sorted((drive / "oxts" / "data").iterdir())):
        packet = [float(value) for value in file.read_text().split()]
        packet[0] += np.rad2deg(north[i] / 6378137.0)
        packet[1] = 8.4 + np.rad2deg(east[i] / (6378137.0 * np.cos(np.deg2rad(49.0))))
        packet[5] = -turned[i]
        file.write_text(" ".join(repr(float(value)) for value in packet))
    truth = open_source(str(drive)).ground_truth
    assert truth is not None and truth.poses is not None
    # the camera stands 1.1 m before the IMU and 0.3 m right of it, so that it swings along
    x, z = truth.poses[:, 0, 3], truth.poses[:, 2, 3]
    camera = np.array([0.3 + 0.8, -0.3])
    c, s = np.cos(-turned), np.sin(-turned)
    forward = east + c * camera[0] - s * camera[1]
    left = north + s * camera[0] + c * camera[1]
    np.testing.assert_allclose(z, forward - forward[0], atol=5e-3)
    np.testing.assert_allclose(x, -(left - left[0]), atol=5e-3)
    assert x[-1] > 2.0
    heading = np.arctan2(truth.poses[:, 0, 2], truth.poses[:, 2, 2])
    np.testing.assert_allclose(heading, turned, atol=1e-6)


def test_lidar_points_land_in_the_left_camera(tmp_path: Path) -> None:
    T = open_source(str(raw_drive(tmp_path, scans=1))).T_camera_lidar
    assert T is not None
    np.testing.assert_allclose(T @ [10.0, 0, 0, 1], [0.0, -0.1, 9.7, 1], atol=1e-9)


def test_a_missing_right_picture_shifts_nothing(tmp_path: Path) -> None:
    drive = raw_drive(tmp_path, frames=6)
    (drive / "image_01" / "data" / "0000000002.png").unlink()
    source = open_source(str(drive))
    assert source[2].failure is not None
    assert source[2].failure.reason is FailureReason.MISSING_PAIR
    frame = source[3]
    assert frame.left is not None
    assert frame.right is not None
    assert (int(frame.left[0, 0]), int(frame.right[0, 0])) == (3, 3)


@pytest.mark.parametrize(
    ("there", "broken", "taken"),
    [
        ((0, 1, 2, 3), 1, (2, 3)),
        ((0, 1, 2, 3), 3, (0, 1)),
        ((0, 1, 2, 3), None, (0, 1)),
        ((2, 3), None, (2, 3)),
        ((0, 3), None, (0, 3)),
        ((1, 2), None, (2, 1)),
        ((0, 2, 3), None, (2, 3)),
    ],
    ids=lambda case: "".join(map(str, case)) if isinstance(case, tuple) else str(case),
)
def test_the_pair_that_is_whole_is_taken_with_its_own_projections(
    tmp_path: Path, there: tuple[int, ...], broken: int | None, taken: tuple[int, int]
) -> None:
    """Grey and colour cameras in any mixture, one with a picture missing."""
    drive = raw_drive(tmp_path, frames=4)
    calibration = drive.parent / "calib_cam_to_cam.txt"
    at_px = {0: 0.0, 1: -387.0, 2: 44.0, 3: -339.0}
    lines = [line for line in calibration.read_text().splitlines() if not line.startswith("P_rect")]
    f, cx, cy = 721.5, open_source(str(drive)).camera.cx_px, open_source(str(drive)).camera.cy_px
    lines += [f"P_rect_0{k}: {f} 0 {cx} {at} 0 {f} {cy} 0 0 0 1 0" for k, at in at_px.items()]
    calibration.write_text("\n".join(lines) + "\n")
    for k in (2, 3):
        shutil.copytree(drive / f"image_0{k - 2}", drive / f"image_0{k}")
    for k in {0, 1, 2, 3} - set(there):
        shutil.rmtree(drive / f"image_0{k}")
    if broken is not None:
        (drive / f"image_0{broken}" / "data" / "0000000002.png").unlink()
    source = open_source(str(drive))
    assert len(source) == 4
    assert all(source[i].failure is None for i in range(4))
    assert source.camera.baseline_m == pytest.approx((at_px[taken[0]] - at_px[taken[1]]) / f)
    told = f"pictures of image_0{taken[0]} and image_0{taken[1]}"
    assert (told in source.notices) == (taken != (0, 1))


def test_without_oxts_or_lidar_or_their_calibration(tmp_path: Path) -> None:
    drive = raw_drive(tmp_path, frames=6, oxts=6, scans=2)
    for name in ("calib_velo_to_cam.txt", "calib_imu_to_velo.txt"):
        (drive.parent / name).unlink()
    source = open_source(str(drive))
    assert source.ground_truth is None
    assert source.T_camera_lidar is None
    assert source[0].lidar is None
    assert any("no ground truth" in notice for notice in source.notices)
    assert any("left unused" in notice for notice in source.notices)


def test_a_damaged_oxts_packet_or_scan_is_left_out(tmp_path: Path) -> None:
    drive = raw_drive(tmp_path, frames=6, oxts=6, scans=6)
    (drive / "oxts" / "data" / "0000000002.txt").write_text("49.0 nan")
    (drive / "velodyne_points" / "data" / "0000000001.bin").write_bytes(b"12345")
    source = open_source(str(drive))
    assert source.ground_truth is not None
    assert source.ground_truth.poses is not None
    assert np.isfinite(source.ground_truth.poses).all(axis=(1, 2)).tolist() == [
        True,
        True,
        False,
        True,
        True,
        True,
    ]
    assert source[1].lidar is None
    assert source[2].lidar is not None


@pytest.mark.parametrize("damage", ["missing", "cut", "nan"])
def test_a_bad_calibration_is_one_clear_line(tmp_path: Path, damage: str) -> None:
    drive = raw_drive(tmp_path)
    path = drive.parent / "calib_cam_to_cam.txt"
    text = path.read_text()
    if damage == "missing":
        path.unlink()
    else:
        path.write_text(text[:100] if damage == "cut" else text.replace("P_rect_00: 80.0", "P_rect_00: nan"))
    with pytest.raises(SourceError) as caught:
        open_source(str(drive))
    assert "calib" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_real_drive(kitti_raw_0009: Path) -> None:
    source = open_source(str(kitti_raw_0009))
    assert len(source) == 51
    assert source.camera.baseline_m == pytest.approx(0.537, abs=1e-3)
    assert sum(source[i].lidar is not None for i in range(14)) == 12
    truth = source.ground_truth
    assert truth is not None
    assert truth.poses is not None
    steps = np.linalg.norm(np.diff(truth.poses[:, :3, 3], axis=0), axis=1)
    assert 50 < steps.sum() < 60
    # Points ahead of the car, near its middle, must lie under and before the camera.
    scan, T = source[0].lidar, source.T_camera_lidar
    assert scan is not None
    assert T is not None
    road = scan[(scan[:, 0] > 5) & (scan[:, 0] < 10) & (np.abs(scan[:, 1]) < 2) & (scan[:, 2] < -1.5)]
    camera = road[:, :3] @ T[:3, :3].T + T[:3, 3]
    assert np.median(camera[:, 1]) == pytest.approx(1.65, abs=0.15)


def test_what_lies_beside_a_link_comes_before_what_lies_beside_its_target(tmp_path: Path) -> None:
    drive = raw_drive(tmp_path / "there", scans=1)
    here = tmp_path / "here"
    here.mkdir()
    (here / drive.name).symlink_to(drive)
    plain = open_source(str(drive)).T_camera_lidar
    assert np.array_equal(open_source(str(here / drive.name)).T_camera_lidar, plain)
    for file in drive.parent.glob("calib_*.txt"):
        (here / file.name).write_text(file.read_text())
    velo = here / "calib_velo_to_cam.txt"
    moved = velo.read_text().splitlines()
    moved = ["T: 1 2 3" if line.startswith("T:") else line for line in moved]
    velo.write_text("\n".join(moved) + "\n")
    T = open_source(str(here / drive.name)).T_camera_lidar
    np.testing.assert_allclose(T[:3, 3], [1, 2, 3], atol=1e-9)
    assert np.array_equal(open_source(f"{here}/{drive.name}/../{drive.name}").T_camera_lidar, plain)


def test_an_unrectified_drive_is_rectified_with_its_own_lenses(tmp_path: Path) -> None:
    """`_extract`: the size of the pictures tells that they are the lenses' own."""
    drive = raw_drive(tmp_path, frames=3, oxts=3, scans=3)
    path = drive.parent / "calib_cam_to_cam.txt"
    unit = " ".join(map(str, np.eye(3).ravel()))
    lines = []
    for i, t in ((0, "0 0 0"), (1, "-0.5 0.001 0")):
        lines.append(f"S_0{i}: 96 64\nK_0{i}: 82 0 47 0 81 31 0 0 1\nD_0{i}: -0.2 0.05 0.001 -0.001 0.01\n")
        lines.append(f"R_0{i}: {unit}\nT_0{i}: {t}\nS_rect_0{i}: 90 60\nR_rect_0{i}: {unit}\n")
        lines.append(f"P_rect_0{i}: 80 0 47.5 {-40.0 * i} 0 80 31.5 0 0 0 1 0\n")
    path.write_text("".join(lines))
    source = open_source(str(drive))
    assert any("rectified while reading" in note for note in source.notices)
    assert (source.camera.width, source.camera.height) == (96, 64)
    assert source.camera.baseline_m == pytest.approx(0.500001, abs=1e-6)
    assert source.T_camera_lidar is not None
    path.write_text(
        path.read_text()
        .replace("S_rect_00: 90 60", "S_rect_00: 96 64")
        .replace("S_rect_01: 90 60", "S_rect_01: 96 64")
    )
    synced = open_source(str(drive))
    assert not any("rectified while reading" in note for note in synced.notices)
    assert synced.camera.focal_px == 80
