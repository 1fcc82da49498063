"""A spinning LiDAR in the same world: the rasterizer finds what each beam hits, the triangle's plane how far.

The world is filled four times around the sensor; a beam reads which triangle its sample shows and meets that
triangle's plane exactly, so that ranges on the road are as exact as the camera's disparities.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from stereocalib_core.config.scene import (
    AZIMUTHS,
    BEAMS,
    HIGHEST_DEG,
    LOWEST_DEG,
    RANGE_M,
    RANGE_NOISE_M,
    SCAN_CY_PX,
    SCAN_FOCAL_PX,
    SCAN_HEIGHT_PX,
    SCAN_WIDTH_PX,
)
from stereocalib_core.geometry import invert_transform, rotation_x, rotation_y, rotation_z, transform
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.simulator import raster
from stereocalib_core.simulator.faults import offsets
from stereocalib_core.simulator.renderer import Canvas, list_draws
from stereocalib_core.simulator.world import World, moving


def _mounting() -> Array:
    """T_camera_lidar, KITTI-like: x forward, y left, z up, behind and a little above the camera."""
    axes = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    small = rotation_x(math.radians(0.4)) @ rotation_y(math.radians(-0.6)) @ rotation_z(math.radians(0.5))
    return transform(small @ axes, [-0.012, -0.075, -0.27])


T_CAMERA_LIDAR = _mounting()


@njit(cache=True, nogil=True, error_model="numpy")
def _cast(  # type: ignore[no-untyped-def]
    ids, planes, source, tones, K, R_lidar_view, directions, ranges, intensities, low, high
):
    """Ranges [m] (0 = none) and intensities of the beams (N, 3) that look into one view."""
    f, cx, cy = K
    height, width = ids.shape
    for n in range(directions.shape[0]):
        d = directions[n]
        x = R_lidar_view[0, 0] * d[0] + R_lidar_view[1, 0] * d[1] + R_lidar_view[2, 0] * d[2]
        y = R_lidar_view[0, 1] * d[0] + R_lidar_view[1, 1] * d[1] + R_lidar_view[2, 1] * d[2]
        z = R_lidar_view[0, 2] * d[0] + R_lidar_view[1, 2] * d[1] + R_lidar_view[2, 2] * d[2]
        if z <= 0.0 or abs(x) > z:
            continue
        u, v = f * x / z + cx, f * y / z + cy
        column = int(math.floor((u + 0.5) * raster.SAMPLES))
        row = int(math.floor((v + 0.5) * raster.SAMPLES))
        if column < 0 or row < 0 or column >= width or row >= height:
            continue
        k = ids[row, column]
        if k < 0:
            continue
        q = planes[k]
        w = q[0] * u + q[1] * v + q[2]
        if w <= 0.0:
            continue
        distance = math.sqrt(1.0 + (x * x + y * y) / (z * z)) / w
        if low <= distance <= high:
            ranges[n] = distance
            intensities[n] = min(max(0.25 * tones[source[k]], 0.0), 1.0)


class SpinningLidar:
    """Scans one world; keeps its scratch memory, so one thread at a time."""

    def __init__(self, world: World) -> None:
        self.world = world
        self._canvas = Canvas(SCAN_WIDTH_PX, SCAN_HEIGHT_PX)
        elevation = np.deg2rad(np.linspace(HIGHEST_DEG, LOWEST_DEG, BEAMS))[:, None]
        azimuth = np.linspace(0.0, -2 * np.pi, AZIMUTHS, endpoint=False)[None, :]
        self._directions = np.stack(
            [
                np.cos(elevation) * np.cos(azimuth),
                np.cos(elevation) * np.sin(azimuth),
                np.sin(elevation) * np.ones_like(azimuth),
            ],
            axis=-1,
        ).reshape(-1, 3)
        settings = world.drive.settings
        self._knocks = offsets(settings.faults, ("lidar_knock",), len(world.drive))

    def T_camera_lidar(self, frame: int) -> Array:
        """(4, 4) where the sensor truly is against the camera, knocks of either included."""
        drive = self.world.drive
        return invert_transform(drive.T_world_camera[frame]) @ drive.T_world_rig[frame] @ self._on_car(frame)

    def _on_car(self, frame: int) -> Array:
        """(4, 4) against where the camera were had nothing knocked it; the LiDAR's own knocks are angles and shifts
        in the camera's axes and signs (pitch > 0 looks down)."""
        height, pitch, roll, yaw, x, z = (float(a) for a in self._knocks[frame])
        knock = rotation_x(pitch) @ rotation_z(roll) @ rotation_y(yaw)
        T = T_CAMERA_LIDAR.copy()
        T[:3, :3] = knock.T @ T[:3, :3]
        T[:3, 3] += [x, -height, z]
        return T

    def scan(self, frame: int) -> NDArray[np.float32]:
        """(N, 4) float32 x, y, z [m] in the LiDAR's frame, and intensity, beam after beam."""
        drive, tones, canvas = self.world.drive, self.world.mesh.tones, self._canvas
        things, _ = moving(self.world, frame)
        T_world_lidar = drive.T_world_rig[frame] @ self._on_car(frame)
        ranges = np.zeros(len(self._directions))
        intensities = np.zeros(len(self._directions))
        forward = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
        K = (SCAN_FOCAL_PX, (SCAN_WIDTH_PX - 1) / 2, SCAN_CY_PX)
        for turn in range(4):
            R_lidar_view = rotation_z(turn * np.pi / 2) @ forward
            T_view = T_world_lidar @ transform(R_lidar_view, np.zeros(3))
            draws = list_draws(self.world, T_view, float(drive.s_m[frame]), things, 1.0)
            canvas.draw(self.world, draws, K)
            _cast(
                *(canvas.ids, canvas.planes, canvas.source, tones, K, np.ascontiguousarray(R_lidar_view)),
                *(self._directions, ranges, intensities, *RANGE_M),
            )
        hit = ranges > 0
        rng = np.random.default_rng([drive.settings.seed, 61, frame])
        noise = rng.standard_normal(len(ranges)) * RANGE_NOISE_M * drive.settings.lidar_noise
        points = self._directions[hit] * (ranges + noise)[hit, None]
        return np.concatenate([points, intensities[hit, None]], axis=1).astype(np.float32)
