"""Intrinsics from the boards themselves, by Zhang's method (`model: estimate`)."""

from __future__ import annotations

import cv2
import numpy as np

from stereocalib_core.boards.camera import BoardCamera
from stereocalib_core.boards.observation import BoardSpec
from stereocalib_core.config.boards import INTRINSICS
from stereocalib_core.errors import SourceError
from stereocalib_core.numeric.arrays import Array

# cv2.fisheye's named flags differ between OpenCV versions, their values do not.
FISHEYE_RECOMPUTE_EXTRINSIC, FISHEYE_FIX_SKEW = 2, 8


def estimate_camera(
    corners: list[Array], size: tuple[int, int], board: BoardSpec
) -> tuple[BoardCamera, float]:
    """Corners of several pictures, each (N, 2) [px], to a camera and its reprojection rms [px].

    A pinhole with k1 k2 p1 p2 first; where that cannot follow the lens, k3 and the fisheye are tried and
    the closest one is kept. `size` is (width, height) [px].
    """
    if len(corners) < INTRINSICS.least_pictures:
        raise SourceError(
            "too few boards to estimate the camera", f"{len(corners)} pictures show one",
            f"give K and D in camera.yaml or at least {INTRINSICS.least_pictures} pictures",
        )  # fmt: skip
    attempts = [_pinhole(corners, size, board, cv2.CALIB_FIX_K3)]
    if attempts[0][1] > INTRINSICS.good_rms_px and len(corners) >= INTRINSICS.pictures_for_lens:
        attempts.append(_pinhole(corners, size, board, 0))
        fisheye = _fisheye(corners, size, board)
        if fisheye is not None:
            attempts.append(fisheye)
    camera, rms = min(attempts, key=lambda a: a[1])
    if not np.isfinite(rms) or rms > INTRINSICS.worst_rms_px:
        raise SourceError(
            "camera cannot be estimated", f"reprojection {rms:.1f} px", "give K and D in camera.yaml"
        )
    return camera, rms


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
    corners: list[Array], size: tuple[int, int], board: BoardSpec
) -> tuple[BoardCamera, float] | None:
    model = [board.corners_board.reshape(1, -1, 3)] * len(corners)
    pixels = [np.ascontiguousarray(c.reshape(1, -1, 2)) for c in corners]
    try:
        rms, K, D, _, _ = cv2.fisheye.calibrate(
            model, pixels, size, np.eye(3), np.zeros(4), flags=FISHEYE_RECOMPUTE_EXTRINSIC | FISHEYE_FIX_SKEW
        )
    except cv2.error:
        return None
    return BoardCamera(
        "fisheye", size[0], size[1], np.array(K, float), np.array(D, float).reshape(-1)[:4]
    ), float(rms)
