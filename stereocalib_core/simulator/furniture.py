"""Where houses, trees, cars, poles and hedges stand along a course, and what shade they throw on its road."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from stereocalib_core.config.scene import CAR_TONES, CLEAR_M, HOUSES, TREES
from stereocalib_core.geometry import rotation_y
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.simulator import meshes, painting
from stereocalib_core.simulator.drive import Drive
from stereocalib_core.simulator.meshes import Mesh
from stereocalib_core.simulator.roadmap import RoadMap, course_tree


@dataclass(frozen=True)
class Instance:
    """One thing of a kind: `position` (3,), `rotation` (3, 3) to the world, brightness `tone`, where along s [m]."""

    kind: str
    position: Array
    rotation: Array
    tone: float
    s_m: float


@dataclass(frozen=True)
class Furniture:
    """Things that stand, and the meshes of all kinds."""

    standing: tuple[Instance, ...]
    templates: dict[str, Mesh]


@lru_cache(maxsize=2)
def templates(seed: int, first: int) -> tuple[tuple[NDArray[np.uint8], ...], dict[str, Mesh]]:
    """The textures and the mesh of every kind of thing; the textures will be numbered from `first` on."""
    rng = np.random.default_rng([seed, 32])
    textures: list[NDArray[np.uint8]] = []

    def add(*images: NDArray[np.uint8]) -> int:
        textures.extend(images)
        return first + len(textures) - len(images)

    facades = [add(painting.facade(rng)) for _ in range(painting.FACADES)]
    roof, bark, plaster = add(painting.roof(rng)), add(painting.bark(rng)), add(painting.plaster(rng))
    leaves, bush = add(*painting.foliage(rng)), add(painting.hedge(rng))
    cars = [
        (
            add(painting.car_side(rng, k)),
            add(painting.car_top(rng, k)),
            add(painting.car_end(rng, False)),
            add(painting.car_end(rng, True)),
        )
        for k in range(2)
    ]
    kinds: dict[str, Mesh] = {}
    for k, parts in enumerate(cars):
        kinds[f"car{k}"] = meshes.car(*parts, style=k)
    for k in range(HOUSES):
        eaves = (3.1, 5.9, 5.9, 8.4)[k % 4]
        size = float(rng.uniform(9, 15)), float(rng.uniform(8, 11))
        kinds[f"house{k}"] = meshes.house(
            *size,
            eaves,
            float(rng.uniform(2.0, 4.2)),
            facades[k % len(facades)],
            roof,
            float(rng.uniform(0.8, 1.25)),
            float(rng.uniform(0.6, 1.2)),
        )
    for k in range(TREES):
        crown, tall = rng.uniform(1.7, 3.6), rng.uniform(3.5, 7.0)
        kinds[f"tree{k}"] = meshes.tree(
            rng, bark, leaves, float(rng.uniform(1.6, 2.6)), float(crown), float(tall), int(21 * crown)
        )
    kinds["bush"] = meshes.tree(rng, bark, leaves, 0.0, 0.9, 1.5, 22)
    kinds["hedge"] = meshes.box((0.7, 1.25, 5.0), bush, 0.007)
    kinds["wall"] = meshes.box((0.25, 0.95, 5.0), plaster, 0.03, 0.9)
    kinds["bin"] = meshes.box((0.6, 1.05, 0.6), plaster, 0.03, 0.35)
    kinds["lamp"] = meshes.join(
        [
            meshes.pole(6.5, 0.08, plaster, 0.45),
            meshes.box((1.1, 0.12, 0.22), plaster, 0.03, 0.5).moved(np.eye(3), np.array([-0.5, -6.4, 0.0])),
        ]
    )
    kinds["sign"] = meshes.join(
        [
            meshes.pole(2.7, 0.035, plaster, 0.7),
            meshes.box((0.6, 0.6, 0.03), facades[0], 0.01, 1.3).moved(np.eye(3), np.array([0.0, -2.1, 0.0])),
        ]
    )
    kinds["truck"] = meshes.join(
        [
            meshes.box((2.5, 2.7, 7.5), plaster, 0.03, 1.25).moved(np.eye(3), np.array([0.0, -1.05, 0.0])),
            meshes.box((2.3, 1.15, 7.2), plaster, 0.03, 0.22),
        ]
    )
    return tuple(textures), kinds


def furnish(
    drive: Drive, road: RoadMap, textures: list[NDArray[np.uint8]], rng: np.random.Generator, sun: Array
) -> Furniture:
    """Place everything, shade the road map, and append the textures."""
    painted, kinds = templates(drive.settings.seed, len(textures))
    textures.extend(painted)
    course = drive.course
    near = course_tree(course)
    taken: list[tuple[Array, float]] = []
    standing: list[Instance] = []

    def stand(kind: str, s: float, t: float, turned: float = 0.0, tone: float = 1.0) -> Instance:
        heading = float(course.at(course.heading_rad, s)) + turned
        point = drive.ground.surface(s, float(np.clip(t, -12.79, 12.79)))
        point[[0, 2]] = course.points(s, t)[[0, 2]]
        thing = Instance(kind, point, rotation_y(heading), tone, s % course.length_m if course.closed else s)
        standing.append(thing)
        return thing

    def free(position: Array, radius: float, clear: float) -> bool:
        if near.query(position[[0, 2]])[0] < clear:
            return False
        return all(np.hypot(*(position - p)[[0, 2]]) > radius + r for p, r in taken)

    _houses(drive, kinds, stand, near, taken, road, rng, sun)
    length = course.length_m
    for side in (-1, 1):
        s = float(rng.uniform(0, 6))
        while s < length - 3:
            t = -7.3 if side < 0 else 6.2
            t = t if rng.random() < 0.65 else side * rng.uniform(8.5, 11.5)
            position = course.points(s, t)
            if free(position, 0.3, 5.6):
                kind = f"tree{rng.integers(0, TREES)}"
                thing = stand(kind, s, t, float(rng.uniform(0, 6.28)), float(rng.uniform(0.75, 1.1)))
                top = -float(kinds[kind].vertices[..., 1].min())
                crown = float(np.abs(kinds[kind].vertices[..., 0]).max())
                middle = np.array([0.0, -0.62 * top, 0.0])
                road.dapple(thing.position + middle, crown, 0.7 * top, s, sun, rng)
            s += float(rng.uniform(6, 17))
        s = float(rng.uniform(0, 4))
        while s < length - 4:
            t = side * (8.6 if side < 0 else 7.3)
            roll = rng.random()
            kind = "hedge" if roll < 0.5 else "wall" if roll < 0.75 else "bush"
            if roll < 0.85 and near.query(course.points(s, t)[[0, 2]])[0] > abs(t) - 0.3:
                stand(kind, s, t, 0.0, float(rng.uniform(0.7, 1.2)))
            s += 5.2
        for s in np.arange(4.0, length - 3, 31.0):
            t = -5.9 if side < 0 else 4.6
            if near.query(course.points(s, t)[[0, 2]])[0] > 4.4:
                thing = stand("lamp" if rng.random() < 0.7 else "sign", s, t, np.pi if side < 0 else 0.0)
                line = thing.position + np.array(
                    [[0, 0, 0.06], [0, 0, -0.06], [0, -6.5, 0.06], [0, -6.5, -0.06]]
                )
                road.shadow(line, float(s), sun)
        for s in np.arange(9.0, length - 3, 23.0):
            if rng.random() < 0.6:
                stand(
                    "bin",
                    s + rng.uniform(-6, 6),
                    (-7.6 if side < 0 else 6.1),
                    0.0,
                    float(rng.uniform(0.5, 2.0)),
                )
    if drive.settings.traffic > 0:
        _parked(drive, stand, road, kinds, rng, sun)
    return Furniture(tuple(standing), kinds)


def _houses(
    drive: Drive,
    kinds: dict[str, Mesh],
    stand: Callable[..., Instance],
    near: cKDTree,
    taken: list[tuple[Array, float]],
    road: RoadMap,
    rng: np.random.Generator,
    sun: Array,
) -> None:
    course = drive.course
    for side in (-1, 1):
        s = 0.0
        while s < course.length_m - 4:
            kind = f"house{rng.integers(0, HOUSES)}"
            v = kinds[kind].vertices
            width, depth = float(np.ptp(v[..., 0])), float(v[..., 2].max())
            front = (11.2 if side < 0 else 9.8) + rng.uniform(0, 3.0)
            s_mid = s + width / 2
            heading = float(course.at(course.heading_rad, s_mid)) + (np.pi / 2 if side > 0 else -np.pi / 2)
            base = course.points(s_mid, side * front)
            local = np.array([[x, 0, z] for x in (-width / 2, 0, width / 2) for z in (0, depth / 2, depth)])
            corners = local @ rotation_y(heading).T + base
            middle = corners[4]
            radius = 0.5 * min(width, depth)
            clear = near.query(corners[:, [0, 2]])[0].min() > CLEAR_M
            apart = all(np.hypot(*(middle - p)[[0, 2]]) > radius + r + 1.0 for p, r in taken)
            if clear and apart:
                turned = np.pi / 2 if side > 0 else -np.pi / 2
                thing = stand(kind, s_mid, side * front, turned, float(rng.uniform(0.85, 1.1)))
                taken.append((middle, radius))
                outline = v.reshape(-1, 3) @ thing.rotation.T + thing.position
                road.shadow(outline, s_mid, sun)
                s += width + float(rng.choice([1.0, 3.0, 6.0, 14.0]))
            else:
                s += 3.0


def _parked(
    drive: Drive,
    stand: Callable[..., Instance],
    road: RoadMap,
    kinds: dict[str, Mesh],
    rng: np.random.Generator,
    sun: Array,
) -> None:
    s = 6.0
    while s < drive.course.length_m - 6:
        if rng.random() < 0.55:
            kind = f"car{rng.integers(0, 2)}"
            turned = float(rng.normal(0, 0.02))
            thing = stand(kind, s, 2.95 + rng.normal(0, 0.06), turned, float(rng.choice(CAR_TONES)))
            outline = kinds[kind].vertices.reshape(-1, 3) @ thing.rotation.T + thing.position
            road.shadow(outline, s, sun, 70)
            flat = outline.copy()
            flat[:, 1] = thing.position[1]
            road.shadow(flat, s, sun, 40)
        s += float(rng.uniform(5.3, 9.5))
