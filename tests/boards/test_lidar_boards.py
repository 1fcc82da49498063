"""Cameras, corners and board poses against rendered pictures and OpenCV's own projection."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from lidar_scenes import render

from stereocalib_core.boards.camera import BoardCamera
from stereocalib_core.boards.chessboard import board_pose, find_corners, order_corners, plane_of_board
from stereocalib_core.boards.intrinsics import estimate_camera
from stereocalib_core.boards.observation import BoardSpec
from stereocalib_core.boards.rotations import rotation_from_vector
from stereocalib_core.errors import ConfigError
from stereocalib_core.geometry import transform

K = np.array([[610.0, 0.0, 402.0], [0.0, 612.0, 298.0], [0.0, 0.0, 1.0]])
PINHOLE = BoardCamera("pinhole", 800, 600, K, np.array([-0.25, 0.08, 0.001, -0.0008, 0.01]))
RATIONAL = BoardCamera("pinhole", 800, 600, K, np.array([-0.2, 0.05, 0.001, 0.002, 0.01, 0.02, 0.01, 0.003]))
FISHEYE = BoardCamera("fisheye", 800, 600, K, np.array([-0.05, -0.02, 0.03, -0.01]))
CAMERAS = [PINHOLE, RATIONAL, FISHEYE, BoardCamera("pinhole", 800, 600, K, np.zeros(0))]
BOARD = BoardSpec(7, 5, 0.08)
SQUARE = BoardSpec(6, 6, 0.08)


def pose(
    tilt_deg: tuple[float, float, float], center: tuple[float, float, float] = (0.1, -0.05, 1.4)
) -> np.ndarray:
    return transform(rotation_from_vector(np.deg2rad(tilt_deg)), np.array(center))


@pytest.mark.parametrize("camera", CAMERAS)
def test_projection_matches_opencv_and_inverts(camera: BoardCamera) -> None:
    points = np.random.default_rng(0).uniform(-0.6, 0.6, (200, 3)) + [0, 0, 2]
    zero = np.zeros(3)
    project = cv2.fisheye.projectPoints if camera.model == "fisheye" else cv2.projectPoints
    D = camera.D if len(camera.D) else np.zeros(4)
    expected = project(points.reshape(-1, 1, 3), zero, zero, camera.K, D)[0].reshape(-1, 2)
    pixels, J = camera.project_with_jacobian(points)
    np.testing.assert_allclose(pixels, expected, atol=1e-9)
    np.testing.assert_allclose(camera.project(points), pixels)
    np.testing.assert_allclose(camera.normalise(pixels), points[:, :2] / points[:, 2:], atol=1e-9)
    steps = 1e-6 * np.eye(3)
    numeric = np.stack(
        [(camera.project(points + s) - camera.project(points - s)) / 2e-6 for s in steps], axis=-1
    )
    np.testing.assert_allclose(J, numeric, atol=1e-4)


def test_intrinsic_derivatives() -> None:
    points = np.random.default_rng(0).uniform(-0.6, 0.6, (50, 3)) + [0, 0, 2]
    for camera in (PINHOLE, FISHEYE):
        J = camera.intrinsic_jacobian(points)
        for i in range(4 + len(camera.D)):
            step = np.zeros(4 + len(camera.D))
            step[i] = 1e-5
            moved = camera.with_intrinsic_step(step).project(points) - camera.with_intrinsic_step(
                -step
            ).project(points)
            np.testing.assert_allclose(J[..., i], moved / 2e-5, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("camera", [PINHOLE, FISHEYE])
@pytest.mark.parametrize("tilt", [(5.0, 8.0, 3.0), (35.0, -10.0, 20.0), (-15.0, 40.0, -25.0)])
def test_corners_and_pose_of_a_rendered_board(camera: BoardCamera, tilt: tuple[float, float, float]) -> None:
    truth = pose(tilt)
    corners = find_corners(render(camera, BOARD, truth, np.random.default_rng(0)), BOARD)
    assert corners is not None
    expected = camera.project(BOARD.corners_board @ truth[:3, :3].T + truth[:3, 3])
    assert np.sqrt(np.mean((corners - expected) ** 2)) < 0.12
    posed = board_pose(camera, corners, BOARD)
    assert posed is not None
    T, covariance, _ = posed
    np.testing.assert_allclose(T[:3, 3], truth[:3, 3], atol=0.004)
    plane = plane_of_board(T, covariance)
    assert np.rad2deg(np.arccos(min(1.0, plane.plane.normal @ truth[:3, 2]))) < 0.4
    assert plane.plane.offset_m > 0


@pytest.mark.parametrize("board", [BOARD, SQUARE, BoardSpec(5, 7, 0.08)])
def test_order_of_corners_does_not_depend_on_where_the_detector_began(board: BoardSpec) -> None:
    truth = pose((10.0, -12.0, 8.0))
    corners = PINHOLE.project(board.corners_board @ truth[:3, :3].T + truth[:3, 3])
    grid = corners.reshape(board.rows, board.columns, 2)
    readings = [grid, grid[::-1, ::-1]]
    if board.rows == board.columns:
        readings += [np.rot90(grid, 1), np.rot90(grid, 3), grid.transpose(1, 0, 2)]
    for reading in readings:
        np.testing.assert_allclose(order_corners(reading.reshape(-1, 2), board), corners)


def test_a_picture_without_a_board_gives_none() -> None:
    noise = np.random.default_rng(0).integers(0, 255, (300, 400)).astype(np.uint8)
    assert find_corners(cv2.GaussianBlur(noise, (0, 0), 3), BOARD) is None
    assert find_corners(np.full((300, 400), 90, np.uint8), BOARD) is None


@pytest.mark.parametrize("truth", [PINHOLE, FISHEYE])
def test_intrinsics_are_found_from_boards(truth: BoardCamera) -> None:
    rng = np.random.default_rng(5)
    corners = []
    while len(corners) < 14:
        T = pose(
            tuple(rng.uniform(-35, 35, 3)),
            (rng.uniform(-0.7, 0.7), rng.uniform(-0.5, 0.5), rng.uniform(0.8, 1.3)),
        )
        pixels = truth.project(BOARD.corners_board @ T[:3, :3].T + T[:3, 3])
        if (pixels > 0).all() and (pixels < [799, 599]).all():
            corners.append(pixels + 0.05 * rng.standard_normal(pixels.shape))
    camera, rms = estimate_camera(corners, (800, 600), BOARD)
    assert rms < 0.3
    np.testing.assert_allclose(np.diag(camera.K), np.diag(K), rtol=0.01)


@pytest.mark.parametrize(
    "bad",
    [
        lambda: BoardCamera("pinhole", 800, 600, K, np.zeros(3)),
        lambda: BoardCamera("fisheye", 800, 600, K, np.zeros(5)),
        lambda: BoardCamera("pinhole", 800, 600, np.zeros((3, 3)), np.zeros(4)),
        lambda: BoardCamera("mirror", 800, 600, K, np.zeros(4)),  # type: ignore[arg-type]
        lambda: BoardSpec(1, 5, 0.1),
        lambda: BoardSpec(7, 5, float("nan")),
        lambda: BoardSpec(7, 5, 0.1, width_m=0.2),
    ],
)
def test_impossible_settings_are_refused(bad: object) -> None:
    with pytest.raises(ConfigError):
        bad()  # type: ignore[operator]
