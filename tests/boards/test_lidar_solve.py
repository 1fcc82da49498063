"""Solvers on planes and points with a known answer, and the sets that cannot have one."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from stereocalib_core.boards.answer import judge
from stereocalib_core.boards.baselines import points_on_plane, unnikrishnan_hebert
from stereocalib_core.boards.calibrate import calibrate, ticked_mask
from stereocalib_core.boards.detect import Detection
from stereocalib_core.boards.observation import PairObservation
from stereocalib_core.boards.planes import fit_plane, plane_through, tangent_basis
from stereocalib_core.boards.rotations import rotation_angle, rotation_from_vector
from stereocalib_core.boards.solve import PlanePairs, dual_space, weighted
from stereocalib_core.config.boards import OBSERVABILITY
from stereocalib_core.errors import SourceError
from stereocalib_core.experiments.lidar_camera_simulation import (
    BOARD,
    CAMERA,
    T_CAMERA_LIDAR,
    SimulatedNoise,
    observe,
    simulate_boards,
)
from stereocalib_core.files.boards import calibration_bytes
from stereocalib_core.geometry import invert_transform, transform
from stereocalib_core.numeric.arrays import Array

PERFECT = SimulatedNoise(0.0, 0.0)
PAPER_NOISE = SimulatedNoise()


def boards(count: int, seed: int = 0, noise: SimulatedNoise = PERFECT) -> list[PairObservation]:
    return simulate_boards(count, np.random.default_rng(seed), noise)


def facing(tilts_deg: list[tuple[float, float]], noise: SimulatedNoise = PERFECT) -> list[PairObservation]:
    """Boards in view with given tilts about the camera's x and y axes."""
    rng = np.random.default_rng(7)
    result = []
    for index, (about_x, about_y) in enumerate(tilts_deg):
        R = rotation_from_vector(np.deg2rad([about_x, 0, 0])) @ rotation_from_vector(
            np.deg2rad([0, about_y, 0])
        )
        center = np.array([0.25 * np.cos(2.0 * index), 0.2 * np.sin(1.3 * index), 2.6 + 0.2 * (index % 4)])
        T = invert_transform(T_CAMERA_LIDAR) @ transform(R, center)
        seen = observe(f"board{index:02d}", T, rng, noise, T_CAMERA_LIDAR)
        assert seen is not None
        result.append(seen)
    return result


def planes(observations: list[PairObservation]) -> PlanePairs:
    return PlanePairs.of([o.camera_plane for o in observations], [o.lidar_plane for o in observations])  # type: ignore[misc]


@pytest.mark.parametrize("seed", range(4))
def test_three_perfect_boards_give_the_exact_transform(seed: int) -> None:
    observations = boards(3, seed)
    p = planes(observations)
    args = (p.normals_camera, p.offsets_camera, p.normals_lidar, p.offsets_lidar)
    linear = dual_space(*args)
    for T in (linear, unnikrishnan_hebert(*args), weighted(p, linear)[0]):
        np.testing.assert_allclose(T, T_CAMERA_LIDAR, atol=1e-9)
    result = calibrate(observations, BOARD, CAMERA)
    np.testing.assert_allclose(result.T_camera_lidar, T_CAMERA_LIDAR, atol=1e-9)
    np.testing.assert_allclose(result.linear, T_CAMERA_LIDAR, atol=1e-9)
    assert not result.degenerate


def test_unnikrishnan_and_hebert_take_the_translation_from_the_cameras_normals_alone() -> None:
    """Where boards are noisy the two linear solutions differ, and each is what its authors wrote."""
    p = planes(boards(8, 5, PAPER_NOISE))
    theirs = unnikrishnan_hebert(p.normals_camera, p.offsets_camera, p.normals_lidar, p.offsets_lidar)
    ours = dual_space(p.normals_camera, p.offsets_camera, p.normals_lidar, p.offsets_lidar)
    gap = p.offsets_camera - p.offsets_lidar
    np.testing.assert_allclose(theirs[:3, 3], np.linalg.pinv(p.normals_camera) @ gap, atol=1e-9)
    turned = p.normals_lidar @ ours[:3, :3].T
    np.testing.assert_allclose(ours[:3, 3], np.linalg.pinv(turned) @ gap, atol=1e-9)
    assert np.abs(theirs[:3, 3] - ours[:3, 3]).max() > 1e-4


def test_points_on_plane_is_exact_from_enough_perfect_boards() -> None:
    observations = boards(8)
    p = planes(observations)
    T = points_on_plane([o.points_lidar for o in observations], p.normals_camera, p.offsets_camera)
    np.testing.assert_allclose(T, T_CAMERA_LIDAR, atol=1e-9)


