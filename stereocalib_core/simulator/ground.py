"""The road's surface: a ribbon along the course with camber, kerbs, humps and ramps, and its best-fit plane.

The ribbon is the mesh that is rendered; heights are read from that same mesh: truth and picture agree.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

from stereocalib_core.config.scene import (
    AHEAD_M,
    BEHIND_M,
    CAMBER_DROP_M,
    COLUMNS_M,
    CROWN_M,
    FIT_FAR_M,
    FIT_NEAR_M,
    FIT_SPREAD_M,
    FLAT_CURVATURE,
    HUMP_HEIGHT_M,
    HUMP_LENGTH_M,
    KERB_HEIGHT_M,
    KERB_WIDTH_M,
    LANE_EDGE_M,
    LEFT_KERB_M,
    RIGHT_KERB_M,
    STEP_M,
)
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.simulator.path import Course


@dataclass(frozen=True)
class Ramp:
    """The road climbs at `slope` from `start_m`, stays up until `end_m`, and comes down again."""

    start_m: float
    end_m: float
    slope: float = 0.12
    rise_m: float = 1.8

    def height(self, s_m: ArrayLike) -> Array:
        """Height above the road without the ramp [m]."""
        s = np.asarray(s_m, dtype=np.float64)
        up = np.minimum(np.maximum(s - self.start_m, 0.0), np.maximum(self.end_m - s, 0.0)) * self.slope
        return np.minimum(up, self.rise_m)


@dataclass(frozen=True)
class Ground:
    """The ribbon mesh. rows_s_m: (R,); height_m: (R, C) Y of every vertex less the course's own (Y down)."""

    course: Course
    rows_s_m: Array
    height_m: Array
    flat: bool

    def vertices(self) -> Array:
        """(R, C, 3) world points of the mesh."""
        return self._at_vertices(self.rows_s_m[:, None], COLUMNS_M[None, :], self.height_m)

    def _at_vertices(self, s: Array, t: Array, extra: Array) -> Array:
        points = self.course.points(s, t)
        points[..., 1] += extra
        return points

    def extra_height(self, s_m: ArrayLike, t_m: ArrayLike) -> Array:
        """Y of the mesh less the course's own at s, t, bilinear between its vertices."""
        s, t = np.broadcast_arrays(np.asarray(s_m, dtype=np.float64), np.asarray(t_m, dtype=np.float64))
        row = np.clip(np.searchsorted(self.rows_s_m, s, side="right") - 1, 0, len(self.rows_s_m) - 2)
        column = np.clip(np.searchsorted(COLUMNS_M, t, side="right") - 1, 0, len(COLUMNS_M) - 2)
        a = (s - self.rows_s_m[row]) / (self.rows_s_m[row + 1] - self.rows_s_m[row])
        b = (t - COLUMNS_M[column]) / (COLUMNS_M[column + 1] - COLUMNS_M[column])
        h = self.height_m
        near = (1 - b) * h[row, column] + b * h[row, column + 1]
        far = (1 - b) * h[row + 1, column] + b * h[row + 1, column + 1]
        return (1 - a) * near + a * far

    def surface(self, s_m: ArrayLike, t_m: ArrayLike) -> Array:
        """(..., 3) world points of the road's surface at s, t."""
        s, t = np.broadcast_arrays(np.asarray(s_m, dtype=np.float64), np.asarray(t_m, dtype=np.float64))
        return self._at_vertices(s, t, self.extra_height(s, t))

    def coordinates(self, points_xz: Array, s_start_m: Array) -> tuple[Array, Array]:
        """s, t of ground points (..., 2), looked for from `s_start_m` (...) on, at most 30 m away from there."""
        course = self.course
        s = s_start_m.copy()
        t = np.zeros_like(s)
        for _ in range(6):
            heading = course.at(course.heading_rad, s)
            line = course.points(s)
            dx, dz = points_xz[..., 0] - line[..., 0], points_xz[..., 1] - line[..., 2]
            along = dx * np.sin(heading) + dz * np.cos(heading)
            t = dx * np.cos(heading) - dz * np.sin(heading)
            # a step of s moves a point at offset t by 1 - curvature t
            lever = np.maximum(1.0 - course.at(course.curvature, s % self._lap) * t, 0.4)
            s = np.clip(s + along / lever, s_start_m - 30.0, s_start_m + 30.0)
        return s, t

    @property
    def _lap(self) -> float:
        return self.course.length_m if self.course.closed else np.inf

    def lane_planes(self, camera_xz: Array, heading_rad: Array, s_m: Array) -> tuple[Array, Array]:
        """The planes that least-squares fit the own lane ahead of cameras, |X| <= 1.75 m and 4-20 m ahead.

        camera_xz (N, 2) in the world, heading_rad (N,) of travel, s_m (N,). Where the road bends away, what is
        still road counts. Unit normals (N, 3) pointing down and offsets (N,).
        """
        z = _middles(FIT_NEAR_M, FIT_FAR_M, 32)[None, :, None]
        x = _middles(-LANE_EDGE_M, LANE_EDGE_M, 14)[None, None, :]
        sine, cosine = np.sin(heading_rad)[:, None, None], np.cos(heading_rad)[:, None, None]
        world_x = camera_xz[:, 0, None, None] + z * sine + x * cosine
        world_z = camera_xz[:, 1, None, None] + z * cosine - x * sine
        start = np.broadcast_to(s_m[:, None, None] + z, world_x.shape)
        s, t = self.coordinates(np.stack([world_x, world_z], axis=-1), start)
        points = self.surface(s, t)
        points[..., 0], points[..., 2] = world_x, world_z
        points = points.reshape(len(s_m), -1, 3)
        weight = (
            np.ones(t.shape) if self.flat else ((t > LEFT_KERB_M) & (t < RIGHT_KERB_M)).astype(np.float64)
        )
        weight = weight.reshape(len(s_m), -1, 1)
        center = (weight * points).sum(axis=1) / weight.sum(axis=1)
        rest = points - center[:, None]
        _, axes = np.linalg.eigh(np.einsum("nij,nik->njk", weight * rest, rest))
        normals = axes[:, :, 0] * np.where(axes[:, 1:2, 0] > 0, 1.0, -1.0)
        return normals, np.sum(normals * center, axis=1)


