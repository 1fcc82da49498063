"""The mounting yaw on tracks whose truth is known."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from simulated_tracks import CAMERA, LEVER_M, simulate

from stereocalib_core.back.odometry.packing import pack
from stereocalib_core.back.rig.vanishing_point import find_vanishing_point
from stereocalib_core.back.rig.yaw import _consensus, estimate_yaw, view, without_sway
from stereocalib_core.config import YawConfig
from stereocalib_core.geometry import Extrinsics, vanishing_point_of_travel, yaw_from_vanishing_point


def winding(count: int = 160) -> np.ndarray:
    """Straights that are nearly straight, and two bends."""
    curvature = 0.0012 * np.sin(np.arange(count) / 9.0)
    curvature[60:80], curvature[110:125] = 1 / 15, -1 / 20
    return curvature


@pytest.mark.parametrize("yaw_deg", [-1.0, -0.3, 0.0, 0.5])
def test_yaw_is_found_under_pitch_roll_and_slight_curves(yaw_deg: float) -> None:
    results, extrinsics = simulate(winding(), yaw_deg)
    found = estimate_yaw(pack(CAMERA, results), extrinsics)
    assert found.reason is None
    assert found.value_rad is not None and found.sigma_rad is not None
    assert np.rad2deg(found.value_rad) == pytest.approx(yaw_deg, abs=0.02)
    assert np.rad2deg(found.sigma_rad) < 0.02
    assert found.lever_arm_m == pytest.approx(LEVER_M, abs=4 * found.lever_arm_sigma_m)
    assert not found.straight[62:78].any()


def test_curvature_would_bias_the_yaw_if_it_were_left_in() -> None:
    results, extrinsics = simulate(np.full(120, 0.0025), 0.0)
    found = estimate_yaw(pack(CAMERA, results), extrinsics)
    assert found.value_rad is not None and found.sigma_rad is not None
    # dpsi / 2 + L dpsi / z = 0.057 + 0.136 degrees; without a turn to show L its prior must show in sigma
    assert abs(np.rad2deg(found.value_rad)) < 0.06
    assert np.rad2deg(found.sigma_rad) > 0.02


def test_curves_only_are_refused_with_the_reason() -> None:
    phase = 2 * np.pi * np.arange(200) * 0.8 / 84.0
    results, extrinsics = simulate(0.032 * np.sin(phase) + 0.012 * np.sin(2.3 * phase + 0.7), -0.3)
    found = estimate_yaw(pack(CAMERA, results), extrinsics)
    assert found.value_rad is None
    assert found.reason is not None and found.reason.startswith("no straight driving")


def test_standing_still_is_refused_with_the_reason() -> None:
    results, extrinsics = simulate(np.zeros(40), 0.0, step_m=0.001)
    found = estimate_yaw(pack(CAMERA, results), extrinsics)
    assert found.value_rad is None
    assert found.reason is not None and "hardly moves" in found.reason


def test_no_tracks_at_all_are_refused() -> None:
    results, extrinsics = simulate(np.zeros(40), 0.0)
    bare = [dataclasses.replace(r, tracks=None) for r in results]
    assert estimate_yaw(pack(CAMERA, bare), extrinsics).value_rad is None


def test_vanishing_point_of_exact_lines() -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(-0.6, 0.6, (2, 60))
    target = np.array([0.03, -0.01])
    tracks = np.concatenate([points, points + 0.1 * (points - target[:, None])])
    tracks[2:, :12] += rng.uniform(-0.05, 0.05, (2, 12))
    found = find_vanishing_point(tracks, 1e-3, 1e-3, 80, 0)
    np.testing.assert_allclose(found[:2], target, atol=1e-5)
    assert found[2] >= 45


def test_figure_of_one_pair_shows_the_point_of_travel() -> None:
    results, extrinsics = simulate(np.zeros(6), -0.3, noise_px=0.05)
    tracks = pack(CAMERA, results)
    shown = view(tracks, 3)
    assert shown is not None and view(tracks, 0) is None
    before = Extrinsics(*extrinsics[2])
    expected = vanishing_point_of_travel(CAMERA, before)
    np.testing.assert_allclose(shown.vanishing_point[0], expected[0], atol=3.0)
    exact = yaw_from_vanishing_point(CAMERA, *shown.vanishing_point, before)
    assert np.rad2deg(exact) == pytest.approx(-0.3, abs=0.1)
    assert shown.inlier.sum() > 100
    assert len(shown.intersections) > 300


def test_sway_where_the_road_begins_to_bank_is_taken_out() -> None:
    rng = np.random.default_rng(3)
    roll = np.deg2rad(0.1) * np.sin(np.arange(200) / 15.0)
    values = np.deg2rad(-0.3) + 1.5 * roll + np.deg2rad(0.04) * rng.standard_normal(200)
    assert np.rad2deg(np.std(values)) > 0.1
    rest = without_sway(values, roll)
    assert np.rad2deg(np.std(rest)) < 0.045
    assert np.rad2deg(np.median(rest)) == pytest.approx(-0.3, abs=0.01)
    # without any roll there is nothing to take out
    np.testing.assert_array_equal(without_sway(values, np.zeros(200)), values)


def test_a_third_of_the_pairs_astray_does_not_move_the_yaw() -> None:
    """The second RANSAC, over the pairs: a lorry alongside gives a stretch of pairs one vanishing point of its own."""
    rng = np.random.default_rng(8)
    values = np.deg2rad(-0.3) + np.deg2rad(0.05) * rng.standard_normal(90)
    values[30:60] += np.deg2rad(0.9)
    yaw, inlier, sigma = _consensus(values, YawConfig())
    assert abs(np.rad2deg(yaw) + 0.3) < 0.03
    assert abs(np.rad2deg(values.mean()) + 0.3) > 0.2
    assert not inlier[30:60].any() and inlier.sum() > 55
    assert np.rad2deg(sigma) < 0.02
