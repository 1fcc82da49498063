"""The search for the own car, a picture at a time: when it looks, what it compares with, and when it decides."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.config import OwnCarConfig
from stereocalib_core.front.own_car.evidence import UNIT, decided
from stereocalib_core.front.own_car.looks import Small, look_at, road_homography
from stereocalib_core.front.own_car.place import Grid, OwnCar
from stereocalib_core.geometry import Extrinsics, StereoCamera, transform
from stereocalib_core.numeric.arrays import Array, Grey
from stereocalib_core.numeric.small_algebra import rotation_from_vector
from stereocalib_core.results import OwnCarMemory


@dataclass(frozen=True)
class Search:
    """The search for the own car: what is remembered of it, and the pictures that it names, by frame."""

    memory: OwnCarMemory = OwnCarMemory()
    pictures: Mapping[int, Small] = field(default_factory=dict)

    def found(self, camera: StereoCamera, config: OwnCarConfig) -> OwnCar | None:
        """The own car, as far as it is known."""
        return found_by(self.memory, camera, config)


def found_by(memory: OwnCarMemory, camera: StereoCamera, config: OwnCarConfig) -> OwnCar | None:
    """The own car, as far as it is remembered."""
    return None if memory.tops is None else OwnCar(memory.tops, Grid.of(camera, config))


def go_on(
    search: Search,
    index: int,
    pair: tuple[Grey, Grey],
    motion: Array | None,
    road: Extrinsics,
    camera: StereoCamera,
    config: OwnCarConfig,
) -> Search:
    """The search after one more pair, left and right.

    motion: (6,) of T_current_previous into it, None = not known: then it is compared with none right before it.
    road: that of this pair, or the last one known.
    """
    memory, height_m = search.memory, road.height_m
    if motion is None:
        return replace(search, memory=replace(memory, T=None))
    step_m = float(np.linalg.norm(motion[3:]))
    driven_m = memory.driven_m + step_m
    if memory.evidence is None and memory.kept == () and memory.driven_m > 0.0:
        resting = driven_m < config.again * height_m
        return Search(replace(memory, driven_m=driven_m) if resting else OwnCarMemory(memory.tops))
    T = None if memory.T is None else transform(rotation_from_vector(motion[:3]), motion[3:]) @ memory.T
    memory = replace(memory, driven_m=driven_m, since_m=memory.since_m + step_m, T=T)
    if T is not None and memory.since_m < config.step * height_m:
        return replace(search, memory=memory)
    grid = Grid.of(camera, config)
    now = Small.of(pair[0], grid, config)
    memory = _looked(memory, search.pictures, now, road, camera, grid, config)
    pictures = {**search.pictures, index: now}
    if memory.driven_m >= (config.apart + config.window) * height_m:
        shown = [pictures[frame] for frame, _ in memory.kept]
        tops = decided(memory, [*shown, now], pair[1], road, camera, grid, config)
        return Search(OwnCarMemory(tops, driven_m))
    kept = _kept(memory, index, config.apart * height_m)
    memory = replace(memory, kept=kept, since_m=0.0, T=np.eye(4))
    return Search(memory, {frame: pictures[frame] for frame, _ in kept})


def _kept(memory: OwnCarMemory, index: int, apart_m: float) -> tuple[tuple[int, float], ...]:
    """The pictures to compare with from now on: this one, one of some metres before, and one of before that."""
    here = (index, memory.driven_m)
    if not memory.kept:
        return (here, here, here)
    _, young, old = memory.kept
    return (here, here, young) if memory.driven_m - young[1] >= apart_m else (here, young, old)


def _planes(small: Small) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    return small.detail, small.light


def _looked(
    memory: OwnCarMemory,
    pictures: Mapping[int, Small],
    now: Small,
    road: Extrinsics,
    camera: StereoCamera,
    grid: Grid,
    config: OwnCarConfig,
) -> OwnCarMemory:
    """The memory with the evidence of one more picture, where there are others to compare it with."""
    if memory.T is None or not memory.kept or now.light.mean() < config.least_grey:
        return memory
    before, _, old = memory.kept
    if memory.driven_m - old[1] < config.apart * road.height_m:
        return memory
    found = np.zeros((grid.rows - grid.top, grid.columns))
    seen = np.zeros(found.shape, np.bool_)
    H = road_homography(camera, grid.by, road, memory.T)
    look_at(
        now.detail, now.light, *_planes(pictures[before[0]]), *_planes(pictures[old[0]]), H, grid.block, grid.top,
        config.noise, config.most_sigmas, config.least_shift, found, seen,
    )  # fmt: skip
    more = np.stack([np.rint(UNIT * found), seen]).astype(np.int16)
    return replace(memory, evidence=more if memory.evidence is None else memory.evidence + more)


def take_up(
    memory: OwnCarMemory, pictures: Mapping[int, Grey], camera: StereoCamera, config: OwnCarConfig
) -> Search:
    """The search as it was when it was remembered; pictures: the left ones of the frames that `memory.kept` names."""
    grid = Grid.of(camera, config)
    return Search(memory, {frame: Small.of(pictures[frame], grid, config) for frame, _ in memory.kept})
