"""The LiDAR against the patches of the stereo road, on a street that is no plane."""

from __future__ import annotations

import numpy as np
import pytest
from simulated_scan import T_CAMERA_LIDAR, frame_with, stereo_result, turned

from stereocalib_core.config import RoadCheckConfig
from stereocalib_core.front.scan.lidar_road import scan_residual
from stereocalib_core.front.scan.road_surface import NONE, RoadSurface
from stereocalib_core.geometry import Extrinsics, StereoCamera, image_to_road_plane, invert_transform

ROAD = Extrinsics.from_degrees(1.66, 0.9, -1.1)
CAMERA = StereoCamera(1242, 375, 720.0, 609.0, 172.0, 0.54)
CONFIG = RoadCheckConfig()


def height_m(x: np.ndarray, z: np.ndarray) -> np.ndarray:
    """A street that is wavy and falls away to the right of the lane."""
    return np.asarray(0.01 * np.sin(z) - 0.04 * np.maximum(x - 1.0, 0.0))


def surface() -> RoadSurface:
    """Patches as the stereo road has them, from the lane's left edge to 5 m right of its middle."""
    tile, corner = np.array([13.0, 7.0]), np.array([350.0, 190.0])
    column, row = np.meshgrid(np.arange(60), np.arange(26))
    u, v = corner[0] + tile[0] * column, corner[1] + tile[1] * row
    foot = image_to_road_plane(CAMERA, ROAD, u.ravel(), v.ravel())
    x, z = foot[:, 0], foot[:, -1]
    inside = (z > 5.0) & (z < 18.0) & (x > -1.7) & (x < 5.0)
    tiles = np.full(column.shape, NONE, np.int32)
    tiles.ravel()[inside] = np.arange(inside.sum())
    return RoadSurface(CAMERA, tiles, corner, tile, height_m(x[inside], z[inside]), (5.0, 18.0))


def scan(T_camera_lidar: np.ndarray) -> np.ndarray:
    """(N, 4) points of the street by a LiDAR that stands like this."""
    x, z = (grid.ravel() for grid in np.meshgrid(np.arange(-5.0, 8.0, 0.1), np.arange(4.0, 25.0, 0.1)))
    T = invert_transform(T_camera_lidar) @ ROAD.T_camera_road
    points = np.stack([x, -height_m(x, z), z], axis=1) @ T[:3, :3].T + T[:3, 3]
    return np.column_stack([points, np.zeros(len(points))]).astype(np.float32)


@pytest.mark.parametrize(
    ("pitch", "roll", "raised_m"), [(0.0, 0.0, 0.0), (1.0, -1.0, 0.0), (0.0, 2.0, 0.05), (-1.5, 2.0, 0.0)]
)
def test_the_shape_of_the_street_is_no_residual(pitch: float, roll: float, raised_m: float) -> None:
    # the calibration says T_CAMERA_LIDAR; the LiDAR looks further down, leans further right and stands higher
    T = turned(T_CAMERA_LIDAR, -pitch, -roll)
    T[1, 3] -= raised_m
    found = scan_residual(frame_with(scan(T)), stereo_result(0, ROAD), T_CAMERA_LIDAR, CONFIG, surface())
    assert found is not None and found.points > 2000
    np.testing.assert_allclose(np.rad2deg(found.values[1:]), [pitch, roll], atol=0.06)
    if raised_m or not pitch:
        assert found.values[0] == pytest.approx(raised_m, abs=0.006)
    assert np.sqrt(found.covariance[2, 2]) < np.deg2rad(0.08)


def test_a_plane_through_the_lane_alone_is_another_one() -> None:
    frame, result = frame_with(scan(T_CAMERA_LIDAR)), stereo_result(0, ROAD)
    alone = scan_residual(frame, result, T_CAMERA_LIDAR, CONFIG)
    assert alone is not None and abs(np.rad2deg(alone.values[2])) > 0.15


def test_a_car_on_the_patches_is_left_out_and_nothing_on_them_is_no_residual() -> None:
    rng = np.random.default_rng(0)
    cloud = scan(T_CAMERA_LIDAR)
    T = invert_transform(T_CAMERA_LIDAR) @ ROAD.T_camera_road
    box = rng.uniform([-1.0, -0.6, 9.0], [0.8, 0.0, 9.3], (1500, 3)) @ T[:3, :3].T + T[:3, 3]
    with_car = np.concatenate([cloud, np.column_stack([box, np.zeros(1500)]).astype(np.float32)])
    found = scan_residual(frame_with(with_car), stereo_result(0, ROAD), T_CAMERA_LIDAR, CONFIG, surface())
    assert found is not None
    np.testing.assert_allclose(np.rad2deg(found.values[1:]), 0.0, atol=0.05)
    behind = cloud * np.array([-1.0, 1.0, 1.0, 1.0], np.float32)
    assert (
        scan_residual(frame_with(behind), stereo_result(0, ROAD), T_CAMERA_LIDAR, CONFIG, surface()) is None
    )
