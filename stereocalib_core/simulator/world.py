"""The town: everything that stands, and what moves, along a course."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.config.scene import (
    AMBIENT,
    COLUMNS_M,
    LEFT_KERB_M,
    ONCOMING_M,
    ONCOMING_SPEED,
    RIGHT_KERB_M,
    SUN,
    SUNLIGHT,
    TRUCK_AHEAD_M,
)
from stereocalib_core.geometry import rotation_y
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.simulator import painting
from stereocalib_core.simulator.drive import Drive
from stereocalib_core.simulator.furniture import Furniture, Instance, furnish
from stereocalib_core.simulator.ground import Ground
from stereocalib_core.simulator.meshes import Mesh, join, triangles
from stereocalib_core.simulator.raster import FLAG_GROUND
from stereocalib_core.simulator.roadmap import plain_map, street_map
from stereocalib_core.simulator.shade import ROAD, UNKNOWN
from stereocalib_core.simulator.textures import Atlas, build_atlas


@dataclass(frozen=True)
class World:
    """What the renderer needs of the town.

    mesh: all triangles; ground_rows (R,) first ground triangle of every row of the ribbon and rows_s_m its s;
    templates: triangle range and radius of each kind of thing; standing: things that do not move, with their
    positions (S, 3) and radii (S,).
    textures of the ground: grain, road map and sky; map_texel_m: the road map's texel along s.
    """

    mesh: Mesh
    atlas: Atlas
    ground_row_triangles: int
    rows_s_m: Array
    rest: tuple[int, int]
    templates: dict[str, tuple[int, int, float]]
    standing: tuple[Instance, ...]
    positions: Array
    radii: Array
    map_texel_m: float
    drive: Drive


TEXTURE_GRAIN, TEXTURE_MAP, TEXTURE_SKY, TEXTURE_GRASS = 0, 1, 2, 3


@lru_cache(maxsize=2)
def common_textures(seed: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8], NDArray[np.uint8]]:
    """Asphalt grain, sky and grass."""
    rng = np.random.default_rng([seed, 33])
    return painting.grain(rng), painting.sky(rng), painting.grass(rng)


def build_world(drive: Drive) -> World:
    """Paint, place and join everything; a second or two."""
    settings = drive.settings
    rng = np.random.default_rng([settings.seed, 31])
    bare = drive.ground.flat
    with ThreadPoolExecutor(1) as painter:
        common = painter.submit(common_textures, settings.seed)
        road = plain_map(rng, drive.course) if bare else street_map(rng, drive.course)
        textures = [road.albedo] * 4
        furniture = Furniture((), {}) if bare else furnish(drive, road, textures, rng, SUN)
        textures[TEXTURE_GRAIN], textures[TEXTURE_SKY], textures[TEXTURE_GRASS] = common.result()
    textures[TEXTURE_MAP] = road.finished()
    ground = ground_mesh(drive.ground)
    parts = [ground]
    templates: dict[str, tuple[int, int, float]] = {}
    first = len(ground)
    rest = (first, first)
    if not bare:
        terrain = terrain_mesh(drive)
        parts.append(terrain)
        first += len(terrain)
        rest = (rest[0], first)
    for name, mesh in furniture.templates.items():
        radius = float(np.linalg.norm(mesh.vertices, axis=-1).max())
        templates[name] = (first, first + len(mesh), radius)
        parts.append(mesh)
        first += len(mesh)
    per_row = 2 * (len(COLUMNS_M) - 1)
    return World(
        join(parts),
        build_atlas(textures),
        per_row,
        drive.ground.rows_s_m,
        rest,
        templates,
        furniture.standing,
        np.array([thing.position for thing in furniture.standing]).reshape(-1, 3),
        np.array([templates[thing.kind][2] for thing in furniture.standing]),
        road.texel_s_m,
        drive,
    )


def ground_mesh(ground: Ground) -> Mesh:
    """The ribbon's triangles, row after row, with s, t [m] as coordinates."""
    points = ground.vertices()
    wide = 12.0 if ground.flat else 1.0
    columns = COLUMNS_M * wide
    if ground.flat:
        points = ground.course.points(ground.rows_s_m[:, None], columns[None, :])
    n, m = points.shape[:2]
    i, j = (a.ravel() for a in np.mgrid[0 : n - 1, 0 : m - 1])
    corners = np.stack(
        [np.stack([(i, j), (i + 1, j), (i + 1, j + 1)]), np.stack([(i, j), (i + 1, j + 1), (i, j + 1)])]
    )
    a, b = (
        corners[:, :, 0].transpose(2, 0, 1).reshape(-1, 3),
        corners[:, :, 1].transpose(2, 0, 1).reshape(-1, 3),
    )
    coordinates = np.stack([ground.rows_s_m[a], columns[b]], axis=-1)
    up = np.tile([0.0, -1.0, 0.0], (len(a), 1))
    mesh = triangles(
        points[a, b], coordinates, 0, 1.0 / (AMBIENT + SUNLIGHT * -SUN[1]), None, FLAG_GROUND, ROAD, up
    )
    middle = coordinates[..., 1].mean(axis=1)
    if not ground.flat:
        off = (middle < LEFT_KERB_M - 0.01) | (middle > RIGHT_KERB_M + 0.01)
        mesh.labels[off] = UNKNOWN
    return mesh


