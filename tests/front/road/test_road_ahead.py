"""How far a road that bends up or down ahead leaves the plane under the car, on surfaces that are known exactly."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from stereocalib_core.config import LaneConfig, PipelineConfig, RegionConfig
from stereocalib_core.front.car_way import way_of
from stereocalib_core.front.pipeline import FrontEnd, curvature_of
from stereocalib_core.front.road.ahead import bend_ahead
from stereocalib_core.geometry import Extrinsics, StereoCamera
from stereocalib_core.results import DisparityMap
from stereocalib_core.sources.formats.synthetic import SyntheticSource

CAMERA = StereoCamera(1226, 370, 707.0912, 601.8873, 183.1104, 0.53715)
NEAR = Extrinsics.from_degrees(1.65, 0.8, -0.4)
LANE = LaneConfig()
Surface = Callable[[np.ndarray, np.ndarray], np.ndarray]


def seen(surface: Surface) -> tuple[DisparityMap, np.ndarray]:
    """Disparity of a surface `height over NEAR's plane` (x [m], z [m]), with noise, and what is free of it."""
    step = 2
    j, i = np.meshgrid(np.arange(CAMERA.width // step), np.arange(CAMERA.height // step))
    u, v = (j + 0.5) * step - 0.5, (i + 0.5) * step - 0.5
    plane = NEAR.disparity_plane(CAMERA)
    at = plane.a * (v - CAMERA.cy_px) + plane.b * (u - CAMERA.cx_px) + plane.c_px
    fb = CAMERA.focal_px * CAMERA.baseline_m
    found = np.full(at.shape, np.nan)
    for z in np.arange(60.0, 2.0, -0.02):  # from far to near: what is nearer hides what is behind
        d = fb / z
        over = NEAR.height_m * (d - at) / d
        found = np.where(over <= surface((u - CAMERA.cx_px) * CAMERA.baseline_m / d, z), d, found)
    noisy = found + np.random.default_rng(0).normal(0, 0.15, found.shape)
    return DisparityMap(noisy.astype(np.float32), step), np.isfinite(found)


def whole_lane(surface: Surface) -> tuple[float, float]:
    """Change of height [m] and pitch [rad] to the least-squares plane of the lane."""
    z = np.linspace(LANE.near_m, LANE.far_m, 400)
    rise, offset = np.polyfit(z, [float(surface(np.zeros(1), at)[0]) for at in z], 1)
    return -float(offset), float(np.arctan(rise))


def ramp(start: float, slope: float) -> Surface:
    return lambda x, z: np.full_like(x, slope * max(z - start, 0.0))


@pytest.mark.parametrize("surface", [ramp(9, 0.11), ramp(13, 0.08), ramp(16, 0.11), ramp(10, -0.05)])
def test_a_ramp_is_told_as_the_plane_of_the_whole_lane(surface: Surface) -> None:
    height_m, pitch_rad = bend_ahead(*seen(surface), CAMERA, NEAR, LANE)
    true_height_m, true_pitch_rad = whole_lane(surface)
    assert height_m == pytest.approx(true_height_m, rel=0.15, abs=0.01)
    assert pitch_rad == pytest.approx(true_pitch_rad, rel=0.15, abs=np.deg2rad(0.1))


def test_a_crest_goes_on_out_of_sight() -> None:
    """Behind a sharp crest there is nothing to see; the little before it shows which way the road goes."""
    surface = ramp(11, -0.14)
    height_m, pitch_rad = bend_ahead(*seen(surface), CAMERA, NEAR, LANE)
    true_height_m, true_pitch_rad = whole_lane(surface)
    assert height_m == pytest.approx(true_height_m, rel=0.4)
    assert pitch_rad == pytest.approx(true_pitch_rad, rel=0.4)


@pytest.mark.parametrize("at_m", [10.0, 14.0, 17.0])
def test_a_hump_that_the_plane_leaves_out_is_told_as_the_plane_of_the_whole_lane(at_m: float) -> None:
    """A speed hump, 6 cm high and 3.6 m long."""

    def hump(x: np.ndarray, z: float) -> np.ndarray:
        return np.full_like(x, 0.03 * (1.0 + np.cos(2 * np.pi * min(abs(z - at_m) / 3.6, 0.5))))

    height_m, pitch_rad = bend_ahead(*seen(hump), CAMERA, NEAR, LANE)
    true_height_m, true_pitch_rad = whole_lane(hump)
    assert height_m == pytest.approx(true_height_m, abs=0.006)
    assert pitch_rad == pytest.approx(true_pitch_rad, abs=np.deg2rad(0.04))


@pytest.mark.parametrize(
    "surface",
    [
        lambda x, z: np.zeros_like(x),
        lambda x, z: np.full_like(x, 0.15 * (z > 11)),
        lambda x, z: np.where(x > 0, 0.12 * max(z - 10, 0.0), 0.0),
        lambda x, z: np.full_like(x, 1.4 * (z > 12)),
        lambda x, z: 0.03 * x * x,
    ],
    ids=["flat", "pavement beyond a kerb", "one side only", "a car", "camber"],
)
def test_what_is_no_bend_of_the_road_counts_for_nothing(surface: Surface) -> None:
    assert bend_ahead(*seen(surface), CAMERA, NEAR, LANE) == (0.0, 0.0)


def test_the_lane_is_followed_through_a_curve_and_left_alone_in_a_turn() -> None:
    """Beside a road to the right that rises lies a meadow that does not."""
    curvature = 1.0 / 150.0

    def rising(x: np.ndarray, z: float) -> np.ndarray:
        return np.where(np.abs(x - 0.5 * curvature * z * z) < 1.8, 0.1 * max(z - 9.0, 0.0), 0.0)

    _, pitch_rad = bend_ahead(*seen(rising), CAMERA, NEAR, LANE, curvature)
    assert pitch_rad == pytest.approx(whole_lane(ramp(9, 0.1))[1], rel=0.2)
    assert bend_ahead(*seen(ramp(9, 0.11)), CAMERA, NEAR, LANE, 1.0 / 60.0) == (0.0, 0.0)


def test_a_dip_at_the_end_of_sight_is_no_hill_beyond() -> None:
    """Two bins that lead back to the plane were drawn on to a hill of 0.3 m at the lane's end."""

    def dipping(x: np.ndarray, z: float) -> np.ndarray:
        seen_m = -0.09 * np.exp(-(((z - 13.0) / 1.2) ** 2)) if z < 15.0 else np.nan
        return np.full_like(x, seen_m)

    height_m, pitch_rad = bend_ahead(*seen(dipping), CAMERA, NEAR, LANE)
    assert abs(height_m) < 0.05
    assert abs(pitch_rad) < np.deg2rad(0.3)


