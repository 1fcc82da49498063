"""Extrinsics from plane correspondences: the dual-space solution, and the same with every plane's covariance.

A plane (n, d), n . X = d, moves with the inverse transpose of the points' transform, so rotation and
translation part: n_camera = R n_lidar, d_camera = d_lidar + n_camera . t (Zheng et al., eq. 2-5).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.boards.observation import PlaneEstimate
from stereocalib_core.boards.planes import tangent_basis
from stereocalib_core.boards.rotations import apply_twist, cross, nearest_rotation, skew
from stereocalib_core.config.boards import SOLVE
from stereocalib_core.geometry import transform
from stereocalib_core.numeric.arrays import Array


@dataclass(frozen=True)
class PlanePairs:
    """M boards as both sensors see them. normals_* (M, 3), offsets_* (M,) [m], centers_* (M, 3) [m].

    covariances_*: (M, 4, 4) of (n, d).
    """

    normals_camera: Array
    offsets_camera: Array
    centers_camera: Array
    covariances_camera: Array
    normals_lidar: Array
    offsets_lidar: Array
    centers_lidar: Array
    covariances_lidar: Array

    def __len__(self) -> int:
        return len(self.offsets_camera)

    def select(self, index: NDArray[np.int64] | NDArray[np.bool_]) -> PlanePairs:
        """Some of the boards."""
        return PlanePairs(*(getattr(self, name)[index] for name in self.__dataclass_fields__))

    @classmethod
    def of(cls, camera: Sequence[PlaneEstimate], lidar: Sequence[PlaneEstimate]) -> PlanePairs:
        """From the estimates of both sensors, in the same order."""
        columns = []
        for planes in (camera, lidar):
            columns += [
                np.array([p.plane.normal for p in planes]).reshape(-1, 3),
                np.array([p.plane.offset_m for p in planes]),
                np.array([p.center for p in planes]).reshape(-1, 3),
                np.array([p.covariance for p in planes]).reshape(-1, 4, 4),
            ]
        return cls(*columns)


def dual_space(
    normals_camera: Array,
    offsets_camera: Array,
    normals_lidar: Array,
    offsets_lidar: Array,
    prior: Array | None = None,
) -> Array:
    """Zheng et al., eq. 2-5: T_camera_lidar (4, 4) from M >= 3 planes, n . X = d with d >= 0 in both sensors.

    normals_*: (M, 3), offsets_*: (M,) [m]. The rotation maximises sum n_c . R n_l with det R = +1, then
    (R n_l) . t = d_c - d_l by least squares. What the planes leave open is taken from `prior` (4, 4), if given.
    """
    M = normals_camera.T @ normals_lidar
    if prior is not None:
        M = M + SOLVE.prior_share * len(normals_camera) * prior[:3, :3]
    R = nearest_rotation(M)
    start = np.zeros(3) if prior is None else prior[:3, 3]
    A = normals_lidar @ R.T
    t = (
        start
        + np.linalg.lstsq(
            A, offsets_camera - offsets_lidar - A @ start, rcond=1e-6 if prior is None else SOLVE.prior_share
        )[0]
    )
    return transform(R, t)


def mismatch(pairs: PlanePairs, T_camera_lidar: Array) -> tuple[Array, Array]:
    """How far the LiDAR's planes, moved by T, miss the camera's: (M, 3) and its (M, 3, 6) derivative by a left twist.

    The three numbers are two tilts [rad] and the distance at the camera's board centre [m]. T may also be
    (M, 4, 4), one for each board.
    """
    R, t = T_camera_lidar[..., :3, :3], T_camera_lidar[..., :3, 3]
    moved = np.einsum("...ab,mb->ma" if R.ndim == 2 else "mab,mb->ma", R, pairs.normals_lidar)
    offsets = pairs.offsets_lidar + np.sum(moved * t, axis=-1)
    basis = tangent_basis(pairs.normals_camera)
    tilt = np.einsum("mka,ma->mk", basis, moved)
    gap = offsets - np.sum(moved * pairs.centers_camera, axis=1)
    J = np.zeros((len(pairs), 3, 6))
    J[:, :2, :3] = cross(moved[:, None, :], basis)
    J[:, 2, :3] = -cross(moved, pairs.centers_camera)
    J[:, 2, 3:] = moved
    return np.column_stack([tilt, gap]), J


def mismatch_covariance(pairs: PlanePairs, T_camera_lidar: Array) -> Array:
    """(M, 3, 3) covariance of `mismatch` from both sensors' planes."""
    R, t = T_camera_lidar[:3, :3], T_camera_lidar[:3, 3]
    move = np.zeros((4, 4))
    move[:3, :3], move[3, :3], move[3, 3] = R, t @ R, 1.0
    pick = np.zeros((len(pairs), 3, 4))
    pick[:, :2, :3] = tangent_basis(pairs.normals_camera)
    pick[:, 2, :3] = -pairs.centers_camera
    pick[:, 2, 3] = 1.0
    total = move @ pairs.covariances_lidar @ move.T + pairs.covariances_camera
    return np.asarray(pick @ total @ np.swapaxes(pick, 1, 2))


