"""The town: its truth, its pictures, and that it repeats."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from stereocalib_core.config.scene import FIT_FAR_M, FIT_NEAR_M
from stereocalib_core.geometry import Extrinsics, invert_transform
from stereocalib_core.simulator.drive import plan_drive
from stereocalib_core.simulator.settings import parse_spec
from stereocalib_core.simulator.studio import Studio
from stereocalib_core.sources.formats.synthetic import SyntheticSource

QUIET = "noise=0&exposure_difference=0&vignetting=0"


@pytest.fixture(scope="module")
def town() -> SyntheticSource:
    return SyntheticSource.from_spec(f"synthetic:town?frames=120&{QUIET}")


def test_warped_right_is_left_where_both_see_it(town: SyntheticSource) -> None:
    frame = 40
    left_view, right_view = town.studio.views(frame)
    left, right = town.studio.pictures(frame)
    camera = town.camera
    fb = np.float32(camera.focal_px * camera.baseline_m)
    disparity = left_view.inverse_depth * fb
    u, v = np.meshgrid(np.arange(camera.width, dtype=np.float32), np.arange(camera.height, dtype=np.float32))
    warped = cv2.remap(right.astype(np.float32), u - disparity, v, cv2.INTER_CUBIC)
    theirs = cv2.remap(right_view.inverse_depth * fb, u - disparity, v, cv2.INTER_NEAREST)
    seen = (left_view.inverse_depth > 0) & (np.abs(theirs - disparity) < 0.5) & (u - disparity > 3)
    # edges mix what is before and behind: they belong to no one disparity
    spread = cv2.dilate(disparity, np.ones((5, 5))) - cv2.erode(disparity, np.ones((5, 5)))
    smooth = seen & (spread < 2.0)
    assert smooth.mean() > 0.35
    error = np.abs(warped - left)[smooth]
    assert np.median(error) < 1.0
    road = np.abs(warped - left)[smooth & (left_view.label == 1)]
    assert np.median(road) < 1.0 and np.percentile(road, 95) < 8.0
    off = cv2.remap(right.astype(np.float32), u - disparity + 0.5, v, cv2.INTER_CUBIC)
    assert np.median(np.abs(off - left)[smooth]) > 1.5 * np.median(error)


def test_truth_is_the_plane_of_the_own_lane(town: SyntheticSource) -> None:
    drive = town.studio.drive
    for i in (5, 20, 40):
        s = drive.s_m[i] + np.linspace(FIT_NEAR_M, FIT_FAR_M, 60)[:, None]
        points = drive.ground.surface(s, np.linspace(-1.7, 1.7, 21)[None, :]).reshape(-1, 3)
        T = invert_transform(drive.T_world_camera[i])
        plane = Extrinsics(*drive.extrinsics[i]).plane()
        away = plane.signed_distance(points @ T[:3, :3].T + T[:3, 3])
        assert abs(away.mean()) < 0.001 and np.abs(away).max() < 0.03


def test_road_disparity_is_the_true_plane_within_the_camber(town: SyntheticSource) -> None:
    flat = SyntheticSource.from_spec("synthetic:straight?frames=3&camber=0&body_motion=0")
    u, v = np.meshgrid(np.arange(flat.camera.width), np.arange(flat.camera.height))
    extrinsics = Extrinsics(*flat.ground_truth.extrinsics[1])
    expected = extrinsics.disparity_plane(flat.camera).disparity(flat.camera, u, v)
    seen = flat.truth(1)
    road = seen.labels == 1
    assert 0.1 < road.mean() < 0.6
    # pixels on an edge show the average place of their triangles
    assert np.percentile(np.abs(seen.disparity - expected)[road], 99.9) < 0.01
    assert (seen.labels == 2).mean() > 0.1


def test_poses_obey_rear_axle_without_side_slip() -> None:
    settings = parse_spec("synthetic:town?body_motion=0&camber=0")
    drive = plan_drive(settings)
    yaw, lever = np.deg2rad(settings.mount_yaw_deg), settings.lever_arm_m
    R = drive.T_world_camera[:, :3, :3] @ Extrinsics.from_degrees(1.65, 0.8, -0.4).R_camera_road
    heading = np.unwrap(np.arctan2(R[:, 0, 2], R[:, 2, 2])) + yaw
    forward = np.stack([np.sin(heading), np.cos(heading)], axis=1)
    rear = drive.T_world_camera[:, [0, 2], 3] - lever * forward
    step = np.diff(rear, axis=0)
    middle = 0.5 * (heading[1:] + heading[:-1])
    slip = step[:, 0] * np.cos(middle) - step[:, 1] * np.sin(middle)
    assert np.abs(slip).max() < 0.003
    assert np.linalg.norm(step, axis=1).sum() == pytest.approx(700, rel=0.05)
    assert abs(heading[-1] - heading[0]) == pytest.approx(2 * np.pi, abs=0.05)
    speed = np.linalg.norm(step, axis=1) * 10
    assert speed.min() < 0.2 and speed.max() > 9


def test_same_seed_same_bytes_other_seed_other_town() -> None:
    small = "width=320&height=120&focal_px=185&cx_px=157&cy_px=55"
    a, b, c = (Studio(parse_spec(f"synthetic:town?{small}&frames=5&seed={k}")) for k in (4, 4, 5))
    left, right, _ = a.frame(2)
    again, right_again, _ = b.frame(2)
    other, _, _ = c.frame(2)
    assert np.array_equal(left, again) and np.array_equal(right, right_again)
    assert not np.array_equal(left, other)


def test_pose_file_is_driven_as_it_is(tmp_path: Path) -> None:
    drive = plan_drive(parse_spec("synthetic:curves?frames=120&body_motion=0"))
    poses = invert_transform(drive.T_world_camera[0]) @ drive.T_world_camera
    file = tmp_path / "poses.txt"
    np.savetxt(file, poses[:, :3].reshape(-1, 12))
    source = SyntheticSource.from_spec(f"synthetic?path={file}&camber=0")
    assert len(source) == 120
    assert np.abs(source.ground_truth.poses - poses).max() < 1e-6
    truth = source.ground_truth.extrinsics
    assert np.abs(np.median(truth[:, 0]) - 1.65) < 0.02
    assert np.abs(np.rad2deg(np.median(truth[:, 1:], axis=0)) - [0.8, -0.4, -0.3]).max() < 0.1


@pytest.mark.parametrize(
    ("knock", "axis", "size"),
    [("height=0.03", 0, 0.03), ("pitch=0.3", 1, 0.3), ("roll=-0.3", 2, -0.3), ("yaw=0.3", 3, 0.3)],
)
def test_a_knock_moves_the_camera_along_a_pose_file_too(
    tmp_path: Path, knock: str, axis: int, size: float
) -> None:
    drive = plan_drive(parse_spec("synthetic:curves?frames=40&body_motion=0"))
    file = tmp_path / "poses.txt"
    np.savetxt(file, drive.T_world_camera[:, :3].reshape(-1, 12))
    clean = plan_drive(parse_spec(f"synthetic?path={file}"))
    knocked = plan_drive(parse_spec(f"synthetic?path={file}&fault=knock:{knock}@20"))
    assert np.array_equal(knocked.T_world_camera[:20], clean.T_world_camera[:20])
    unit = np.array([1.0, *[np.rad2deg(1.0)] * 3])
    change = (knocked.extrinsics - clean.extrinsics) * unit
    expected = np.zeros(4)
    expected[axis] = size
    assert np.abs(change[:20]).max() == 0.0
    assert np.abs(change[20:] - expected).max() < 0.005
    turned = invert_transform(clean.T_world_camera[30]) @ knocked.T_world_camera[30]
    heading = np.rad2deg(np.arctan2(turned[0, 2], turned[2, 2]))
    # a camera turned to the left: its axis points to -x of where it was
    assert heading == pytest.approx(-size if axis == 3 else 0.0, abs=0.01)


def test_body_dives_when_braking_and_leans_out_of_bends() -> None:
    drive = plan_drive(parse_spec("synthetic:town"))
    still = plan_drive(parse_spec("synthetic:town?body_motion=0"))
    extra = drive.extrinsics - still.extrinsics
    hard = drive.motion.acceleration < -1.5
    assert np.median(extra[hard, 1]) > np.deg2rad(0.2)
    right_bend = drive.motion.lateral > 1.5
    assert np.median(extra[right_bend, 2]) > np.deg2rad(0.2)