def test_one_low_bin_is_no_road_that_goes_down() -> None:
    """A crest does not go down by a step of 9 cm in one metre and up again."""

    def noisy(x: np.ndarray, z: float) -> np.ndarray:
        return np.full_like(x, -0.09 if 13.0 <= z < 14.0 else 0.0)

    assert bend_ahead(*seen(noisy), CAMERA, NEAR, LANE) == (0.0, 0.0)


def test_curvature_is_positive_to_the_right() -> None:
    # the camera turned right by 0.01 rad over 1 m: what it saw before now lies to the left and nearer
    assert curvature_of(np.array([0.0, -0.01, 0.0, 0.0, 0.0, -1.0])) == pytest.approx(0.01)
    assert curvature_of(np.array([0.0, -0.01, 0.0, 0.0, 0.0, -0.01])) == 0.0
    assert curvature_of(None) == 0.0


@pytest.mark.parametrize("backwards", [False, True])
def test_a_car_that_backs_up_has_the_way_ahead_that_it_came_along(backwards: bool) -> None:
    # along an arc to the right, by a camera that points along it: 1 m on it has turned by 0.02 rad
    turn, chord = 0.02, np.array([0.01, 1.0])
    on = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ -chord
    forwards = np.array([0.0, -turn, 0.0, on[0], 0.0, on[1]])
    motion = np.array([0.0, turn, 0.0, chord[0], 0.0, chord[1]]) if backwards else forwards
    way = way_of(motion, NEAR.height_m, RegionConfig())
    assert way.slope == pytest.approx(0.0, abs=1e-4)
    assert way.curvature_per_m == pytest.approx(0.02, rel=1e-3)


def test_sigma_of_a_drive_over_ramps_covers_its_errors() -> None:
    source = SyntheticSource.from_spec("synthetic:straight?frames=66&fault=ramp@30")
    truth = source.ground_truth.extrinsics
    assert truth is not None
    front_end = FrontEnd(source.camera, PipelineConfig())
    errors, sigma, bent = [], [], []
    for k in range(16, 66):
        road = front_end.step(source[k]).road
        if road is not None:
            e = road.extrinsics
            errors.append(np.array([e.height_m, e.pitch_rad, e.roll_rad]) - truth[k, :3])
            sigma.append(road.sigma)
            bent.append(road.bend != (0.0, 0.0))
    error, ratio, known = np.abs(errors), np.abs(errors) / sigma, np.array(bent)
    large = np.rad2deg(error[:, 1]) > 0.5
    assert large.sum() >= 20, "the ramps leave the plane near by"
    assert known[large].mean() >= 0.9
    assert (ratio[known, :2] < 2.0).mean() >= 0.95
    assert np.quantile(np.rad2deg(sigma)[~known, 1], 0.9) < 0.2, "and nobody pays for it on the flat"
