"""Intrinsics from the boards themselves, by Zhang's method (`model: estimate`)."""

from __future__ import annotations

import cv2
import numpy as np

from stereocalib_core.boards.camera import BoardCamera
from stereocalib_core.boards.chessboard import board_pose, corner_residuals
from stereocalib_core.boards.observation import BoardSpec
from stereocalib_core.boards.rotations import apply_twist
from stereocalib_core.config.boards import INTRINSICS
from stereocalib_core.errors import SourceError
from stereocalib_core.numeric.arrays import Array


def estimate_camera(
    corners: list[Array], size: tuple[int, int], board: BoardSpec
) -> tuple[BoardCamera, float]:
    """Corners of several pictures, each (N, 2) [px], to a camera and its reprojection rms [px].

    A pinhole with k1 k2 p1 p2; from enough pictures also with k3, and a fisheye: the one kept is the closest for
    its number of parameters. `size` is (width, height) [px].
    """
    if len(corners) < INTRINSICS.least_pictures:
        raise SourceError(
            "too few boards to estimate the camera", f"{len(corners)} pictures show one",
            f"give K and D in camera.yaml or at least {INTRINSICS.least_pictures} pictures",
        )  # fmt: skip
    attempts = [_pinhole(corners, size, board, cv2.CALIB_FIX_K3)]
    if len(corners) >= INTRINSICS.pictures_for_lens:
        attempts.append(_pinhole(corners, size, board, 0))
        fisheye = _fisheye(corners, size, board, attempts[0][0].K)
        if fisheye is not None:
            attempts.append(fisheye)
    count = 2 * sum(len(c) for c in corners)
    camera, rms = min(attempts, key=lambda a: _information_criterion(a[0], a[1], count))
    if not np.isfinite(rms) or rms > INTRINSICS.worst_rms_px:
        raise SourceError(
            "camera cannot be estimated", f"reprojection {rms:.1f} px", "give K and D in camera.yaml"
        )
    return camera, rms


def _information_criterion(camera: BoardCamera, rms_px: float, count: int) -> float:
    """Schwarz (1978): a lens model must pay for each number that it has more."""
    if not np.isfinite(rms_px):
        return np.inf
    return float(count * np.log(max(rms_px, 1e-6) ** 2) + (4 + np.count_nonzero(camera.D)) * np.log(count))


def _pinhole(
    corners: list[Array], size: tuple[int, int], board: BoardSpec, flags: int
) -> tuple[BoardCamera, float]:
    model = [board.corners_board.astype(np.float32)] * len(corners)
    pixels = [c.astype(np.float32).reshape(-1, 1, 2) for c in corners]
    try:
        rms, K, D, _, _ = cv2.calibrateCamera(model, pixels, size, np.eye(3), np.zeros(5), flags=flags)
        return BoardCamera(
            "pinhole", size[0], size[1], np.array(K, float), np.array(D, float).reshape(-1)[:5]
        ), float(rms)
    except cv2.error as error:
        raise SourceError(
            "camera cannot be estimated", "camera.yaml", "tilt the boards more, or give K and D"
        ) from error


def _fisheye(
    corners: list[Array], size: tuple[int, int], board: BoardSpec, guess: Array
) -> tuple[BoardCamera, float] | None:
    """By our own adjustment: OpenCV's starts from the picture's width and may never arrive."""
    start = BoardCamera("fisheye", size[0], size[1], guess, np.zeros(4))
    fitted = adjust(start, corners, board)
    return None if fitted is None else (fitted[0], fitted[1])


def adjust(
    camera: BoardCamera, corners: list[Array], board: BoardSpec
) -> tuple[BoardCamera, float, Array] | None:
    """Intrinsics and all poses together from `camera`: the camera, the rms [px], covariance (4 + n, 4 + n) at 1 px.

    Levenberg-Marquardt with every pose eliminated (Schur complement). None when some board has no pose.
    """
    posed = [board_pose(camera, c, board) for c in corners]
    if any(p is None for p in posed):
        return None
    poses = [p[0] for p in posed if p is not None]
    model, damping = board.corners_board, 1e-4
    cost, H, g, blocks = _corner_equations(camera, poses, corners, model)
    for _ in range(INTRINSICS.most_rounds):
        step: Array = np.asarray(-np.linalg.solve(H + damping * np.diag(np.diag(H)), g), dtype=np.float64)
        tried = camera.with_intrinsic_step(step) if np.isfinite(step).all() else camera
        moved = [
            apply_twist(-inverse @ (pull + cross.T @ step), T)
            for T, (inverse, pull, cross) in zip(poses, blocks, strict=True)
        ]
        attempt = _corner_equations(tried, moved, corners, model)
        if not attempt[0] < cost:
            damping *= 10
            if damping > 1e6:
                break
            continue
        gain, camera, poses, damping = cost - attempt[0], tried, moved, damping / 10
        cost, H, g, blocks = attempt
        if gain < 1e-9 * cost:
            break
    count = sum(len(c) for c in corners)
    return camera, float(np.sqrt(cost / count)), np.asarray(np.linalg.pinv(H, hermitian=True))


def _corner_equations(
    camera: BoardCamera, poses: list[Array], corners: list[Array], model: Array
) -> tuple[float, Array, Array, list[tuple[Array, Array, Array]]]:
    """Squared error, reduced information and gradient of the intrinsics, and each pose's own block."""
    q = 4 + len(camera.D)
    cost = 0.0
    H: Array = np.zeros((q, q))
    g: Array = np.zeros(q)
    blocks: list[tuple[Array, Array, Array]] = []
    for T, seen in zip(poses, corners, strict=True):
        error, J = corner_residuals(camera, seen, model, T)
        points = model @ T[:3, :3].T + T[:3, 3]
        if not np.isfinite(error).all():
            return np.inf, H, g, blocks
        J_k = camera.intrinsic_jacobian(points).reshape(-1, q)
        inverse: Array = np.asarray(np.linalg.inv(J.T @ J), dtype=np.float64)
        cross, pull = J_k.T @ J, J.T @ error
        cost += float(error @ error)
        H += J_k.T @ J_k - cross @ inverse @ cross.T
        g += J_k.T @ error - cross @ inverse @ pull
        blocks.append((inverse, pull, cross))
    return cost, H, g, blocks
