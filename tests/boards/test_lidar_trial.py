"""Nudging by hand: exact boards, known displacements."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stereocalib_core.boards import BoardCamera, BoardSpec, PairObservation, calibrate
from stereocalib_core.boards.chessboard import plane_of_board
from stereocalib_core.boards.pictures import overlay
from stereocalib_core.boards.planes import fit_plane
from stereocalib_core.boards.rotations import rotation_from_vector
from stereocalib_core.boards.trial import nudged, sigma_ellipsoid, try_transform
from stereocalib_core.geometry import invert_transform, transform

BOARD = BoardSpec(7, 5, 0.1)
CAMERA = BoardCamera("pinhole", 800, 600, np.array([[600.0, 0, 400], [0, 600, 300], [0, 0, 1]]), np.zeros(0))
TRUTH = transform(
    np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]), np.array([0.1, -0.2, -0.15])
)
TILTS_DEG = ((25, 0, 0), (-25, 0, 5), (0, 30, 0), (0, -30, 0), (20, 20, 10), (0, 0, 0))


def observation(index: int) -> PairObservation:
    pose = transform(rotation_from_vector(np.deg2rad(TILTS_DEG[index])), np.array([0.1 * index, 0.0, 3.0]))
    pixels = CAMERA.project(BOARD.corners_board @ pose[:3, :3].T + pose[:3, 3])
    across, down = np.meshgrid(np.linspace(-0.35, 0.35, 12), np.linspace(-0.25, 0.25, 9))
    on_board = np.stack([across.ravel(), down.ravel(), np.zeros(across.size)], axis=1)
    back = invert_transform(TRUTH) @ pose
    points = on_board @ back[:3, :3].T + back[:3, 3]
    fitted = fit_plane(points, 0.01)
    return PairObservation(
        f"pair{index}", corners=pixels, T_camera_board=pose, points_lidar=points,
        camera_plane=plane_of_board(pose, np.eye(6) * 1e-8),
        lidar_plane=replace(fitted, center=back[:3, 3]), corner_rms_px=0.0,
    )  # fmt: skip


@pytest.fixture(scope="module")
def observations() -> list[PairObservation]:
    return [observation(i) for i in range(len(TILTS_DEG))]


def test_a_shift_along_a_boards_normal_is_its_residual(observations: list[PairObservation]) -> None:
    result = calibrate(observations, BOARD, CAMERA)
    still = try_transform(observations, result, result.T_camera_lidar)
    assert still.total_rms_m == pytest.approx(result.plane_rms_m, abs=1e-12)
    moved = nudged(result.T_camera_lidar, np.zeros(3), np.array([0.0, 0.0, 0.05]))
    trial = try_transform(observations, result, moved)
    expected = [0.05 * o.T_camera_board[2, 2] for o in observations]  # type: ignore[index]
    np.testing.assert_allclose(trial.plane_rms_m, expected, atol=1e-6)
    np.testing.assert_allclose(trial.normal_error_deg, 0.0, atol=1e-4)


def test_a_turn_is_about_the_lidar_and_the_cameras_axes(observations: list[PairObservation]) -> None:
    result = calibrate(observations, BOARD, CAMERA)
    turned = nudged(result.T_camera_lidar, np.deg2rad([2.0, 0.0, 0.0]), np.zeros(3))
    np.testing.assert_allclose(turned[:3, 3], result.T_camera_lidar[:3, 3])
    trial = try_transform(observations, result, turned)
    assert trial.normal_error_deg[5] == pytest.approx(2.0, abs=1e-4)
    assert np.all(trial.plane_rms_m > 0.005)


def test_refused_pairs_are_shown_but_not_counted(observations: list[PairObservation]) -> None:
    out = [*observations[:5], replace(observations[5], lidar_plane=None, status="rejected", reason="none")]
    result = calibrate(out, BOARD, CAMERA, mask=[True] * 4 + [False, True])
    trial = try_transform(out, result, nudged(result.T_camera_lidar, np.zeros(3), np.array([0, 0, 0.02])))
    assert np.isfinite(trial.plane_rms_m[:5]).all()
    assert np.isnan(trial.plane_rms_m[5])
    assert trial.total_rms_m == pytest.approx(np.sqrt(np.mean(trial.plane_rms_m[:4] ** 2)), rel=1e-9)


def test_the_ellipsoid_of_a_known_covariance() -> None:
    R = rotation_from_vector(np.array([0.3, -0.2, 0.5]))
    axes, turn = sigma_ellipsoid(R @ np.diag([1e-6, 4e-6, 9e-6]) @ R.T)
    np.testing.assert_allclose(axes, [1e-3, 2e-3, 3e-3])
    assert np.linalg.det(turn) == pytest.approx(1.0)
    np.testing.assert_allclose(turn @ np.diag(axes**2) @ turn.T, R @ np.diag([1e-6, 4e-6, 9e-6]) @ R.T)


def test_a_cloud_out_of_the_pictures_sight_leaves_the_picture_as_it_is() -> None:
    picture = np.full((600, 800), 90, np.uint8)
    behind = np.array([[-3.0, 0.0, 0.0], [-5.0, 1.0, 0.5]])
    for points in (behind, np.zeros((0, 3))):
        assert np.all(overlay(picture, points, TRUTH, CAMERA, 400) == 90)
    ahead = overlay(picture, np.array([[4.0, 0.0, 0.0]]), TRUTH, CAMERA, 400, dot_px=4)
    assert int((ahead != 90).any(axis=2).sum()) == 16
