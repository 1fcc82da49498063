"""Chessboards in pictures: corners, a consistent origin, the board's pose and its plane with covariance."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from stereocalib_core.boards.camera import BoardCamera
from stereocalib_core.boards.observation import BoardSpec, PairObservation, PlaneEstimate
from stereocalib_core.boards.rotations import apply_twist, skew
from stereocalib_core.config.boards_search import CHESSBOARD
from stereocalib_core.geometry import Plane, transform
from stereocalib_core.numeric.arrays import Array


def find_corners(picture: NDArray[np.uint8], board: BoardSpec) -> Array | None:
    """(H, W) grey picture to (N, 2) corners [px], row by row with a consistent origin, or None.

    The sector-based detector first, the classic one when it fails; each at reduced size, then at full
    size. Corners are refined at full size whatever found them.
    """
    size = (board.columns, board.rows)
    factor = max(1, round(picture.shape[1] / CHESSBOARD.search_width_px))
    scales = (factor, 1) if factor > 1 else (1,)
    for scale in scales:
        small = picture if scale == 1 else _shrink(picture, scale)
        for detect in (_sector_based, _classic):
            found = detect(small, size, thorough=scale == 1)
            if found is None:
                continue
            corners = (found + 0.5) * scale - 0.5
            refined = _refine(picture, corners, size)
            if refined is not None and _is_grid(refined, size):
                return order_corners(refined, board)
    return None


def shows_pattern(picture: NDArray[np.uint8], size: tuple[int, int]) -> bool:
    """A quick look at reduced size: whether a pattern of (columns, rows) inner corners is seen at once."""
    factor = max(1, round(picture.shape[1] / CHESSBOARD.search_width_px))
    found = _sector_based(picture if factor == 1 else _shrink(picture, factor), size, thorough=False)
    return found is not None and _is_grid(found, size)


def _shrink(picture: NDArray[np.uint8], factor: int) -> NDArray[np.uint8]:
    """Area mean over factor x factor pixels, odd edges cut off so that pixel centres map exactly."""
    height, width = (n // factor * factor for n in picture.shape[:2])
    small = cv2.resize(
        picture[:height, :width], (width // factor, height // factor), interpolation=cv2.INTER_AREA
    )
    return np.asarray(small, dtype=np.uint8)


def _sector_based(picture: NDArray[np.uint8], size: tuple[int, int], thorough: bool) -> Array | None:
    # Equalised greys help in poor light, and now and then hide a board without a white rim: thorough is both.
    ways = (cv2.CALIB_CB_NORMALIZE_IMAGE, 0)[: 2 if thorough else 1]
    for way in ways:
        flags = way | (cv2.CALIB_CB_EXHAUSTIVE if thorough else 0)
        ok, corners = cv2.findChessboardCornersSB(picture, size, flags=flags)
        if ok:
            return np.asarray(corners, dtype=np.float64).reshape(-1, 2)
    return None


def _classic(picture: NDArray[np.uint8], size: tuple[int, int], thorough: bool) -> Array | None:
    flags = (
        cv2.CALIB_CB_ADAPTIVE_THRESH
        | cv2.CALIB_CB_NORMALIZE_IMAGE
        | (0 if thorough else cv2.CALIB_CB_FAST_CHECK)
    )
    ok, corners = cv2.findChessboardCorners(picture, size, flags=flags)
    return np.asarray(corners, dtype=np.float64).reshape(-1, 2) if ok else None


def _refine(picture: NDArray[np.uint8], corners: Array, size: tuple[int, int]) -> Array | None:
    """Sub-pixel corners; the window stays inside the neighbouring squares. None when they run away."""
    spacing = _spacing_px(corners, size)
    half = int(
        np.clip(CHESSBOARD.window_share * spacing, CHESSBOARD.least_window_px, CHESSBOARD.most_window_px)
    )
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-3)
    start = np.ascontiguousarray(corners, dtype=np.float32).reshape(-1, 1, 2)
    refined = cv2.cornerSubPix(picture, start.copy(), (half, half), (-1, -1), criteria).reshape(-1, 2)
    moved = np.linalg.norm(refined - corners, axis=1)
    return (
        np.asarray(refined, dtype=np.float64) if moved.max() < CHESSBOARD.most_moved_share * spacing else None
    )


def _spacing_px(corners: Array, size: tuple[int, int]) -> float:
    """The smallest distance between neighbouring corners [px]."""
    grid = corners.reshape(size[1], size[0], 2)
    across = np.linalg.norm(np.diff(grid, axis=1), axis=-1)
    down = np.linalg.norm(np.diff(grid, axis=0), axis=-1)
    return float(min(across.min(), down.min()))


def _is_grid(corners: Array, size: tuple[int, int]) -> bool:
    """Whether every corner lies near the middle of its neighbours, as on any smooth picture of a grid."""
    grid = corners.reshape(size[1], size[0], 2)
    for axis in (0, 1):
        step = np.linalg.norm(np.diff(grid, axis=axis), axis=-1).mean()
        bend = np.linalg.norm(np.diff(grid, n=2, axis=axis), axis=-1)
        if step < CHESSBOARD.least_spacing_px or bend.max() > CHESSBOARD.most_bend_share * step:
            return False
    return True


def order_corners(corners: Array, board: BoardSpec) -> Array:
    """The same corners in the order that looks upright: seen from the front, x right, y down.

    A board with rows = columns, or one whose colours repeat after half a turn, can be read in several
    orders; of those that keep its handedness the one whose first row runs most to the right and whose
    columns run most downward is taken, so that a board never jumps between neighbouring pictures.
    """
    grid = corners.reshape(board.rows, board.columns, 2)
    if _handedness(grid) < 0:
        grid = grid[:, ::-1]
    turns = (0, 1, 2, 3) if board.rows == board.columns else (0, 2)
    candidates = [np.rot90(grid, k, axes=(0, 1)) for k in turns]
    best = max(
        candidates, key=lambda g: float((g[:, -1] - g[:, 0]).sum(axis=0)[0] + (g[-1] - g[0]).sum(axis=0)[1])
    )
    return np.ascontiguousarray(best).reshape(-1, 2)


def _handedness(grid: Array) -> float:
    across = (grid[:, -1] - grid[:, 0]).mean(axis=0)
    down = (grid[-1] - grid[0]).mean(axis=0)
    return float(across[0] * down[1] - across[1] * down[0])


def board_pose(camera: BoardCamera, corners: Array, board: BoardSpec) -> tuple[Array, Array, float] | None:
    """Corners to T_camera_board (4, 4), its covariance (6, 6) at 1 px noise, and the rms [px]; None if there is none.

    Both solutions of the planar pose problem are polished in pixels, the better one is kept. The
    covariance is of a twist (rotation, translation) on the left.
    """
    normalised = camera.normalise(corners)
    if not np.isfinite(normalised).all():
        return None
    model = board.corners_board
    try:
        count, rotations, translations, misses = cv2.solvePnPGeneric(
            model, normalised.reshape(-1, 1, 2), np.eye(3), None, flags=cv2.SOLVEPNP_IPPE
        )
    except cv2.error:
        return None
    best: tuple[Array, Array, float] | None = None
    for i, (rvec, tvec) in enumerate(zip(rotations[:count], translations[:count], strict=True)):
        if not (np.isfinite(rvec).all() and np.isfinite(tvec).all()):
            continue
        if best is not None and float(np.ravel(misses)[i]) > CHESSBOARD.second_pose_ratio * float(
            np.ravel(misses)[0]
        ):
            break
        start = transform(np.asarray(cv2.Rodrigues(rvec)[0]), np.asarray(tvec).reshape(3))
        polished = polish_pose(camera, corners, model, start)
        if polished is not None and (best is None or polished[2] < best[2]):
            best = polished
    return best


def polish_pose(
    camera: BoardCamera, corners: Array, model: Array, start: Array
) -> tuple[Array, Array, float] | None:
    """Gauss-Newton on the reprojection error, halving a step that does not help."""
    T = start
    residual = corner_residuals(camera, corners, model, T)
    cost = float(np.sum(residual[0] ** 2))
    if not np.isfinite(cost):
        return None
    for _ in range(30):
        error, J = residual
        step: Array = np.asarray(-np.linalg.lstsq(J, error, rcond=None)[0], dtype=np.float64)
        for _ in range(8):
            candidate = apply_twist(step, T)
            moved = corner_residuals(camera, corners, model, candidate)
            moved_cost = float(np.sum(moved[0] ** 2))
            if np.isfinite(moved_cost) and moved_cost <= cost:
                break
            step = step / 2
        else:
            break
        T, residual, settled, cost = candidate, moved, cost - moved_cost, moved_cost
        if float(np.abs(step).max()) < 1e-13 or settled <= 1e-12 * cost:
            break
    J = residual[1]
    information = J.T @ J
    if np.linalg.cond(information) > 1e14:
        return None
    covariance: Array = np.asarray(np.linalg.inv(information), dtype=np.float64)
    return T, covariance, float(np.sqrt(cost / len(corners)))


def corner_residuals(
    camera: BoardCamera, corners: Array, model: Array, T_camera_board: Array
) -> tuple[Array, Array]:
    """Reprojection errors (2N,) [px] and their derivatives (2N, 6) by a left twist of the pose."""
    points = model @ T_camera_board[:3, :3].T + T_camera_board[:3, 3]
    pixels, d_pixels = camera.project_with_jacobian(points)
    J = np.concatenate([-d_pixels @ skew(points), d_pixels], axis=-1)
    return (pixels - corners).reshape(-1), J.reshape(-1, 6)


def plane_of_board(T_camera_board: Array, covariance: Array) -> PlaneEstimate:
    """The plane of a posed board; `covariance` (6, 6) of the pose's left twist."""
    normal, center = T_camera_board[:3, 2].copy(), T_camera_board[:3, 3].copy()
    if normal @ center < 0:
        normal = -normal
    J = np.zeros((4, 6))
    J[:3, :3] = -skew(normal)
    J[3, 3:] = normal
    return PlaneEstimate(Plane(normal, float(normal @ center)), center, J @ covariance @ J.T)


def posed_again(observation: PairObservation, camera: BoardCamera, board: BoardSpec) -> PairObservation:
    """The same corners as another camera sees them: pose and plane anew, or unchanged where no pose fits."""
    if observation.corners is None or (posed := board_pose(camera, observation.corners, board)) is None:
        return observation
    T, covariance, rms = posed
    plane = plane_of_board(T, covariance * max(rms, CHESSBOARD.least_rms_px) ** 2)
    return replace(observation, T_camera_board=T, camera_plane=plane, corner_rms_px=rms)