def _middles(low: float, high: float, count: int) -> Array:
    """Middles of equal cells: sums over them weigh a surface evenly."""
    return low + (high - low) * (np.arange(count) + 0.5) / count


def _crown_share(course: Course) -> Array:
    """How much of the crown is left at every sample of the course: bends are flat across, as roads are built."""
    bend = np.clip(np.abs(course.curvature) / FLAT_CURVATURE, 0.0, 1.0)
    mode = "wrap" if course.closed else "nearest"
    spread = maximum_filter1d(bend, round(FIT_SPREAD_M / STEP_M), mode=mode)
    return 1.0 - gaussian_filter1d(spread, 4.0 / STEP_M, mode=mode)


def build_ground(
    course: Course, camber: float, humps_s_m: tuple[float, ...], ramps: tuple[Ramp, ...], flat: bool
) -> Ground:
    """The ribbon over a course; `flat` has no camber, kerbs or pavement."""
    end = course.length_m + (AHEAD_M + 10.0 if course.closed else 0.0)
    start = -BEHIND_M - 5.0 if course.closed else 0.0
    rows = [start]
    bent = np.abs(course.curvature) > 1e-3
    hilly = bool(np.any(course.y_m != course.y_m[0]))
    marks = [h % course.length_m for h in humps_s_m] + [m for r in ramps for m in (r.start_m, r.end_m)]
    while rows[-1] < end - 1e-9:
        s = rows[-1]
        turning = course.at(bent.astype(np.float64), s % course.length_m) > 0 or hilly
        near = any(abs((s - m + 3) % course.length_m - 3) < 3.0 for m in marks) or any(
            r.start_m - 1 < s < r.end_m + 1 for r in ramps
        )
        rows.append(min(s + (0.2 if near else 0.5 if turning else 1.0), end))
    rows_s = np.array(rows)
    s_m, t = rows_s[:, None], COLUMNS_M[None, :]
    height = np.zeros((len(rows_s), len(COLUMNS_M)))
    if not flat:
        half = LANE_EDGE_M - CROWN_M
        off = np.abs(t - CROWN_M) / half
        crown = np.where(off < 1.0, off**2, 2 * off - 1.0) - (CROWN_M / half) ** 2
        edge = np.maximum(t - RIGHT_KERB_M, LEFT_KERB_M - t)
        kerb = np.clip(edge / KERB_WIDTH_M, 0.0, 1.0) * KERB_HEIGHT_M
        share = course.at(_crown_share(course), s_m % course.length_m if course.closed else s_m)
        height = height + camber * share * CAMBER_DROP_M * np.minimum(crown, 1.5) - kerb
        on_road = (t > LEFT_KERB_M - 0.01) & (t < RIGHT_KERB_M + 0.01)
        for hump in humps_s_m:
            away = np.abs((s_m - hump + course.length_m / 2) % course.length_m - course.length_m / 2)
            bump = 0.5 + 0.5 * np.cos(2 * np.pi * np.minimum(away / HUMP_LENGTH_M, 0.5))
            height = height - np.where(on_road, HUMP_HEIGHT_M * bump, 0.0)
    for ramp in ramps:
        height = height - ramp.height(s_m)
    return Ground(course, rows_s, height, flat)
