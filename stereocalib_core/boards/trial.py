"""Trying a transform by hand: nothing is solved, the boards stay where the calibration has them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stereocalib_core.boards.calibration import Calibration
from stereocalib_core.boards.observation import PairObservation
from stereocalib_core.boards.rotations import angle_between, rigid, rotation_from_vector
from stereocalib_core.numeric.arrays import Array


@dataclass(frozen=True)
class Trial:
    """The boards under a transform; NaN where a pair has no board in both sensors.

    plane_rms_m: (M,) cloud points to the board as the calibration has it. normal_error_deg: (M,) between the
    sensors' own normals. total_rms_m: all points of the pairs that take part.
    """

    T_camera_lidar: Array
    plane_rms_m: Array
    normal_error_deg: Array
    total_rms_m: float


def nudged(T_camera_lidar: Array, turn_rad: Array, shift_m: Array) -> Array:
    """Turn the LiDAR on the spot about the camera's axes (3,) and shift it along them (3,)."""
    turn = rotation_from_vector(np.asarray(turn_rad, dtype=np.float64))
    return rigid(turn @ T_camera_lidar[:3, :3], T_camera_lidar[:3, 3] + shift_m)


def try_transform(
    observations: Sequence[PairObservation], result: Calibration, T_camera_lidar: Array
) -> Trial:
    """Residuals of every pair under T_camera_lidar (4, 4), the boards held as `result` has them."""
    rms, angle = np.full(len(observations), np.nan), np.full(len(observations), np.nan)
    R, t = T_camera_lidar[:3, :3], T_camera_lidar[:3, 3]
    squares, count = 0.0, 0
    for i, (o, pair) in enumerate(zip(observations, result.pairs, strict=True)):
        board = pair.T_camera_board
        if o.camera_plane is None or o.lidar_plane is None or board is None or not len(o.points_lidar):
            continue
        distance = (o.points_lidar @ R.T + t - board[:3, 3]) @ board[:3, 2]
        rms[i] = np.sqrt(np.mean(distance**2))
        angle[i] = np.rad2deg(angle_between(R @ o.lidar_plane.plane.normal, o.camera_plane.plane.normal))
        if pair.ok:
            squares, count = squares + float(distance @ distance), count + len(distance)
    total = float(np.sqrt(squares / count)) if count else float("nan")
    return Trial(T_camera_lidar, rms, angle, total)


def sigma_ellipsoid(covariance: Array) -> tuple[Array, Array]:
    """(3, 3) covariance to semi-axes (3,) of one sigma, ascending, and the rotation whose columns they lie along."""
    values, vectors = np.linalg.eigh((covariance + covariance.T) / 2)
    if np.linalg.det(vectors) < 0:
        vectors = vectors * np.array([-1.0, 1.0, 1.0])
    return np.sqrt(np.maximum(values, 0.0)), vectors