def test_the_transform_maps_lidar_points_into_the_camera() -> None:
    observations = boards(5, 2)
    T = calibrate(observations, BOARD, CAMERA).T_camera_lidar
    for o in observations:
        assert o.camera_plane is not None
        in_camera = o.points_lidar @ T[:3, :3].T + T[:3, 3]
        assert np.abs(o.camera_plane.plane.signed_distance(in_camera)).max() < 1e-9


def test_plane_fit_is_unbiased_under_range_noise_and_knows_its_sigma() -> None:
    rng = np.random.default_rng(1)
    normal = np.array([0.75, 0.2, 0.63])
    normal /= np.linalg.norm(normal)
    rays = np.stack([np.ones(400), rng.uniform(-0.12, 0.12, 400), rng.uniform(-0.12, 0.12, 400)], axis=1)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    reach = 2.4 / (rays @ normal)
    basis = tangent_basis(normal)
    tilts = []
    for _ in range(200):
        estimate = fit_plane(rays * (reach + 0.03 * rng.standard_normal(400))[:, None], 0.03)
        tilts.append(basis @ estimate.plane.normal)
    predicted = np.sqrt(np.diag(basis @ estimate.covariance[:3, :3] @ basis.T))
    observed = np.std(tilts, axis=0)
    assert np.all(np.abs(np.mean(tilts, axis=0)) < 4 * predicted / np.sqrt(200))
    np.testing.assert_allclose(observed, predicted, rtol=0.2)


def test_refinement_lowers_the_cost_and_beats_the_linear_solution() -> None:
    linear, refined = 0.0, 0.0
    for seed in range(6):
        result = calibrate(boards(8, seed, PAPER_NOISE), BOARD, CAMERA)
        costs = [i.cost for i in result.iterations]
        assert all(b <= a * (1 + 1e-6) for a, b in zip(costs, costs[1:], strict=False))
        linear, refined = linear + error(result.linear), refined + error(result.T_camera_lidar)
        assert 0.9 < result.reprojection_rms_px / (0.5 * np.sqrt(2)) < 1.1
        assert 0.3 < result.noise.kappa / (0.5 / 0.03) < 1.5
    assert refined < 0.9 * linear


def error(T: Array) -> float:
    return float(np.linalg.norm(T[:3] - T_CAMERA_LIDAR[:3], 2))


def test_swapped_clouds_are_both_named_and_do_no_harm() -> None:
    observations = boards(10, 3, PAPER_NOISE)
    clean = calibrate(observations, BOARD, CAMERA)
    a, b = observations[2], observations[7]
    mixed = list(observations)
    mixed[2] = replace(a, points_lidar=b.points_lidar, lidar_plane=b.lidar_plane)
    mixed[7] = replace(b, points_lidar=a.points_lidar, lidar_plane=a.lidar_plane)
    result = calibrate(mixed, BOARD, CAMERA)
    refused = {p.name: p.reason for p in result.pairs if not p.ok}
    assert set(refused) == {a.name, b.name}
    assert all("wrong pair" in reason for reason in refused.values())
    assert b.name in refused[a.name]
    assert error(result.T_camera_lidar) < error(clean.T_camera_lidar) + 0.02


def test_a_pair_ticked_out_is_left_out() -> None:
    observations = boards(6, 1, PAPER_NOISE)
    result = calibrate(observations, BOARD, CAMERA, ticked_mask(observations, ["board03"]))
    expected = calibrate([o for o in observations if o.name != "board03"], BOARD, CAMERA)
    np.testing.assert_allclose(result.T_camera_lidar, expected.T_camera_lidar, atol=1e-12)
    assert [p.name for p in result.pairs if not p.ok] == ["board03"]


@pytest.mark.parametrize("noise", [PERFECT, PAPER_NOISE])
def test_parallel_boards_are_degenerate(noise: SimulatedNoise) -> None:
    result = calibrate(facing([(10, 5)] * 6, noise), BOARD, CAMERA)
    assert result.degenerate
    assert "parallel" in result.observability.why
    assert "z (forward)" in result.observability.why
    assert "add a board turned" in result.observability.why


