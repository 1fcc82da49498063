"""The joint refinement, the variances it goes by, beams, scale and the pose to add: against numbers and known truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stereocalib_core.boards.beam_variance import RowSums, beam_variance, row_sums
from stereocalib_core.boards.beams import beams_of, find_beams
from stereocalib_core.boards.between_pictures import lens_scatter
from stereocalib_core.boards.calibrate import calibrate
from stereocalib_core.boards.calibration import Calibration
from stereocalib_core.boards.camera import BoardCamera
from stereocalib_core.boards.chessboard import posed_again
from stereocalib_core.boards.joint import Free, JointProblem, JointState, Noise, cost, linearise
from stereocalib_core.boards.next_pose import next_pose
from stereocalib_core.boards.noise import joint_problem
from stereocalib_core.boards.observation import BoardSpec, PairObservation
from stereocalib_core.boards.planes import fit_plane
from stereocalib_core.boards.refine import refine
from stereocalib_core.boards.rotations import apply_twist, rotation_from_vector, rotation_vector
from stereocalib_core.boards.second_opinion import beam_response
from stereocalib_core.boards.solve import PlanePairs
from stereocalib_core.boards.variance_components import plane_sigmas, with_plane_errors
from stereocalib_core.config.boards import BEAM, VARIANCE
from stereocalib_core.experiments.lidar_camera_simulation import (
    BOARD,
    CAMERA,
    T_CAMERA_LIDAR,
    SimulatedNoise,
    observe,
    simulate_boards,
)
from stereocalib_core.geometry import invert_transform, transform
from stereocalib_core.numeric.arrays import Array

NOISE = SimulatedNoise(0.3, 0.01)


def boards(count: int, seed: int, noise: SimulatedNoise = NOISE) -> list[PairObservation]:
    return simulate_boards(count, np.random.default_rng(seed), noise)


def pairs_of(observations: list[PairObservation]) -> PlanePairs:
    return PlanePairs.of([o.camera_plane for o in observations], [o.lidar_plane for o in observations])  # type: ignore[misc]


def problem_of(observations: list[PairObservation]) -> JointProblem:
    return joint_problem(observations, BOARD, CAMERA, Noise(0.3, 0.01), (0.004, 0.003))


def test_normal_equations_are_the_derivatives_of_the_cost() -> None:
    observations = boards(4, 1)
    problem = problem_of(observations)
    camera = BoardCamera(
        "pinhole", 640, 480, CAMERA.K * [[1.01], [1.0], [1.0]], np.array([-0.05, 0.02, 0.001, -0.001])
    )
    problem = replace(problem, camera=camera)
    rng = np.random.default_rng(0)
    state = JointState(
        apply_twist(0.002 * rng.standard_normal(6), T_CAMERA_LIDAR),
        apply_twist(0.001 * rng.standard_normal((4, 6)), np.array([o.T_camera_board for o in observations])),
        camera,
        1.002,
        0.002 * rng.standard_normal((4, 3)),
    )
    free = Free(True, True, True, 0.003)
    system = linearise(problem, state, free)

    def at(step: Array, board: Array | None = None) -> float:
        moved = replace(
            state,
            T_camera_lidar=apply_twist(step[:6], state.T_camera_lidar),
            camera=state.camera.with_intrinsic_step(step[6:14]),
            scale=state.scale + float(step[14]),
        )
        if board is not None:
            poses, errors = moved.T_camera_boards.copy(), moved.plane_errors.copy()
            poses[2], errors[2] = apply_twist(board[:6], poses[2]), errors[2] + board[6:]
            moved = replace(moved, T_camera_boards=poses, plane_errors=errors)
        return cost(problem, moved, free)[0]

    for i in range(15):
        step = np.zeros(15)
        step[i] = 1e-5 if 6 <= i < 10 else 1e-7
        slope = (at(step) - at(-step)) / (2 * step[i])
        # Taken where the rays meet the board, slants held: equal but for what is small beside the residuals.
        assert slope == pytest.approx(system.g_g[i], rel=0.05, abs=0.05 * np.sqrt(system.H_gg[i, i]))
    for i in range(9):
        step = np.zeros(9)
        step[i] = 1e-7
        slope = (at(np.zeros(15), step) - at(np.zeros(15), -step)) / 2e-7
        assert slope == pytest.approx(system.g_b[2, i], rel=0.05, abs=0.05 * np.sqrt(system.H_bb[2, i, i]))


def test_planes_as_a_whole_are_found_to_be_as_far_off_as_they_are() -> None:
    tilt, offset = np.deg2rad(0.5), 0.004
    found = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        moved = []
        for o in boards(14, seed):
            assert o.lidar_plane is not None
            turn = transform(rotation_from_vector(tilt * rng.standard_normal(3)), np.zeros(3))
            center = o.lidar_plane.center
            points = (o.points_lidar - center) @ turn[:3, :3].T + center
            points = points + offset * rng.standard_normal() * o.lidar_plane.plane.normal
            moved.append(replace(o, points_lidar=points, lidar_plane=fit_plane(points, 0.01, center)))
        found.append(plane_sigmas(pairs_of(moved), T_CAMERA_LIDAR))
    middle = np.median(found, axis=0)
    assert middle[0] == pytest.approx(tilt, rel=0.25)
    assert middle[1] == pytest.approx(offset, rel=0.35)
    none = [plane_sigmas(pairs_of(boards(14, seed)), T_CAMERA_LIDAR) for seed in range(12)]
    assert np.median(none, axis=0)[0] < 0.3 * tilt
    assert np.median(none, axis=0)[1] < 0.4 * offset


def test_whole_plane_errors_add_their_own_covariance() -> None:
    pairs = pairs_of(boards(3, 0))
    wider = with_plane_errors(pairs, 0.01, 0.005)
    normal, center = pairs.normals_lidar[1], pairs.centers_lidar[1]
    added = (wider.covariances_lidar - pairs.covariances_lidar)[1]
    # The offset at the board's centre is d - n . c.
    at = np.append(-center, 1.0)
    assert np.sqrt(at @ added @ at) == pytest.approx(0.005)
    assert np.trace(added[:3, :3]) == pytest.approx(2 * 0.01**2)
    assert np.abs(added[:3, :3] @ normal).max() < 1e-12


def test_a_wrong_square_is_measured_and_the_transform_goes_by_the_lidar() -> None:
    stated = BoardSpec(8, 8, 0.095, 0.81, 0.81)
    observations = [posed_again(o, CAMERA, stated) for o in boards(12, 5)]
    result = calibrate(observations, stated, CAMERA)
    assert result.scale.doubted
    assert stated.square_m * result.scale.value == pytest.approx(BOARD.square_m, abs=0.0005)
    assert np.linalg.norm(result.T_camera_lidar[:3, 3] - T_CAMERA_LIDAR[:3, 3]) < 0.02
    right = calibrate(boards(12, 5), BOARD, CAMERA)
    assert not right.scale.doubted
    assert abs(right.scale.value - 1.0) < 3 * right.scale.sigma


def test_a_wrong_focal_length_widens_sigma_until_it_is_refined() -> None:
    K = CAMERA.K.copy()
    K[[0, 1], [0, 1]] *= 1.01
    K[:2, 2] += 4.0
    wrong = BoardCamera("pinhole", 640, 480, K, np.zeros(0))
    observations = [posed_again(o, wrong, BOARD) for o in boards(14, 2)]
    held, refined = (calibrate(observations, BOARD, wrong, with_intrinsics=free) for free in (False, True))
    assert held.doubt is not None
    assert held.doubt.beyond_chance
    for result in (held, refined):
        assert np.all(np.abs(deviations(result)) < 3.0)
    assert np.linalg.norm(errors(refined)[3:]) < 0.5 * np.linalg.norm(errors(held)[3:])
    assert refined.camera.K[0, 0] == pytest.approx(CAMERA.K[0, 0], abs=3.5)
    sound = calibrate(boards(14, 2), BOARD, CAMERA)
    assert sound.doubt is not None
    assert not sound.doubt.beyond_chance


def test_pictures_that_disagree_on_the_lens_widen_the_cameras_sigma() -> None:
    """Every picture through a slightly other lens: within a picture its pose hides it, between them it shows."""
    white, breathing = boards(12, 8), []
    rng = np.random.default_rng(8)
    for o in white:
        assert o.corners is not None
        radius = (o.corners - CAMERA.K[:2, 2]) / CAMERA.K[0, 0]
        bent = 30.0 * rng.standard_normal() * radius * np.sum(radius**2, axis=1, keepdims=True)
        breathing.append(posed_again(replace(o, corners=o.corners + bent), CAMERA, BOARD))
    own, taken = [], []
    for observations in (white, breathing):
        result = calibrate(observations, BOARD, CAMERA, with_intrinsics=True)
        assert result.solved is not None
        state = result.solved.refined.state
        own.append(lens_scatter(joint_problem(observations, BOARD, result.camera, result.noise), state)[0])
        taken.append(lens_scatter(result.solved.problem, state)[0])
    assert own[0] == pytest.approx(1.0, abs=0.5)
    assert own[1] > 3.0
    assert max(taken) < 1.2


def errors(result: Calibration) -> Array:
    turn = rotation_vector(result.T_camera_lidar[:3, :3] @ T_CAMERA_LIDAR[:3, :3].T)
    return np.concatenate([turn, result.T_camera_lidar[:3, 3] - T_CAMERA_LIDAR[:3, 3]])


def deviations(result: Calibration) -> Array:
    return errors(result) / np.concatenate([result.sigma_rotation_rad, result.sigma_translation_m])


@pytest.mark.parametrize("free", [False, True])
def test_sigma_covers_the_error_whatever_the_beams_do(free: bool) -> None:
    """Beams with a range error of their own, and squares measured by a ruler: what sigma is said to count."""
    inside = []
    for seed in range(30):
        rng = np.random.default_rng(900 + seed)
        bias = 0.006 * rng.standard_normal(16)
        measured = replace(
            BOARD, square_m=BOARD.square_m * (1.0 + VARIANCE.scale_sigma * rng.standard_normal())
        )
        seen = []
        for sharp in boards(11, seed):
            o = posed_again(sharp, CAMERA, measured)
            reach = np.linalg.norm(o.points_lidar, axis=1)
            beam = np.round((np.rad2deg(np.arcsin(o.points_lidar[:, 2] / reach)) + 15) / 2).astype(int)
            points = o.points_lidar * (1 + bias[beam] / reach)[:, None]
            assert o.lidar_plane is not None
            seen.append(
                replace(o, points_lidar=points, lidar_plane=fit_plane(points, None, o.lidar_plane.center))
            )
        inside.append(np.abs(deviations(calibrate(seen, measured, CAMERA, with_intrinsics=free))))
    assert 0.60 <= np.mean(np.array(inside) < 1.0) <= 0.76
    assert np.mean(np.array(inside) < 2.0) >= 0.92


def test_beams_are_told_apart_by_elevation_and_their_errors_measured() -> None:
    observations = boards(12, 3, SimulatedNoise(0.3, 0.004))
    rng = np.random.default_rng(3)
    bias = 0.008 * rng.standard_normal(16)
    moved = []
    for o in observations:
        reach = np.linalg.norm(o.points_lidar, axis=1)
        beam = np.round((np.rad2deg(np.arcsin(o.points_lidar[:, 2] / reach)) + 15) / 2).astype(int)
        moved.append(replace(o, points_lidar=o.points_lidar * (1 + bias[beam] / reach)[:, None]))
    problem = problem_of(moved)
    state = JointState(T_CAMERA_LIDAR, np.array([o.T_camera_board for o in moved]), CAMERA)
    beams = find_beams(problem, state, pairs_of(moved).normals_camera)
    assert beams is not None
    assert beams.count == len(np.unique(np.round(np.arcsin(problem.rays[:, 2]), 4)))
    assert beams.sigma_m == pytest.approx(float(bias.std()), rel=0.5)
    scattered = rng.standard_normal((4000, 3))
    assert beams_of(scattered / np.linalg.norm(scattered, axis=1, keepdims=True)) is None


@pytest.mark.parametrize("free", [False, True])
def test_a_beam_that_reads_too_far_moves_the_transform_as_predicted(free: bool) -> None:
    observations = boards(8, 6, SimulatedNoise(0.3, 0.004))
    solved = calibrate(observations, BOARD, CAMERA, with_intrinsics=free).solved
    assert solved is not None
    assert solved.beams is not None
    beam = int(np.argmax(np.bincount(solved.beams.owner)))
    step_m = 0.0005
    before = refine(solved.problem, solved.refined.state, solved.refined.free)
    points = solved.problem.points + step_m * solved.problem.rays * (solved.beams.owner == beam)[:, None]
    after = refine(replace(solved.problem, points=points), before.state, solved.refined.free)
    a, b = after.state.T_camera_lidar, before.state.T_camera_lidar
    turn = rotation_vector(a[:3, :3] @ b[:3, :3].T)
    moved = np.concatenate([turn, a[:3, 3] - b[:3, 3] - np.cross(turn, b[:3, 3])])
    predicted = step_m * beam_response(solved.refined, solved.information)[:, beam]
    assert np.linalg.norm(moved - predicted) < 0.05 * np.linalg.norm(moved)


def rows_of(sigma_m: float, boards: int, rows: int, seed: int = 0) -> RowSums:
    """Boards that some rows of 12 beams cross, each beam with an error of its own, 2 mm of noise on every row."""
    rng = np.random.default_rng(seed)
    bias = sigma_m * rng.standard_normal(12)
    board = np.repeat(np.arange(boards), rows)
    beam = (np.tile(np.arange(rows), boards) + np.repeat(rng.integers(0, 13 - rows, boards), rows)).astype(
        np.int64
    )
    places = np.column_stack([np.ones(len(beam)), rng.uniform(-0.3, 0.3, len(beam)), 0.1 * beam])
    return row_sums(board, beam, places, bias[beam] + 0.002 * rng.standard_normal(len(beam)), 12)


def test_beams_that_rows_hardly_show_are_taken_for_usual_ones() -> None:
    """Three rows make a plane whatever their beams do; only more of them tell, and then the data decide."""
    usual = np.sqrt(beam_variance(rows_of(0.0, 8, 3)))
    assert usual == pytest.approx(
        np.sqrt(BEAM.usual_freedom / (BEAM.usual_freedom - 2)) * BEAM.usual_sigma_m, rel=0.4
    )
    assert usual == np.sqrt(beam_variance(rows_of(0.02, 8, 3)))
    assert np.sqrt(beam_variance(rows_of(0.0, 60, 9))) < 0.6 * BEAM.usual_sigma_m
    measured = np.sqrt(np.mean([beam_variance(rows_of(0.02, 12, 8, seed)) for seed in range(12)]))
    assert measured == pytest.approx(0.02, rel=0.3)


def weak_set(seed: int) -> list[PairObservation]:
    """Five boards turned about their upright axis only, as most people hold them: camera y is hardly seen."""
    rng = np.random.default_rng(seed)
    result: list[PairObservation] = []
    while len(result) < 5:
        tilt = np.deg2rad([rng.uniform(-4, 4), rng.uniform(-35, 35), rng.uniform(-5, 5)])
        center = np.array([rng.uniform(-0.5, 0.5), rng.uniform(-0.25, 0.25), rng.uniform(2.4, 3.4)])
        T = invert_transform(T_CAMERA_LIDAR) @ transform(rotation_from_vector(tilt), center)
        seen = observe(f"board{len(result)}", T, rng, NOISE, T_CAMERA_LIDAR)
        if seen is not None:
            result.append(seen)
    return result


def test_the_advised_pose_halves_the_worst_sigma_of_a_weak_set() -> None:
    shrunk, kept = [], []
    for seed in range(6):
        observations = weak_set(seed)
        before = calibrate(observations, BOARD, CAMERA)
        pose = next_pose(observations, before, BOARD)
        assert pose is not None
        assert "hold a board" in pose.words()
        T = invert_transform(T_CAMERA_LIDAR) @ pose.T_camera_board
        added = observe("added", T, np.random.default_rng(99), NOISE, T_CAMERA_LIDAR)
        assert added is not None
        after = calibrate([*observations, added], BOARD, CAMERA)
        assert int(np.argmax(before.sigma_translation_m)) == 1
        shrunk.append(after.sigma_translation_m[1] / before.sigma_translation_m[1])
        kept.append(after.sigma_translation_m[1] / pose.sigma_after[4])
    assert np.median(shrunk) < 0.4
    # What was promised is what came of it.
    assert np.median(kept) == pytest.approx(1.0, abs=0.3)
