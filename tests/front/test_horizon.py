"""Matched finely where a road can be, coarsely above its horizon."""

from __future__ import annotations

import numpy as np
import pytest

from stereocalib_core.config import DisparityConfig, SightConfig
from stereocalib_core.front import matching
from stereocalib_core.front.horizon import first_row, match_by_the_horizon
from stereocalib_core.geometry import Extrinsics, StereoCamera
from stereocalib_core.results import DisparityMap
from stereocalib_core.sources import open_source

CAMERA = StereoCamera(640, 360, 500.0, 319.5, 150.0, 0.5)


@pytest.mark.parametrize(("pitch_deg", "roll_deg"), [(0.0, 0.0), (4.0, 0.0), (-3.0, 2.0), (1.0, -4.0)])
def test_the_row_lies_over_the_horizon_by_what_is_set(pitch_deg: float, roll_deg: float) -> None:
    """A point of the road a kilometre ahead lies on the horizon, at either edge of the picture."""
    road = Extrinsics(1.5, float(np.deg2rad(pitch_deg)), float(np.deg2rad(roll_deg)))
    pitch, roll = road.pitch_rad, road.roll_rad
    across = (np.array([0.0, 639.0]) - CAMERA.cx_px) / CAMERA.focal_px
    # the direction (x, y, 1) at right angles to the road's normal, Rx(pitch) Rz(roll) (0, 1, 0)
    normal = np.array([-np.sin(roll), np.cos(pitch) * np.cos(roll), np.sin(pitch) * np.cos(roll)])
    horizon = CAMERA.cy_px + CAMERA.focal_px * (-normal[0] * across - normal[2]) / normal[1]
    wanted = horizon.min() - CAMERA.focal_px * np.tan(SightConfig().above_horizon_rad)
    row = first_row(CAMERA, road, 2, SightConfig())
    assert row % 4 == 0 and 0.0 <= wanted - row < 4.0


@pytest.mark.parametrize("pitch_deg", [14.0, -25.0])
def test_with_the_horizon_at_an_edge_all_is_matched_alike(pitch_deg: float) -> None:
    assert first_row(CAMERA, Extrinsics(1.5, float(np.deg2rad(pitch_deg)), 0.0), 2, SightConfig()) == 0


def test_below_as_finely_as_by_itself_and_above_from_twice_as_coarse_a_grid() -> None:
    source = open_source("synthetic:town?frames=1&width=641&height=240&focal_px=370&cx_px=320&cy_px=110")
    frame, camera, config = source[0], source.camera, DisparityConfig()
    assert frame.left is not None and frame.right is not None
    found = match_by_the_horizon(matching.compute, frame.left, frame.right, camera, config, 2, 96.0, 100)
    assert found.step_px == 2 and found.values.shape == (120, 320)
    fine = matching.compute(frame.left[100:], frame.right[100:], camera, config, 2, 96.0).values
    np.testing.assert_array_equal(found.values[50:], fine)
    coarse = matching.compute(frame.left[:100], frame.right[:100], camera, config, 4, 96.0).values
    np.testing.assert_array_equal(found.values[:50], coarse.repeat(2, axis=0).repeat(2, axis=1))
    # and it is what the pair shows: the same as matched finely all over, but for the cells' size
    whole = matching.compute(frame.left, frame.right, camera, config, 2, 96.0).values
    apart = np.abs(found.values - whole)[np.isfinite(found.values) & np.isfinite(whole)]
    assert np.median(apart) < 0.3 and np.quantile(apart, 0.8) < 2.0


def test_the_edge_of_an_odd_width_is_filled_and_a_matcher_with_its_own_grid_keeps_it() -> None:
    def steps_of(step_px: int) -> list[int]:
        def matcher(left, right, camera, config, step=None, farthest_px=None):  # type: ignore[no-untyped-def]
            own = max(step or 1, step_px)
            asked.append(left.shape[0])
            height, width = left.shape[0] // own, left.shape[1] // own
            return DisparityMap(np.full((height, width), float(own), np.float32), own)

        asked: list[int] = []
        picture = np.zeros((120, 318), np.uint8)
        camera = StereoCamera(318, 120, 250.0, 159.0, 60.0, 0.5)
        found = match_by_the_horizon(matcher, picture, picture, camera, DisparityConfig(), 2, 64.0, 48)
        assert np.isfinite(found.values).all() and found.step_px == max(2, step_px)
        return asked

    assert steps_of(1) == [72, 48]
    assert steps_of(32) == [72, 48, 120], "cells that do not meet at the row: all of it at once"
