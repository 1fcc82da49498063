"""Tracks of a known drive over a flat road, without any picture."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.geometry import (
    Extrinsics,
    StereoCamera,
    image_to_road_plane,
    invert_transform,
    planar_motion,
)
from stereocalib_core.results import Tracks

CAMERA = StereoCamera(1226, 370, 707.0912, 601.8873, 183.1104, 0.5371506)


def mount_series(count: int, rng: np.random.Generator, wobble: float = 1.0) -> NDArray[np.float64]:
    """(N, 4) extrinsics about a mount of 1.65 m, 0.8, -0.4, -0.3 degrees, moving as a car body does."""
    phase = rng.uniform(0, 2 * np.pi, 3)
    t = np.arange(count) / 10.0
    rows = np.tile([1.65, *np.deg2rad([0.8, -0.4, -0.3])], (count, 1))
    rows[:, 0] += wobble * 0.01 * np.sin(2.0 * t + phase[0])
    rows[:, 1] += wobble * np.deg2rad(0.2) * np.sin(1.5 * t + phase[1])
    rows[:, 2] += wobble * np.deg2rad(0.2) * np.sin(1.1 * t + phase[2])
    return rows


def car_path(count: int, yaw_rad: float, lever_m: float, straight: bool = False) -> NDArray[np.float64]:
    """(N, 3) planar camera motion x, z, heading of a car whose rear axle moves along arcs; row 0 is zero."""
    k = np.arange(count)
    distance = np.full(count, 0.65)
    heading = (
        0.0 * k if straight else np.deg2rad(2.5) * np.clip(np.sin(2 * np.pi * k / 160.0) * 2 - 0.8, 0, 1)
    )
    x = distance * np.sin(heading / 2) + lever_m * np.sin(heading)
    z = distance * np.cos(heading / 2) + lever_m * (np.cos(heading) - 1)
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    rows = np.column_stack([c * x + s * z, -s * x + c * z, heading])
    rows[0] = 0.0
    return rows


def camera_poses(planar: NDArray[np.float64], extrinsics: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 4, 4) T_world_camera of a camera carried along (N, 3) planar motions, world = first camera."""
    mounts = [Extrinsics(*row).T_camera_road for row in extrinsics]
    road = [np.eye(4)]
    for row in planar[1:]:
        road.append(road[-1] @ planar_motion(*row))
    return np.array([mounts[0] @ T @ invert_transform(m) for T, m in zip(road, mounts, strict=True)])


def tracks_of(
    poses: NDArray[np.float64],
    extrinsics: NDArray[np.float64],
    rng: np.random.Generator,
    noise_px: float = 0.25,
    disparity_noise_px: float = 0.1,
    road: int = 180,
    above: int = 110,
    camera: StereoCamera = CAMERA,
) -> list[Tracks | None]:
    """What a front end would measure between consecutive poses."""
    result: list[Tracks | None] = [None]
    for i in range(1, len(poses)):
        e = Extrinsics(*extrinsics[i - 1])
        u, v = rng.uniform(150, 1076, 4 * road), rng.uniform(205, 368, 4 * road)
        xz = image_to_road_plane(camera, e, u, v)
        keep = np.flatnonzero((np.abs(xz[:, 0]) < 6) & (xz[:, 1] < 35) & (xz[:, 1] > 0))[:road]
        on = e.disparity_plane(camera).disparity(camera, u[keep], v[keep])
        a, b = rng.uniform(20, 1206, above), rng.uniform(10, 180, above)
        off = camera.focal_px * camera.baseline_m / rng.uniform(8, 60, above)
        first = np.column_stack([np.r_[u[keep], a], np.r_[v[keep], b], np.r_[on, off]])
        flags = np.arange(len(first)) < len(keep)
        T = invert_transform(poses[i]) @ poses[i - 1]
        second = camera.project(camera.back_project(*first.T) @ T[:3, :3].T + T[:3, 3])
        seen = (second[:, 0] > 0) & (second[:, 0] < camera.width) & (second[:, 1] > 0)
        seen &= (second[:, 1] < camera.height) & (second[:, 2] > 0)
        second[:, :2] += rng.normal(0, noise_px, (len(second), 2))
        first[:, 2] += rng.normal(0, disparity_noise_px, len(first))
        second[:, 2] += rng.normal(0, disparity_noise_px, len(first))
        points = np.column_stack([first, second])[seen].astype(np.float32)
        result.append(Tracks(points, flags[seen], i - 1))
    return result
