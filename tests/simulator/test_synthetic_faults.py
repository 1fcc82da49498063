"""Each fault does to truth and pictures what it says."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from stereocalib_core.errors import FailureReason
from stereocalib_core.geometry import invert_transform
from stereocalib_core.simulator.cache import FrameCache
from stereocalib_core.sources.formats.synthetic import SyntheticSource

SMALL = "width=480&height=160&focal_px=277&cx_px=236&cy_px=75"


@cache
def drive(faults: str = "", name: str = "straight") -> SyntheticSource:
    return SyntheticSource.from_spec(f"synthetic:{name}?frames=24&{SMALL}{faults}")


def pictures(faults: str, frame: int) -> tuple[np.ndarray, np.ndarray]:
    left, right, _ = drive(faults).studio.frame(frame)
    return left.astype(float), right.astype(float)


@pytest.mark.parametrize(
    ("axis", "size", "column"), [("height", 0.1, 0), ("pitch", 0.5, 1), ("roll", -0.7, 2), ("yaw", 1.0, 3)]
)
def test_knock_is_a_step_of_its_size(axis: str, size: float, column: int) -> None:
    truth = drive(f"&fault=knock:{axis}={size}@10").ground_truth.extrinsics - drive().ground_truth.extrinsics
    unit = size if axis == "height" else np.deg2rad(size)
    assert np.abs(truth[:10]).max() < 1e-12
    assert truth[10:, column] == pytest.approx(unit, abs=0.02 * abs(unit))
    assert np.abs(np.delete(truth[10:], column, axis=1)).max() < 0.05 * abs(unit)


@pytest.mark.parametrize(("axis", "row"), [("x", 0), ("z", 2)])
def test_knock_along_the_road_moves_the_camera_only(axis: str, row: int) -> None:
    plain, moved = drive().studio.drive, drive(f"&fault=knock:{axis}=0.2@10").studio.drive
    shift = (invert_transform(plain.T_world_camera) @ moved.T_world_camera)[:, :3, 3]
    assert np.abs(shift[:10]).max() < 1e-12
    assert shift[12, row] == pytest.approx(0.2, abs=0.01)
    assert np.abs(moved.extrinsics - plain.extrinsics).max() < 0.01


def test_drift_grows() -> None:
    truth = drive("&fault=drift:pitch=0.4@8-18").ground_truth.extrinsics - drive().ground_truth.extrinsics
    assert np.rad2deg(truth[[8, 13, 18, 23], 1]) == pytest.approx([0.0, 0.2, 0.4, 0.4], abs=0.01)


def test_rectification_turns_the_right_camera_only() -> None:
    plain, turned = (
        drive().studio,
        drive("&fault=rectification:pitch=0.2@5&fault=rectification:roll=0.3@5").studio,
    )
    assert np.array_equal(plain.T_world_right(4), turned.T_world_right(4))
    R_right_left = (invert_transform(turned.T_world_right(6)) @ turned.drive.T_world_camera[6])[:3, :3]
    # pitch looks down: the axis of the left camera appears above the right one's
    assert np.rad2deg(np.arctan2(-R_right_left[1, 2], R_right_left[2, 2])) == pytest.approx(0.2, abs=1e-3)
    assert np.rad2deg(np.arctan2(R_right_left[1, 0], R_right_left[1, 1])) == pytest.approx(0.3, abs=1e-3)
    same, moved = plain.frame(6), turned.frame(6)
    assert np.array_equal(same[0], moved[0]) and not np.array_equal(same[1], moved[1])


def test_dirt_spoils_the_left_only() -> None:
    left, right = pictures("&fault=dirt@5-6", 5)
    clean_left, clean_right = pictures("", 5)
    assert np.array_equal(right, clean_right)
    assert (left < 0.5 * clean_left).mean() > 0.25
    assert np.array_equal(pictures("&fault=dirt@5-6", 7)[0], pictures("", 7)[0])


def test_glare_saturates() -> None:
    left, _ = pictures("&fault=glare@5", 5)
    assert (left >= 254).mean() > (pictures("", 5)[0] >= 254).mean() + 0.1


def test_night_is_dark_and_noisy() -> None:
    left, _ = pictures("&fault=night@5", 5)
    assert left.mean() < 0.3 * pictures("", 5)[0].mean()


def test_rain_differs_between_the_cameras_and_in_time() -> None:
    five, other = pictures("&fault=rain@5", 5), pictures("&fault=rain@5", 6)
    clean = pictures("", 5)
    assert not np.array_equal(five[0] - clean[0], five[1] - clean[1])
    assert np.abs(five[0] - clean[0]).mean() > 8
    assert not np.array_equal(five[0], other[0])


def test_low_texture_takes_the_road_s_grain() -> None:
    source, plain = drive("&fault=low_texture@5&noise=0"), drive("&noise=0")
    road = plain.truth(5).labels == 1
    road[:100] = False
    left, clean = source.studio.frame(5)[0].astype(float), plain.studio.frame(5)[0].astype(float)
    assert (
        np.abs(np.diff(left, axis=1))[road[:, 1:]].mean()
        < 0.4 * np.abs(np.diff(clean, axis=1))[road[:, 1:]].mean()
    )


def test_truck_fills_the_view() -> None:
    labels = drive("&fault=truck@5").truth(5)
    ahead = labels.labels[:, 150:330]
    assert (ahead == 2).mean() > 0.8
    assert np.nanmedian(labels.disparity[40:120, 180:300]) > 277 * 0.537 / 6


def test_ramp_makes_the_road_leave_its_plane() -> None:
    steep, plain = drive("&fault=ramp@15").studio.drive, drive().studio.drive
    points = steep.ground.surface(steep.s_m[15] + np.array([5.0, 30.0]), 0.0)
    assert -points[1, 1] - -points[0, 1] > 1.0
    assert np.abs(steep.extrinsics[0] - plain.extrinsics[0]).max() < 1e-9


def test_swap_freeze_and_drop() -> None:
    left, right = pictures("&fault=swap@5", 5)
    clean_left, clean_right = pictures("", 5)
    assert np.array_equal(left, clean_right) and np.array_equal(right, clean_left)
    left, right = pictures("&fault=freeze@5-7", 7)
    assert np.array_equal(left, pictures("", 7)[0]) and np.array_equal(right, pictures("", 4)[1])
    assert np.array_equal(pictures("&fault=freeze@5-7", 8)[1], pictures("", 8)[1])
    source = drive("&fault=drop@5")
    dropped, kept = source[5], source[6]
    assert dropped.failure is not None and dropped.failure.reason is FailureReason.MISSING_PAIR
    assert dropped.left is None and kept.left is not None
    assert len(source) == 24


def test_lidar_knock_moves_the_scan_but_not_the_calibration() -> None:
    faulty, plain = (
        drive(f"{f}&lidar=1&lidar_noise=0", "plane") for f in ("&fault=lidar_knock:roll=1@5", "")
    )
    assert np.array_equal(faulty.T_camera_lidar, plain.T_camera_lidar)
    before, after = faulty.studio.frame(4)[2], faulty.studio.frame(5)[2]
    assert np.array_equal(before, plain.studio.frame(4)[2])
    T = plain.T_camera_lidar
    normals = []
    for scan in (plain.studio.frame(5)[2], after):
        points = scan[:, :3].astype(float) @ T[:3, :3].T + T[:3, 3]
        points = points[np.linalg.norm(points, axis=1) < 25]
        _, _, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
        normals.append(axes[2] * np.sign(axes[2][1]))
    turned = np.rad2deg(np.arcsin(normals[1][0]) - np.arcsin(normals[0][0]))
    assert abs(turned) == pytest.approx(1.0, abs=0.05)


def test_a_knocked_camera_leaves_the_lidar_where_it_is() -> None:
    faulty, plain = (
        drive(f"{f}&lidar=1&lidar_noise=0", "plane")
        for f in ("&fault=knock:yaw=0.5@5&fault=knock:x=0.04@5", "")
    )
    for frame in (4, 5):
        assert np.array_equal(faulty.studio.frame(frame)[2], plain.studio.frame(frame)[2])
    spinner, T = faulty.studio._spinner, plain.T_camera_lidar
    np.testing.assert_allclose(spinner.T_camera_lidar(4), T, atol=1e-12)
    # the camera stands further right and looks further left: its LiDAR is left of where it was, and looks right
    off = spinner.T_camera_lidar(5) @ np.linalg.inv(T)
    assert off[0, 3] == pytest.approx(-0.04, abs=0.001)
    assert np.rad2deg(np.arctan2(off[0, 2], off[2, 2])) == pytest.approx(0.5, abs=0.001)


def test_cache_is_left_alone_by_other_settings(tmp_path: object) -> None:
    assert drive("&fault=glare@5").content_key != drive().content_key
    assert FrameCache("a").folder != FrameCache("b").folder
