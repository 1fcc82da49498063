"""The road of a moment ago, carried along by the odometry, and the candidates that are weighed against it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stereocalib_core.config import PipelineConfig, RegionConfig
from stereocalib_core.errors import FailureReason
from stereocalib_core.front.car_way import carried_on
from stereocalib_core.front.pipeline import FrontEnd
from stereocalib_core.front.road.candidates import Way
from stereocalib_core.front.road.carried import Past, likeness
from stereocalib_core.front.road.doubt import along_car
from stereocalib_core.geometry import Extrinsics
from stereocalib_core.results import RoadEstimate
from stereocalib_core.sources.formats.synthetic import SyntheticSource


def test_a_leaning_road_is_seen_from_the_turned_car() -> None:
    # a slope across the old heading is one along the new one, after a quarter turn to the right
    leaning = Extrinsics(1.65, 0.0, 0.03)
    turn = np.array([0.0, -0.5 * np.pi, 0.0, 0.0, 0.0, 0.0])
    (seen, nothing) = carried_on([leaning, None], turn)
    assert nothing is None and seen is not None
    assert seen.height_m == pytest.approx(1.65)
    assert seen.roll_rad == pytest.approx(0.0, abs=1e-9)
    assert abs(seen.pitch_rad) == pytest.approx(0.03, abs=1e-9)


def test_driving_up_a_slope_ahead_brings_it_nearer() -> None:
    # looking 0.1 rad away from the road, a metre ahead the camera is 0.1 m higher over it
    (seen,) = carried_on([Extrinsics(1.65, -0.1, 0.0)], np.array([0.0, 0.0, 0.0, 0.0, 0.0, -1.0]))
    assert seen is not None
    assert seen.height_m == pytest.approx(1.65 + np.sin(0.1), abs=1e-9)
    assert seen.pitch_rad == pytest.approx(-0.1)


def test_the_kinder_past_counts_and_the_carried_road_more() -> None:
    config = RegionConfig()
    rig, road = Extrinsics(1.65, 0.0, 0.0), Extrinsics(1.65, 0.0, 0.06)
    asked = np.array([[1.65, 0.0, 0.0], [1.65, 0.0, 0.06], [1.65, 0.0, -0.06]])
    both = likeness(asked, Past(rig, road), 6.0, config)
    assert both[:2] == pytest.approx([config.past_less, 1.0])
    assert both[2] == pytest.approx(
        max(config.past_less * np.exp(-0.5 * (0.06 / config.past_roll_rad) ** 2), config.least_likeness)
    )
    assert likeness(asked, Past(rig), 6.0, config)[0] == pytest.approx(1.0)
    assert likeness(asked, Past(), 6.0, config) == pytest.approx([1.0, 1.0, 1.0])


def test_a_kerb_is_no_tilt_of_the_carried_road() -> None:
    """0.1 m higher all along is a pavement; as much nearer by, tilted about the nearest road, is a car that dives."""
    road = Extrinsics(1.65, 0.0, 0.0)
    about_m = RegionConfig().near_length * 8.0
    asked = np.array([[1.55, 0.0, 0.0], [1.55, -0.1 / about_m, 0.0]])
    pavement, dive = likeness(asked, Past(None, road), 8.0, RegionConfig())
    assert pavement == pytest.approx(RegionConfig().least_likeness)
    assert dive > 0.4


def test_a_crossfall_is_one_along_the_car_where_it_turns() -> None:
    assert along_car(0.0144, Way(), (5.0, 15.0)) == pytest.approx((0.0, 0.0))
    height, pitch = along_car(0.0144, Way(0.0, 0.5), (5.0, 15.0))  # ahead, the way leads aside
    assert pitch == pytest.approx(0.0072)
    assert height == pytest.approx(0.5 * 10.0 * 0.0072)
    estimate = RoadEstimate(
        Extrinsics(1.65, 0.0, 0.0), np.zeros((3, 3)), 9, 0.5, (5.0, 15.0), along=(height, pitch)
    )
    assert estimate.sigma == pytest.approx([height, pitch, 0.0])
    assert estimate.bend_covariance[0, 1] == pytest.approx(height * pitch)


def test_in_a_tight_turn_between_kerbs_no_frame_is_sure_of_the_pavement(data_dir: Path) -> None:
    """Between road and pavement lies a plane that many cells are near to: 67 mm and 1.1 deg off, where it was taken."""
    path = data_dir / "kitti_odometry" / "poses" / "07.txt"
    source = SyntheticSource.from_spec(f"synthetic:?path={path}&seed=5&frames=137")
    truth = source.ground_truth.extrinsics
    assert truth is not None
    front_end = FrontEnd(source.camera, PipelineConfig())
    error, sigma = [], []
    for i in range(123, 137):
        road = front_end.step(source[i]).road
        assert road is not None
        e = road.extrinsics
        error.append(np.array([e.height_m, e.pitch_rad, e.roll_rad]) - truth[i, :3])
        sigma.append(road.sigma)
    assert np.all(np.abs(error).max(axis=0) <= [0.015, *np.deg2rad([0.15, 0.25])])
    assert np.all(np.abs(np.array(error)) < 4.0 * np.array(sigma))


def test_a_pavement_beside_a_car_that_hides_the_road_is_none(data_dir: Path) -> None:
    """The road is 0.1 m below what is left to be seen, which was taken for it with a sigma of 5 mm."""
    path = data_dir / "kitti_odometry" / "poses" / "07.txt"
    source = SyntheticSource.from_spec(f"synthetic:?path={path}&seed=8")
    result = FrontEnd(source.camera, PipelineConfig()).step(source[657])
    assert result.failure is not None and result.failure.reason == FailureReason.NO_ROAD
    assert "of the way ahead, needs 8%" in result.failure.detail


def test_a_car_that_stands_at_a_junction_is_not_sure_of_the_pavement_beyond(data_dir: Path) -> None:
    """Two metres of road are left before a pavement as high as the road behind, which was taken for it."""
    path = data_dir / "kitti_odometry" / "poses" / "07.txt"
    source = SyntheticSource.from_spec(f"synthetic:?path={path}")
    truth = source.ground_truth.extrinsics
    assert truth is not None
    front_end = FrontEnd(source.camera, PipelineConfig())
    seen = 0
    for i in range(630, 660):
        road = front_end.step(source[i]).road
        if road is not None and i >= 646:
            e = road.extrinsics
            error = np.abs([e.height_m, e.pitch_rad, e.roll_rad] - truth[i, :3])
            assert error[0] < 0.07
            assert np.all(error < 4.0 * road.sigma)
            seen += 1
    assert seen >= 12


def test_a_body_that_a_hump_sets_swinging_makes_no_kerb_of_its_road() -> None:
    """Between two pairs it turns by a degree more than between the two before: 0.14 m of road 8 m ahead."""
    source = SyntheticSource.from_spec("synthetic:town")
    front_end = FrontEnd(source.camera, PipelineConfig())
    results = [front_end.step(source[i]) for i in range(243, 250)]
    assert [str(result.failure) for result in results if result.road is None] == []


def test_a_drive_that_begins_before_a_kerb_is_not_sure_of_it_by_looking_again(data_dir: Path) -> None:
    """Half road, half pavement, 0.17 m and 1.4 deg off; the car stands, and what it sees again proves nothing."""
    path = data_dir / "kitti_odometry" / "poses" / "07.txt"
    source = SyntheticSource.from_spec(f"synthetic:?path={path}")
    truth = source.ground_truth.extrinsics
    assert truth is not None
    front_end = FrontEnd(source.camera, PipelineConfig())
    for i in range(638, 647):
        road = front_end.step(source[i]).road
        if road is not None:
            e = road.extrinsics
            assert np.all(np.abs([e.height_m, e.pitch_rad, e.roll_rad] - truth[i, :3]) < 4.0 * road.sigma)


def test_a_turn_that_is_seen_straight_ahead_only_is_as_unsure_along_the_car() -> None:
    """A quarter of the lane ahead: 17 mm and 0.12 deg off, and said to be good to 2.5 mm and 0.017 deg."""
    source = SyntheticSource.from_spec("synthetic:town")
    truth = source.ground_truth.extrinsics
    assert truth is not None
    front_end = FrontEnd(source.camera, PipelineConfig())
    for i in range(311, 319):
        road = front_end.step(source[i]).road
        assert road is not None
        error = np.abs([road.extrinsics.height_m, road.extrinsics.pitch_rad] - truth[i, :2])
        if i >= 314:
            assert np.all(error < 3.0 * road.sigma[:2])
