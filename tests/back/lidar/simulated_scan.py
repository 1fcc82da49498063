"""A spinning LiDAR over a plane road, in closed form: every beam's range is known."""

from __future__ import annotations

import dataclasses

import numpy as np

from stereocalib_core.frames import StereoFrame
from stereocalib_core.geometry import (
    Extrinsics,
    invert_transform,
    rotation_x,
    rotation_y,
    rotation_z,
    transform,
)
from stereocalib_core.results import FrameResult, RoadEstimate

AXES = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
T_CAMERA_LIDAR = transform(
    rotation_x(0.01) @ rotation_y(-0.008) @ rotation_z(0.006) @ AXES, [-0.01, -0.08, -0.27]
)
STEREO_COVARIANCE = np.diag([0.003, np.deg2rad(0.02), np.deg2rad(0.04)]) ** 2


def beams(rings: int = 64, lowest_deg: float = -24.8, highest_deg: float = 2.0) -> np.ndarray:
    """(N, 3) unit rays of the forward sector in the LiDAR's frame."""
    elevation, azimuth = np.meshgrid(
        np.deg2rad(np.linspace(highest_deg, lowest_deg, rings)), np.deg2rad(np.arange(-60.0, 60.0, 0.17))
    )
    flat = np.cos(elevation)
    return np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)], axis=-1).reshape(
        -1, 3
    )


def scan_of_road(
    camera_over_road: Extrinsics,
    T_camera_lidar: np.ndarray = T_CAMERA_LIDAR,
    noise_m: float = 0.02,
    seed: int = 0,
    rings: int = 64,
) -> np.ndarray:
    """(N, 4) float32 scan of the plane road, range noise along the rays."""
    rays = beams(rings)
    plane = camera_over_road.plane().transformed(invert_transform(T_camera_lidar))
    towards = rays @ plane.normal
    hit = towards > plane.offset_m / 80.0
    ranges = plane.offset_m / towards[hit]
    ranges = ranges + noise_m * np.random.default_rng(seed).standard_normal(len(ranges))
    points = rays[hit] * ranges[:, None]
    return np.column_stack([points, np.full(len(points), 0.3)]).astype(np.float32)


def stereo_result(
    frame: int, extrinsics: Extrinsics, range_m: tuple[float, float] = (5.5, 20.0)
) -> FrameResult:
    """What the front end says of a pair that sees this road."""
    road = RoadEstimate(extrinsics, STEREO_COVARIANCE, 300, 0.5, range_m)
    return FrameResult(frame, 0.1 * frame, road)


def frame_with(scan: np.ndarray | None, index: int = 0) -> StereoFrame:
    """A frame that carries nothing but a scan."""
    return StereoFrame(index, 0.1 * index, None, None, lidar=scan)


def turned(
    T_camera_lidar: np.ndarray, pitch_deg: float = 0.0, roll_deg: float = 0.0, yaw_deg: float = 0.0
) -> np.ndarray:
    """The calibration of a LiDAR that is turned about its own origin, in the camera's axes."""
    turn = (
        rotation_x(np.deg2rad(pitch_deg)) @ rotation_z(np.deg2rad(roll_deg)) @ rotation_y(np.deg2rad(yaw_deg))
    )
    result = T_camera_lidar.copy()
    result[:3, :3] = turn @ result[:3, :3]
    return result


def with_residual(frame: int, values: np.ndarray, sigma: np.ndarray) -> FrameResult:
    """A frame whose residual is given."""
    from stereocalib_core.results import RoadResidual

    return dataclasses.replace(
        stereo_result(frame, Extrinsics(1.65, 0.0, 0.0)), lidar=RoadResidual(values, np.diag(sigma**2), 3000)
    )