def terrain_mesh(drive: Drive) -> Mesh:
    """Grass around and a little below the ribbon."""
    course = drive.course
    line = np.stack([course.x_m, course.y_m, course.z_m], axis=1)[::40]
    low, high = line.min(axis=0) - 160.0, line.max(axis=0) + 160.0
    cell = 10.0
    x = np.arange(low[0], high[0], cell)
    z = np.arange(low[2], high[2], cell)
    grid_x, grid_z = np.meshgrid(x, z, indexing="ij")
    y = np.full(grid_x.shape, float(line[0, 1]) + 0.25)
    if np.ptp(line[:, 1]) > 0.01:
        away = (grid_x[..., None] - line[:, 0]) ** 2 + (grid_z[..., None] - line[:, 2]) ** 2
        weight = 1.0 / (away + 100.0) ** 2
        y = (weight * line[:, 1]).sum(-1) / weight.sum(-1) + 0.8
    points = np.stack([grid_x, y, grid_z], axis=-1)
    i, j = (a.ravel() for a in np.mgrid[0 : len(x) - 1, 0 : len(z) - 1])
    corners = np.concatenate(
        [np.stack([(i, j), (i + 1, j), (i + 1, j + 1)]), np.stack([(i, j), (i + 1, j + 1), (i, j + 1)])],
        axis=2,
    )
    a, b = corners[:, 0].T, corners[:, 1].T
    vertices = points[a, b]
    up = np.tile([0.0, -1.0, 0.0], (len(a), 1))
    return triangles(vertices, vertices[..., [0, 2]] / 0.02, TEXTURE_GRASS, 0.7, None, 0, UNKNOWN, up)


def moving(world: World, frame: int) -> tuple[list[Instance], Array]:
    """What moves, at a frame: the things, and their shadows (N, 4) centre and half size in s, t [m]."""
    drive = world.drive
    settings = drive.settings
    if drive.ground.flat:
        return [], np.zeros((0, 4))
    things: list[Instance] = []
    shadows = []
    s_camera, time = float(drive.s_m[frame]), float(drive.timestamps_s[frame])

    def place(
        kind: str, s: float, t: float, turned: float, tone: float, half_length: float, half_width: float
    ) -> None:
        point = drive.ground.surface(s, t)
        heading = float(drive.course.at(drive.course.heading_rad, s)) + turned
        things.append(Instance(kind, point, rotation_y(heading), tone, s))
        lap = drive.course.length_m if drive.course.closed else 0.0
        for shift in (-lap, 0.0, lap) if lap else (0.0,):
            shadows.append((s + shift, t, half_length, half_width))

    if settings.traffic > 0:
        spacing = 95.0 / settings.traffic
        lap = drive.course.length_m
        count = max(int(lap / spacing), 1)
        rng = np.random.default_rng([settings.seed, 41])
        jitter, tones = rng.uniform(-20, 20, count), rng.choice([0.3, 0.5, 1.0, 1.3, 1.6], count)
        for k in range(count):
            s = (k * lap / count + jitter[k] + 60.0 - ONCOMING_SPEED * time) % lap
            ahead = (s - s_camera + lap / 2) % lap - lap / 2 if drive.course.closed else s - s_camera
            if -15.0 < ahead < 130.0:
                place(f"car{k % 2}", s_camera + ahead, ONCOMING_M, np.pi, float(tones[k]), 2.2, 0.95)
        leader = min(frame + 20, len(drive.motion.s_m) - 1)
        s_leader = float(drive.motion.s_m[leader]) + 12.0 + 1.6 * max(frame + 20 - leader, 0)
        if s_leader < drive.ground.rows_s_m[-1] - 3.0:
            place("car1", s_leader, 0.05, 0.0, 0.42, 2.2, 0.95)
    if any(f.kind == "truck" and f.active(frame) for f in settings.faults):
        place("truck", s_camera + TRUCK_AHEAD_M + 4.0, 0.1, 0.0, 1.0, 4.0, 1.3)
    return things, np.array(shadows) if shadows else np.zeros((0, 4))
