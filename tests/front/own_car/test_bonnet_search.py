"""The own car's bonnet is found because it never moves, and nothing else is taken for it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from moving_ground import AHEAD, CAMERA, ROAD, ground, pair, shape

from stereocalib_core.config import OwnCarConfig
from stereocalib_core.files.frame_record import Done, pack, unpack
from stereocalib_core.front import own_car
from stereocalib_core.front.own_car import OwnCar, Search
from stereocalib_core.front.own_car.evidence import decided
from stereocalib_core.front.own_car.looks import Small
from stereocalib_core.front.own_car.place import Grid
from stereocalib_core.numeric.arrays import Mask
from stereocalib_core.results import DisparityMap, FrameResult, FrontEndMemory, OwnCarMemory

CONFIG = OwnCarConfig()
STEP_M = 0.9
FORWARD = np.array([0.0, 0.0, 0.0, *(-STEP_M * AHEAD)])
ENOUGH = int(np.ceil((CONFIG.apart + CONFIG.window) * ROAD.height_m / STEP_M)) + 2
"""Frames until it is decided."""


def _searched(
    kind: str, contrast: float = 12.0, frames: int = ENOUGH, search: Search | None = None
) -> Search:
    texture, search = ground(contrast), search or Search()
    for i in range(frames):
        search = own_car.go_on(search, i, pair(kind, texture, i * STEP_M, i), FORWARD, ROAD, CAMERA, CONFIG)
    return search


def _covered(own: OwnCar | None) -> Mask:
    """(H, W) of the picture."""
    empty = DisparityMap(np.zeros((CAMERA.height, CAMERA.width), np.float32), 1)
    return np.zeros(empty.values.shape, np.bool_) if own is None else own.covers(empty)


@pytest.mark.parametrize("kind", ["curved", "glossy", "dark", "flat", "corner"])
def test_a_bonnet_is_found_to_the_block(kind: str) -> None:
    own = _searched(kind).found(CAMERA, CONFIG)
    assert own is not None
    covered, painted = _covered(own), shape(kind, right=False)
    assert np.mean(covered[painted]) > 0.97
    # beyond its edge no more than the matcher's window and two blocks
    wide = np.lib.stride_tricks.sliding_window_view(np.pad(painted, 10), (21, 21)).any(axis=(2, 3))
    assert np.mean(covered[~wide]) < 0.01
    rows = np.flatnonzero(painted.any(axis=1))
    assert abs(own.rows_px(CAMERA.height) - len(rows)) <= 4


ROADS = [
    (kind, contrast) for kind in ("", "shadow", "lamps", "fog", "night") for contrast in (12.0, 1.0, 0.0)
]
ROADS.remove(("shadow", 0.0))  # an edge on a road of which nothing else is seen: nobody can tell


@pytest.mark.parametrize(("kind", "contrast"), ROADS)
def test_a_road_is_no_bonnet(kind: str, contrast: float) -> None:
    search = _searched(kind, contrast)
    assert search.memory.evidence is None and search.pictures == {}  # it is decided
    assert search.memory.tops is None


def test_black_borders_are_found() -> None:
    own = _searched("borders").found(CAMERA, CONFIG)
    covered = _covered(own)
    assert covered[:, :18].all() and covered[:, -10:].all() and covered[-13:].all()
    assert not covered[:130, 30:-20].any()


def test_a_car_that_stands_is_none_the_wiser() -> None:
    texture, search = ground(12.0), Search()
    for i in range(60):
        still = pair("curved", texture, 0.0, i)
        search = own_car.go_on(search, i, still, np.zeros(6), ROAD, CAMERA, CONFIG)
    assert search.memory.tops is None and search.memory.evidence is None


def test_where_the_motion_is_not_known_nothing_is_said() -> None:
    texture, search = ground(12.0), Search()
    for i in range(ENOUGH):
        search = own_car.go_on(search, i, pair("curved", texture, i * STEP_M, i), None, ROAD, CAMERA, CONFIG)
    assert search.memory.kept == () and search.memory.driven_m == 0.0


def test_it_is_looked_for_again_and_stays_where_it_is() -> None:
    rest = int(CONFIG.again * ROAD.height_m / STEP_M)
    first = _searched("curved")
    dull = np.full((CAMERA.height, CAMERA.width), 110, np.uint8)
    searched = {}
    for kind in ("curved", "", "night"):
        search = first
        for i in range(ENOUGH, rest + 2):
            search = own_car.go_on(search, i, (dull, dull), FORWARD, ROAD, CAMERA, CONFIG)
        assert search.memory.tops is first.memory.tops
        searched[kind] = _searched(kind, frames=ENOUGH + 2, search=search).memory.tops
    assert first.memory.tops is not None and searched["curved"] is not None
    assert np.mean(np.abs(searched["curved"] - first.memory.tops) <= 3) > 0.95
    assert searched[""] is None  # the camera was turned up
    assert np.array_equal(searched["night"], first.memory.tops)  # nothing was seen that speaks against it


@pytest.mark.parametrize(("evidence", "kept"), [(6, True), (-6, False)])
def test_what_is_known_stays_until_something_speaks_against_it(evidence: int, kept: bool) -> None:
    grid = Grid.of(CAMERA, CONFIG)
    tops = np.full(grid.columns, grid.rows - 8, np.int16)
    found = np.full((2, grid.rows - grid.top, grid.columns), evidence, np.int16)
    found[1] = 1
    left, right = pair("", ground(12.0), 0.0, 0)
    shown = [Small.of(left, grid, CONFIG)]
    memory = OwnCarMemory(tops, evidence=found)
    assert (decided(memory, shown, right, ROAD, CAMERA, grid, CONFIG) is tops) == kept


def test_a_search_goes_on_from_what_is_remembered_to_the_same_bytes() -> None:
    texture = ground(12.0)
    pictures = [pair("curved", texture, i * STEP_M, i) for i in range(ENOUGH)]
    search, searches = Search(), []
    for i, both in enumerate(pictures):
        search = own_car.go_on(search, i, both, FORWARD, ROAD, CAMERA, CONFIG)
        searches.append(search)
    for stop in (0, 3, ENOUGH // 2, ENOUGH - 4, ENOUGH - 1):
        done = Done(FrameResult(stop, 0.0, None), FrontEndMemory(stop, None, searches[stop].memory), 1.0)
        memory = unpack(pack(done)).memory.own_car
        left = {frame: pictures[frame][0] for frame, _ in memory.kept}
        again = own_car.take_up(memory, left, CAMERA, CONFIG)
        for i in range(stop + 1, ENOUGH):
            again = own_car.go_on(again, i, pictures[i], FORWARD, ROAD, CAMERA, CONFIG)
        result = FrameResult(ENOUGH, 0.0, None)
        both_ends = [pack(Done(result, FrontEndMemory(None, None, s.memory), 1.0)) for s in (again, search)]
        assert both_ends[0] == both_ends[1]


def test_frames_are_numbered_from_where_a_run_began() -> None:
    memory = _searched("curved", frames=8).memory
    moved = memory.numbered_from(3)
    assert [k[0] for k in moved.kept] == [k[0] - 3 for k in memory.kept]
    assert dataclasses.replace(moved, kept=memory.kept) is not memory