def weighted(pairs: PlanePairs, start: Array, iterations: int = 10) -> tuple[Array, Array]:
    """The plane solution with every normal and offset weighed by its covariance: T_camera_lidar and H (6, 6).

    Gauss-Newton on `mismatch` from `start`; H is the information of a left twist. Directions that the
    boards leave open stay as they are in `start`.
    """
    T = start
    H = np.zeros((6, 6))
    for _ in range(iterations):
        W = weights_of(mismatch_covariance(pairs, T))
        z, J = mismatch(pairs, T)
        JW = np.swapaxes(J, 1, 2) @ W
        H = (JW @ J).sum(axis=0)
        step = -pseudo_inverse(H) @ np.einsum("mka,ma->k", JW, z)
        T = apply_twist(step, T)
        if float(np.abs(step).max()) < 1e-13:
            break
    return T, H


def weights_of(covariances: Array) -> Array:
    """(M, 3, 3) covariances of `mismatch` to weights; floors keep perfect data finite."""
    floor = np.diag([1e-12, 1e-12, 1e-12])
    return np.asarray(np.linalg.inv(covariances + floor))


def pseudo_inverse(H: Array) -> Array:
    """(6, 6) information to its inverse, 0 along directions that carry none."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(H), 1e-300))
    return np.asarray(
        scale[:, None] * np.linalg.pinv(scale[:, None] * H * scale, rcond=1e-10, hermitian=True) * scale
    )


def covariance_of(H: Array) -> Array:
    """(n, n) information to covariance; a direction that carries none gets the variance 1 (rad^2, m^2): unknown."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(H), 1e-12))
    values, vectors = np.linalg.eigh(scale[:, None] * H * scale)
    seen = values > 1e-10 * max(float(values[-1]), 1e-300)
    known = vectors[:, seen] * scale[:, None]
    lost = np.linalg.qr(vectors[:, ~seen] / scale[:, None])[0]
    return np.asarray((known / values[seen]) @ known.T + lost @ lost.T)


def in_plane_offset(pairs: PlanePairs, T_camera_lidar: Array) -> Array:
    """(M,) how far the board's centre in the cloud lies beside the one in the picture, along the board [m]."""
    R, t = T_camera_lidar[..., :3, :3], T_camera_lidar[..., :3, 3]
    moved = np.einsum("...ab,mb->ma" if R.ndim == 2 else "mab,mb->ma", R, pairs.centers_lidar) + t
    gap = moved - pairs.centers_camera
    along = gap - np.sum(gap * pairs.normals_camera, axis=1, keepdims=True) * pairs.normals_camera
    return np.asarray(np.linalg.norm(along, axis=1))


def split_covariance(covariance: Array, T_camera_lidar: Array) -> Array:
    """(6, 6) of a left twist to (6, 6) of the rotation vector about the camera's axes [rad] and of t itself [m]."""
    J = split_jacobian(T_camera_lidar)
    return np.asarray(J @ covariance @ J.T)


def split_jacobian(T_camera_lidar: Array) -> Array:
    """(6, 6) derivative of the rotation vector and of t itself by a left twist."""
    J: Array = np.eye(6)
    J[3:, :3] = -skew(T_camera_lidar[:3, 3])
    return J
