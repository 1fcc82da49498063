"""The recordings at hand as others would have made them: pairs alone, a fast car, frames lost."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from stereocalib_core.config import PipelineConfig
from stereocalib_core.frames import FrameSource
from stereocalib_core.front.pipeline import FrontEnd
from stereocalib_core.front.road.carried import Moved
from stereocalib_core.front.road.doubt import step_m
from stereocalib_core.front.road.region import Region
from stereocalib_core.geometry import Extrinsics
from stereocalib_core.sources import open_source


def test_a_pair_alone_is_measured_and_says_that_it_may_be_another_plane(karlsruhe: Path) -> None:
    """Beside a bank of snow; that doubt alone is as large as what a plane may be unsure of."""
    source = open_source(str(karlsruhe))
    limits = PipelineConfig().limits
    for i in (2, 4):
        road = FrontEnd(source.camera, PipelineConfig()).step(source[i]).road
        assert road is not None
        assert road.sigma[2] > 0.8 * limits.max_roll_sigma_rad
        assert np.sqrt(road.covariance[2, 2]) < 0.5 * limits.max_roll_sigma_rad


@pytest.fixture(scope="module")
def fast(kitti_06: Path) -> tuple[FrameSource, FrontEnd]:
    """Every third pair of a drive: 130 km/h, over a road that rises and falls; with its front end after frame 36."""
    source = open_source(str(kitti_06))
    front_end = FrontEnd(source.camera, PipelineConfig())
    for k, i in enumerate(range(21, 39, 3)):
        assert front_end.step(dataclasses.replace(source[i], index=k)).road is not None
    return source, front_end


def test_a_slope_that_begins_between_two_pairs_is_no_kerb(fast: tuple[FrameSource, FrontEnd]) -> None:
    source, front_end = fast
    result = front_end.step(dataclasses.replace(source[39], index=6))
    assert result.road is not None, result.failure


def test_roads_are_carried_over_frames_that_were_lost(kitti_06: Path) -> None:
    source = open_source(str(kitti_06))
    kept, lost = (FrontEnd(source.camera, PipelineConfig()) for _ in range(2))
    for i in range(8):
        kept.step(source[i])
        if i in (5, 6):
            frame = dataclasses.replace(source[i], left=None, right=None)
            assert lost.step(frame).road is None
        else:
            lost.step(source[i])
    a, b = kept._hint(8).carried, lost._hint(8).carried
    assert a is not None and b is not None
    assert lost._hint(10).moved.travel_m == pytest.approx(3 * lost._hint(8).moved.travel_m)
    assert abs(a.height_m - b.height_m) < 0.01


def test_a_step_off_the_road_is_told_by_its_height(fast: tuple[FrameSource, FrontEnd]) -> None:
    source, _ = fast
    camera, config = source.camera, PipelineConfig().region

    def region(height_m: float) -> Region:
        plane = Extrinsics(height_m, 0.01, 0.0).disparity_plane(camera)
        return Region(*(None, plane, None, None, (6.0, 20.0), 0.5, 1.0, 999, 0.1, camera.focal_px))  # type: ignore[arg-type]

    road = Extrinsics(1.65, 0.01, 0.0)
    assert step_m(region(1.55), road, camera, Moved(0.5), config) == pytest.approx(0.10)
    assert step_m(region(1.75), road, camera, Moved(0.5), config) == pytest.approx(-0.10)
    assert step_m(region(1.60), road, camera, Moved(0.5), config) is None
    assert step_m(region(1.57), road, camera, Moved(4.0), config) is None, "so far on the road may have risen"
    swinging = Moved(0.5, 0.017)
    assert step_m(region(1.55), road, camera, swinging, config) is None, (
        "a degree of swing brings the near road up"
    )