def test_boards_turned_about_one_axis_leave_the_shift_along_it_open() -> None:
    result = calibrate(facing([(0, y) for y in (-35, -20, -5, 10, 25, 40)], PAPER_NOISE), BOARD, CAMERA)
    assert result.degenerate
    assert result.observability.missing is not None
    assert abs(result.observability.missing[1]) > 0.99
    assert "camera y (down)" in result.observability.why
    assert "level axis" in result.observability.why
    # What is open is said to be unknown; what the boards do show is still right.
    assert result.sigma_translation_m[1] > 0.1
    assert np.rad2deg(rotation_angle(result.T_camera_lidar[:3, :3] @ T_CAMERA_LIDAR[:3, :3].T)) < 1.5


def test_boards_hardly_off_one_axis_are_judged_by_their_sigma() -> None:
    """A few degrees of tilt decide between 'unknown' and 'weak', and sigma says how weak."""
    tilts = [(2.5, -35), (-3, -20), (2, -5), (-2, 10), (3, 25), (-2.5, 40)]
    result = calibrate(facing(tilts, PAPER_NOISE), BOARD, CAMERA)
    assert result.observability.singular_values[2] < OBSERVABILITY.degenerate
    assert result.verdict == "weak"
    assert "camera y (down) is hardly seen" in result.observability.why
    assert "level axis" in result.observability.why
    sigma = result.sigma_translation_m
    assert OBSERVABILITY.poor_m < sigma[1] < OBSERVABILITY.lost_m
    assert np.all(np.abs(result.T_camera_lidar[:3, 3] - T_CAMERA_LIDAR[:3, 3]) < 3 * sigma)


def test_the_advised_board_mends_the_set() -> None:
    tilts = [(0.0, float(y)) for y in (-35, -20, -5, 10, 25, 40)]
    assert calibrate(facing(tilts), BOARD, CAMERA).degenerate
    mended = calibrate(facing([*tilts, (40.0, 0.0), (-40.0, 0.0)]), BOARD, CAMERA)
    assert mended.verdict == "good"


def test_two_boards_are_degenerate_along_both() -> None:
    observations = facing([(20, 0), (0, 25)])
    result = calibrate(observations, BOARD, CAMERA)
    n = planes(observations).normals_camera
    expected = np.cross(n[0], n[1]) / np.linalg.norm(np.cross(n[0], n[1]))
    assert result.degenerate
    assert result.observability.missing is not None
    assert abs(expected @ result.observability.missing) > 0.999


def test_boards_through_the_origin_are_named() -> None:
    observations = facing([(10, 0), (0, 20), (-20, 10), (5, -25), (25, 15)])
    through = []
    for o in observations:
        center = o.points_lidar.mean(axis=0)
        across = np.cross(center, [0.0, 0.0, 1.0]) / np.linalg.norm(np.cross(center, [0.0, 0.0, 1.0]))
        rng = np.random.default_rng(0)
        along = center / np.linalg.norm(center)
        spread = rng.uniform(-0.3, 0.3, (60, 2))
        points = center + spread[:, :1] * along + spread[:, 1:] * np.array([0.0, 0.0, 1.0])
        plane, mean = plane_through(points)
        assert abs(plane.normal @ across) > 0.999
        assert o.lidar_plane is not None
        through.append(
            replace(o, points_lidar=points, lidar_plane=replace(o.lidar_plane, plane=plane, center=mean))
        )
    result = calibrate(through, BOARD, CAMERA)
    assert result.degenerate
    assert "origin" in result.observability.why
    assert all("edge-on" in p.reason for p in result.pairs)


def test_nothing_to_solve_is_one_line() -> None:
    observations = [replace(o, status="rejected", reason="no board in the cloud") for o in boards(3)]
    with pytest.raises(SourceError, match="no board in the cloud"):
        calibrate(observations, BOARD, CAMERA)


def test_the_report_is_json_with_the_documented_keys() -> None:
    seen = boards(5, 4, PAPER_NOISE)
    found = Detection(BOARD, CAMERA, tuple(seen))
    values = json.loads(calibration_bytes(judge(found, calibrate(seen, BOARD, CAMERA))))
    assert np.allclose(np.array(values["T_camera_lidar"]) @ np.array(values["T_lidar_camera"]), np.eye(4))
    assert {"value", "linear", "baselines", "held_out", "pairs", "observability", "iterations"} - set(
        values
    ) == {"value"}
    assert set(values["baselines"]) == {"unnikrishnan_hebert", "points_on_plane"}
    assert set(values["pairs"][0]) >= {
        "name",
        "status",
        "reason",
        "plane_rms_m",
        "reprojection_rms_px",
        "normal_error_deg",
    }
    assert "camera_optical_frame" in values["ros2_static_transform"]
    assert np.isfinite(values["held_out"]["plane_rms_m"])
