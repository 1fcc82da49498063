"""How long one variant of a whole drive takes to compute again, on tracks drawn at random."""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.geometry import Extrinsics, StereoCamera
from stereocalib_core.odometry.packing import PackedTracks
from stereocalib_core.odometry.trajectory import TrajectorySettings, trajectory

CAMERA = StereoCamera(1226, 370, 707.0912, 601.8873, 183.1104, 0.5371506)
ROAD_POINTS, ABOVE_POINTS = 140, 80
"""Points of each pair, as many as a well-textured town gives."""


def random_drive(frames: int, seed: int = 0) -> tuple[PackedTracks, NDArray[np.float64]]:
    """Tracks of `frames` frames at 0.65 m a frame with noise of a quarter pixel, and the (N, 4) extrinsics."""
    rng = np.random.default_rng(seed)
    count = ROAD_POINTS + ABOVE_POINTS
    mount = Extrinsics.from_degrees(1.65, 0.8, -0.4, -0.3)
    x = rng.uniform(-0.5, 0.5, (frames, count))
    y = np.where(
        np.arange(count) < ROAD_POINTS,
        rng.uniform(0.05, 0.25, (frames, count)),
        rng.uniform(-0.2, 0.0, (frames, count)),
    )
    normal = mount.plane().normal / mount.height_m
    on_plane = normal[0] * x + normal[1] * y + normal[2]
    inverse = np.where(np.arange(count) < ROAD_POINTS, on_plane, 1.0 / rng.uniform(8, 60, (frames, count)))
    depth = 1.0 - 0.65 * inverse
    noise = rng.normal(0, 0.25 / CAMERA.focal_px, (2, frames, count))
    rays = np.stack([x, y, inverse, x / depth + noise[0], y / depth + noise[1]])
    start = np.arange(frames + 1, dtype=np.int64) * count
    return PackedTracks(
        CAMERA,
        np.ascontiguousarray(rays.reshape(5, -1)),
        start,
        start[:-1] + ROAD_POINTS,
        np.arange(frames, dtype=np.int64) - 1,
        np.ones(frames, dtype=bool),
    ), np.tile([mount.height_m, mount.pitch_rad, mount.roll_rad, mount.yaw_rad], (frames, 1))


def recompute_ms(frames: int, repeats: int = 15) -> float:
    """Median time [ms] of one variant, over an injected error in each axis, a missing correction and all models."""
    tracks, extrinsics = random_drive(frames)
    variants = [
        TrajectorySettings(pitch_error_rad=0.003),
        TrajectorySettings(roll_error_rad=0.003, height_error_m=0.02),
        TrajectorySettings(pitch_strength=0.0, roll_strength=0.0),
        TrajectorySettings("planar", pitch_error_rad=0.003),
        TrajectorySettings("nonholonomic", yaw_error_rad=0.003),
    ]
    times = []
    for k in range(-len(variants), repeats):
        began = time.perf_counter()
        trajectory(tracks, extrinsics, variants[k % len(variants)])
        if k >= 0:
            times.append(1e3 * (time.perf_counter() - began))
    return float(np.median(times))
