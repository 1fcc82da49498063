"""Tracks of a car on a plane whose rear axle follows a known path: the truth for the yaw of the rig."""

from __future__ import annotations

import numpy as np

from stereocalib_core.geometry import Extrinsics, StereoCamera, invert_transform, planar_motion, transform
from stereocalib_core.results import FrameResult, RoadEstimate, Tracks

CAMERA = StereoCamera(1226, 370, 707.0, 602.0, 183.0, 0.537)
LEVER_M = 0.95


def simulate(
    curvature: np.ndarray, yaw_deg: float, step_m: float = 0.8, noise_px: float = 0.25, seed: int = 0
) -> tuple[list[FrameResult], np.ndarray]:
    """Frame results with tracks along (N,) curvature [1/m] of the rear axle's path, and (N, 4) extrinsics."""
    rng = np.random.default_rng([seed, 7])
    count = len(curvature)
    swing = rng.standard_normal((count, 2)) * np.deg2rad(0.1)
    extrinsics = [
        Extrinsics(1.65, np.deg2rad(0.8) + p, np.deg2rad(-0.4) + r, np.deg2rad(yaw_deg)) for p, r in swing
    ]
    results: list[FrameResult] = []
    for i, e in enumerate(extrinsics):
        tracks = None
        if i:
            tracks = _tracks(extrinsics[i - 1], e, curvature[i], step_m, noise_px, rng, i - 1)
        road = RoadEstimate(e, np.diag([1e-5, 1e-8, 1e-8]), 1000, 0.5, (4.0, 20.0))
        results.append(FrameResult(i, 0.1 * i, road, tracks=tracks))
    return results, np.array([[e.height_m, e.pitch_rad, e.roll_rad, e.yaw_rad] for e in extrinsics])


def _tracks(
    before: Extrinsics,
    after: Extrinsics,
    curvature: float,
    step_m: float,
    noise_px: float,
    rng: np.random.Generator,
    previous: int,
) -> Tracks:
    turn = curvature * step_m
    half = 0.5 * turn
    axle = planar_motion(step_m * np.sin(half), step_m * np.cos(half), turn)
    lever = transform(np.eye(3), [0.0, 0.0, LEVER_M])
    vehicle = invert_transform(lever) @ axle @ lever
    T_now_before = (
        after.T_camera_vehicle @ invert_transform(vehicle) @ invert_transform(before.T_camera_vehicle)
    )
    ground = np.column_stack([rng.uniform(-5, 5, 150), np.zeros(150), 1.0 / rng.uniform(1 / 25, 1 / 5, 150)])
    above = np.column_stack([rng.uniform(-12, 12, 100), rng.uniform(-4, 0.5, 100), rng.uniform(8, 40, 100)])
    T = before.T_camera_road
    points = np.concatenate([ground @ T[:3, :3].T + T[:3, 3], above])
    now = points @ T_now_before[:3, :3].T + T_now_before[:3, 3]
    seen = np.concatenate([CAMERA.project(points), CAMERA.project(now)], axis=1)
    seen += rng.standard_normal(seen.shape) * noise_px
    seen[::15, 3:5] += rng.uniform(-8, 8, (len(seen[::15]), 2))
    return Tracks(seen.astype(np.float32), np.arange(len(points)) < 150, previous)
