"""Rooms with a chessboard as a ray-cast LiDAR sees them: walls, furniture, someone who holds the board.

The LiDAR's frame has x forward, y left, z up; its origin stands at the sensor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stereocalib_core.boards.observation import BoardSpec
from stereocalib_core.boards.rotations import rotation_from_vector
from stereocalib_core.geometry import transform
from stereocalib_core.numeric.arrays import Array

FLU_TO_RDF = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])


def grid_rays(elevations_deg: Array, azimuth_deg: Array) -> Array:
    az, el = np.meshgrid(np.deg2rad(azimuth_deg), np.deg2rad(elevations_deg))
    return np.stack([np.cos(az) * np.cos(el), np.sin(az) * np.cos(el), np.sin(el)], axis=-1).reshape(-1, 3)


def vlp16() -> Array:
    return grid_rays(np.arange(-15, 16, 2.0), np.arange(-180, 180, 0.2))


def hdl64() -> Array:
    return grid_rays(np.linspace(-24.8, 2.0, 64), np.arange(-180, 180, 0.18))


def dense(count: int = 120_000) -> Array:
    rng = np.random.default_rng(1)
    az, el = rng.uniform(-40, 40, count), rng.uniform(-25, 25, count)
    az, el = np.deg2rad(az), np.deg2rad(el)
    return np.stack([np.cos(az) * np.cos(el), np.sin(az) * np.cos(el), np.sin(el)], axis=-1)


@dataclass(frozen=True)
class Rectangle:
    """T (4, 4) lidar from rectangle (z normal), width, height [m]."""

    T: Array
    width: float
    height: float


def cast(rays: Array, rectangles: list[Rectangle], noise_m: float, rng: np.random.Generator) -> Array:
    best = np.full(len(rays), np.inf)
    for r in rectangles:
        normal, center = r.T[:3, 2], r.T[:3, 3]
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = (normal @ center) / (rays @ normal)
            local = (rays * reach[:, None] - center) @ r.T[:3, :2]
            ok = (reach > 0.2) & (np.abs(local[:, 0]) < r.width / 2) & (np.abs(local[:, 1]) < r.height / 2)
        best = np.where(ok & (reach < best), reach, best)
    hit = np.isfinite(best) & (best < 80)
    reach = best[hit] + noise_m * rng.standard_normal(int(hit.sum()))
    return rays[hit] * reach[:, None]


def upright(center: tuple[float, float, float], yaw_deg: float, width: float, height: float) -> Rectangle:
    """A standing rectangle whose normal is turned by yaw from the LiDAR's x axis."""
    z = rotation_from_vector(np.deg2rad([0, 0, yaw_deg]))
    R = z @ np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    return Rectangle(transform(R, np.array(center)), width, height)


def box(center: tuple[float, float, float], size: tuple[float, float, float]) -> list[Rectangle]:
    (x, y, z), (a, b, c) = center, size
    return [
        upright((x - a / 2, y, z), 0, b, c),
        upright((x + a / 2, y, z), 0, b, c),
        upright((x, y - b / 2, z), 90, a, c),
        upright((x, y + b / 2, z), 90, a, c),
        Rectangle(transform(np.eye(3), np.array([x, y, z + c / 2])), a, b),
        Rectangle(transform(np.eye(3), np.array([x, y, z - c / 2])), a, b),
    ]


def room(sensor_height_m: float = 1.2) -> list[Rectangle]:
    h = sensor_height_m
    result = [
        Rectangle(transform(np.eye(3), np.array([2.0, 0.0, -h])), 14.0, 10.0),
        Rectangle(transform(np.eye(3), np.array([2.0, 0.0, 3.0 - h])), 14.0, 10.0),
        upright((8.5, 0.0, 0.3), 0, 10.0, 3.4),
        upright((-4.0, 0.0, 0.3), 0, 10.0, 3.4),
        upright((2.0, 4.5, 0.3), 90, 14.0, 3.4),
        upright((2.0, -4.5, 0.3), 90, 14.0, 3.4),
        upright((8.45, 1.5, 0.4), 0, 0.8, 1.0),
    ]
    for center, size in (
        ((5.0, 3.2, -h + 0.4), (1.6, 0.8, 0.8)),
        ((6.0, -3.0, -h + 0.9), (0.5, 1.0, 1.8)),
        ((3.0, -3.6, -h + 0.25), (0.5, 0.5, 0.5)),
        ((-1.5, 2.0, -h + 0.5), (1.0, 1.0, 1.0)),
    ):
        result += box(center, size)
    return result


def holder(T_lidar_board: Array, board: BoardSpec, sensor_height_m: float = 1.2) -> list[Rectangle]:
    """Someone who stands beside the board, near its plane and nearly at its edge."""
    side = T_lidar_board[:3, 3] + T_lidar_board[:3, 0] * (board.diagonal_m / 2 + 0.17)
    return box((float(side[0]), float(side[1]), -sensor_height_m + 0.85), (0.25, 0.35, 1.7))
