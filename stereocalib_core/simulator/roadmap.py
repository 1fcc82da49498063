"""The map painted along the road, s across and t down: asphalt, markings, cracks, paving, and the sun's shadows."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from stereocalib_core.config.scene import (
    CROWN_M,
    HALF_WIDTH_M,
    LANE_EDGE_M,
    LEFT_KERB_M,
    PAVEMENT_LEFT_M,
    PAVEMENT_RIGHT_M,
    RIGHT_KERB_M,
    STEP_M,
)
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.simulator.path import Course
from stereocalib_core.simulator.shade import ROAD_TEXEL_M
from stereocalib_core.simulator.textures import tileable_noise

ROWS = 1024
ASPHALT_GREY = 96
SHADE_GREY = 74
"""What is left of sunlight in the shade, of 255."""


@dataclass
class RoadMap:
    """Albedo and light along the road, each (ROWS, W) uint8; one texel is `texel_s_m` by `ROAD_TEXEL_M`."""

    albedo: NDArray[np.uint8]
    light: NDArray[np.uint8]
    texel_s_m: float
    course: Course

    def finished(self) -> NDArray[np.uint8]:
        """The texture, t = 0 in row 0."""
        lit = cv2.multiply(self.albedo, self.light, scale=1 / 255.0)
        return np.roll(np.asarray(lit, dtype=np.uint8), -ROWS // 2, axis=0)

    def pixels(self, s_m: Array, t_m: Array) -> NDArray[np.int32]:
        """(N, 2) x, y of points, sixteen steps a texel."""
        x = s_m / self.texel_s_m - 0.5
        y = (t_m + HALF_WIDTH_M) / ROAD_TEXEL_M - 0.5
        return np.rint(np.stack([x, y], axis=-1) * 16).astype(np.int32)

    def rows(self, t0_m: float, t1_m: float) -> slice:
        """The rows of a strip."""
        return slice(
            max(round((t0_m + HALF_WIDTH_M) / ROAD_TEXEL_M), 0),
            min(round((t1_m + HALF_WIDTH_M) / ROAD_TEXEL_M), ROWS),
        )

    def shadow(self, points_world: Array, s_near_m: float, sun: Array, depth: int = SHADE_GREY) -> None:
        """Darken the shadow of the hull of points (N, 3)."""
        ground = points_world[:, [0, 2]] + (points_world[:, 1] / sun[1])[:, None] * -sun[[0, 2]]
        hull = cv2.convexHull(ground.astype(np.float32))[:, 0].astype(np.float64)
        edge = np.concatenate(
            [np.linspace(a, b, 12, endpoint=False) for a, b in zip(hull, np.roll(hull, -1, 0), strict=True)]
        )
        s, t = road_coordinates(self.course, edge, s_near_m)
        self._darken([self.pixels(s, t)], depth)

    def _darken(self, polygons: list[NDArray[np.int32]], depth: int) -> None:
        width = self.light.shape[1] * 16
        for polygon in polygons:
            for lap in (-width, 0, width):
                moved = polygon + np.array([lap, 0], np.int32)
                if moved[:, 0].max() > 0 and moved[:, 0].min() < width:
                    cv2.fillPoly(self.light, [moved], float(depth), cv2.LINE_AA, 4)

    def dapple(
        self,
        center_world: Array,
        radius: float,
        tall: float,
        s_near_m: float,
        sun: Array,
        rng: np.random.Generator,
    ) -> None:
        """The shade of a tree's crown: many leaves' worth of overlapping spots."""
        n = int(150 * radius)
        direction = rng.standard_normal((n, 3))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        spots = center_world + direction * (rng.random((n, 1)) ** 0.4) * np.array([radius, tall / 2, radius])
        ground = spots[:, [0, 2]] + (spots[:, 1] / sun[1])[:, None] * -sun[[0, 2]]
        s, t = road_coordinates(self.course, ground, s_near_m)
        angle = np.linspace(0, 2 * np.pi, 7)[:-1]
        reach = rng.uniform(0.07, 0.26, (n, 1)) * rng.uniform(0.6, 1.3, (n, 6))
        outlines = self.pixels(s[:, None] + reach * np.cos(angle), t[:, None] + reach * np.sin(angle))
        width = self.light.shape[1] * 16
        for outline in outlines[np.abs(t) < HALF_WIDTH_M]:
            cv2.fillConvexPoly(self.light, outline, float(SHADE_GREY), cv2.LINE_AA, 4)
            if outline[:, 0].min() < 0 or outline[:, 0].max() >= width:
                lap = width if outline[:, 0].min() < 0 else -width
                cv2.fillConvexPoly(
                    self.light, outline + np.array([lap, 0], np.int32), float(SHADE_GREY), cv2.LINE_AA, 4
                )


def road_coordinates(
    course: Course, points_xz: Array, s_near_m: float, window_m: float = 60.0
) -> tuple[Array, Array]:
    """s, t [m] of ground points (N, 2), looked for within a window of s around `s_near_m`."""
    s = np.arange(s_near_m - window_m, s_near_m + window_m, 0.25)
    if not course.closed:
        s = s[(s >= 0) & (s <= course.length_m)]
    line = course.points(s)[:, [0, 2]]
    _, nearest = cKDTree(line).query(points_xz)
    heading = course.at(course.heading_rad, s[nearest])
    rest = points_xz - line[nearest]
    along = rest[:, 0] * np.sin(heading) + rest[:, 1] * np.cos(heading)
    across = rest[:, 0] * np.cos(heading) - rest[:, 1] * np.sin(heading)
    return s[nearest] + np.clip(along, -0.25, 0.25), across


def plain_map(rng: np.random.Generator, course: Course) -> RoadMap:
    """Nothing but mottled asphalt, repeating every 25.6 m."""
    noise = tileable_noise((ROWS, ROWS), [(12, 5), (48, 7), (200, 8)], rng)
    albedo = np.clip(np.rint(ASPHALT_GREY + 24 + noise), 0, 255).astype(np.uint8)
    return RoadMap(albedo, np.full_like(albedo, 255), ROAD_TEXEL_M, course)


def street_map(rng: np.random.Generator, course: Course) -> RoadMap:
    """Everything on the road but shadows."""
    width = 1 << max(int(np.round(np.log2(course.length_m / ROAD_TEXEL_M))), 10)
    width = min(width, 1 << 16)
    texel = course.length_m / width
    noise = tileable_noise((ROWS, ROWS), [(6, 3), (14, 4), (48, 5), (160, 5), (500, 5)], rng)
    tile = np.clip(np.rint(ASPHALT_GREY + noise), 0, 255).astype(np.uint8)
    albedo = np.tile(tile, (1, width // ROWS))
    road = RoadMap(albedo, np.full_like(albedo, 255), texel, course)
    _strips(road, rng)
    _wear(road, rng)
    _markings(road)
    return road


def _strips(road: RoadMap, rng: np.random.Generator) -> None:
    """Kerbs, paving, lawn, gutter and wheel tracks."""
    width = road.albedo.shape[1]
    noise = tileable_noise((ROWS, ROWS), [(5, 7), (12, 7), (40, 8), (150, 10)], rng)
    lawn = np.clip(np.rint(84 + 1.6 * noise), 0, 255).astype(np.uint8)
    y, x = np.mgrid[0:ROWS, 0:ROWS]
    joints = ((x % 16) < 1) | ((y % 8) < 1)
    tone = rng.normal(0, 9, (ROWS // 8, ROWS // 16)).repeat(8, 0).repeat(16, 1)
    paving = np.clip(np.rint(134 + tone + 0.5 * noise - 46 * joints), 0, 255).astype(np.uint8)
    for t0, t1, tile in (
        (-HALF_WIDTH_M, PAVEMENT_LEFT_M, lawn),
        (PAVEMENT_LEFT_M, LEFT_KERB_M - 0.15, paving),
        (RIGHT_KERB_M + 0.15, PAVEMENT_RIGHT_M, paving),
        (PAVEMENT_RIGHT_M, HALF_WIDTH_M, lawn),
    ):
        rows = road.rows(t0, t1)
        road.albedo[rows] = np.tile(tile[rows], (1, width // ROWS))
    gap = max(int(1.0 / road.texel_s_m), 1)
    for t0, t1 in ((LEFT_KERB_M - 0.15, LEFT_KERB_M), (RIGHT_KERB_M, RIGHT_KERB_M + 0.15)):
        rows = road.rows(t0, t1)
        stones = rng.normal(168, 10, width // gap + 1).repeat(gap)[:width]
        stones[::gap] = 70
        road.albedo[rows] = np.clip(
            stones + rng.normal(0, 5, (rows.stop - rows.start, width)), 0, 255
        ).astype(np.uint8)
    for t0, t1, factor in (
        (LEFT_KERB_M, LEFT_KERB_M + 0.35, 0.86),
        (RIGHT_KERB_M - 0.35, RIGHT_KERB_M, 0.86),
        (LANE_EDGE_M + 0.2, RIGHT_KERB_M - 0.35, 1.12),
        (-0.95, -0.55, 0.95),
        (0.55, 0.95, 0.95),
        (-4.4, -3.9, 0.95),
        (-2.9, -2.5, 0.95),
    ):
        rows = road.rows(t0, t1)
        road.albedo[rows] = np.clip(road.albedo[rows] * np.float32(factor), 0, 255).astype(np.uint8)


def _wear(road: RoadMap, rng: np.random.Generator) -> None:
    """Patches of newer asphalt, cracks, sealed seams, covers, stains."""
    length = road.course.length_m
    for _ in range(int(length / 16)):
        s, t = rng.uniform(0, length), rng.uniform(LEFT_KERB_M + 0.5, LANE_EDGE_M)
        size = rng.uniform(0.6, 7.0), rng.uniform(0.5, 2.2)
        corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) + rng.normal(0, 0.03, (4, 2))
        polygon = road.pixels(
            s + corners[:, 0] * size[0], np.minimum(t + corners[:, 1] * size[1], RIGHT_KERB_M - 0.2)
        )
        patch = np.zeros((1, 1), np.uint8)
        x0, y0 = np.maximum(polygon.min(0) // 16 - 2, 0)
        x1, y1 = polygon.max(0) // 16 + 3
        area = road.albedo[y0:y1, x0:x1]
        if area.size == 0:
            continue
        patch = np.zeros(area.shape, np.uint8)
        cv2.fillPoly(patch, [polygon - np.array([x0, y0], np.int32) * 16], 255.0, cv2.LINE_AA, 4)
        newer = area * rng.uniform(0.72, 1.16)
        weight = patch / 255.0
        area[:] = np.clip(area * (1 - weight) + newer * weight, 0, 255).astype(np.uint8)
        cv2.polylines(road.albedo, [polygon], True, float(rng.uniform(34, 60)), 1, cv2.LINE_AA, 4)
    for _ in range(int(length / 5)):
        s, t = rng.uniform(0, length), rng.uniform(LEFT_KERB_M, RIGHT_KERB_M)
        steps = int(rng.uniform(10, 70))
        direction = rng.choice([0.0, np.pi / 2, rng.uniform(0, np.pi)])
        turn = direction + np.cumsum(rng.normal(0, 0.25, steps))
        points_s, points_t = s + np.cumsum(0.09 * np.cos(turn)), t + np.cumsum(0.09 * np.sin(turn))
        inside = (points_t > LEFT_KERB_M + 0.05) & (points_t < RIGHT_KERB_M - 0.05)
        if inside.sum() > 4:
            thick = 1 if rng.random() < 0.75 else 3
            line = road.pixels(points_s[inside], points_t[inside])
            cv2.polylines(road.albedo, [line], False, float(rng.uniform(28, 62)), thick, cv2.LINE_AA, 4)
    for t in (CROWN_M + 0.05, LANE_EDGE_M + 0.2):
        s_line = np.arange(0, length, 0.5)
        line = road.pixels(s_line, t + 0.03 * np.sin(s_line / 7.0))
        cv2.polylines(road.albedo, [line], False, 62.0, 1, cv2.LINE_AA, 4)
    for _ in range(int(length / 22)):
        s, t = rng.uniform(0, length), rng.uniform(-4.6, 1.2)
        angle = np.linspace(0, 2 * np.pi, 25)
        covers = ((0.36, 1.0, 58.0), (0.31, 1.0, 104.0), (0.25, 1.0, 70.0))
        stain = ((float(rng.uniform(0.15, 0.6)), 1.7, float(rng.uniform(62, 82))),)
        for radius, stretch, grey in covers if rng.random() < 0.5 else stain:
            ring = road.pixels(s + stretch * radius * np.cos(angle), t + radius * np.sin(angle))
            cv2.fillPoly(road.albedo, [ring], grey, cv2.LINE_AA, 4)


def _markings(road: RoadMap) -> None:
    """A broken centre line, edge lines, crossings and a stop line."""
    length = road.course.length_m

    def stripe(s0: float, s1: float, t0: float, t1: float, tone: float = 205.0) -> None:
        polygon = road.pixels(np.array([s0, s1, s1, s0]), np.array([t0, t0, t1, t1]))
        cv2.fillPoly(road.albedo, [polygon], tone, cv2.LINE_AA, 4)

    period = length / max(round(length / 12.0), 1)
    for s in np.arange(0, length, period):
        stripe(s, s + 4.0, CROWN_M - 0.06, CROWN_M + 0.06)
    for s in np.arange(0, length, period / 4):
        stripe(s, s + period / 8, LANE_EDGE_M - 0.06, LANE_EDGE_M + 0.06, 188.0)
    for s in (0.10 * length, 0.47 * length, 0.80 * length):
        for t in np.arange(LEFT_KERB_M + 0.4, LANE_EDGE_M, 1.0):
            stripe(s, s + 3.4, t, t + 0.5)
    stripe(0.457 * length, 0.457 * length + 0.5, CROWN_M + 0.1, LANE_EDGE_M - 0.1)
    # paint wears off where wheels roll
    wear = np.random.default_rng(5).random(road.albedo.shape[1] // 64) * 0.25 + 0.75
    for t0, t1 in ((-1.05, -0.45), (0.45, 1.05)):
        rows = road.rows(t0, t1)
        bright = road.albedo[rows] > 150
        worn = road.albedo[rows] * wear.repeat(64).astype(np.float32)[None, : road.albedo.shape[1]]
        road.albedo[rows] = np.where(bright, worn, road.albedo[rows]).astype(np.uint8)


def course_tree(course: Course) -> cKDTree:
    """For distances to the whole course [x, z]."""
    step = max(round(0.5 / STEP_M), 1)
    return cKDTree(np.stack([course.x_m, course.z_m], axis=1)[::step])
