"""Small rotations and twists, and the Euler angles of the reports."""

from __future__ import annotations

import numpy as np

from stereocalib_core.geometry import transform
from stereocalib_core.numeric.arrays import Array


def cross(a: Array, b: Array) -> Array:
    """(..., 3) x (..., 3), three times as quick as numpy's for the few vectors of a set of boards."""
    result = np.empty(np.broadcast_shapes(a.shape, b.shape))
    result[..., 0] = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    result[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    result[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return result


def skew(v: Array) -> Array:
    """(..., 3) to (..., 3, 3) with skew(v) w = v x w."""
    v = np.asarray(v, dtype=np.float64)
    result = np.zeros((*v.shape, 3))
    result[..., 0, 1], result[..., 0, 2] = -v[..., 2], v[..., 1]
    result[..., 1, 0], result[..., 1, 2] = v[..., 2], -v[..., 0]
    result[..., 2, 0], result[..., 2, 1] = -v[..., 1], v[..., 0]
    return result


def rotation_from_vector(w: Array) -> Array:
    """(..., 3) rotation vectors [rad] to (..., 3, 3), Rodrigues' formula."""
    w = np.asarray(w, dtype=np.float64)
    angle = np.linalg.norm(w, axis=-1)[..., None, None]
    K = skew(w)
    small = angle < 1e-6
    safe = np.where(small, 1.0, angle)
    a = np.where(small, 1.0 - angle**2 / 6, np.sin(safe) / safe)
    b = np.where(small, 0.5 - angle**2 / 24, (1 - np.cos(safe)) / safe**2)
    return np.eye(3) + a * K + b * (K @ K)


def apply_twist(step: Array, T: Array) -> Array:
    """Move (..., 4, 4) by a (..., 6) left step (rotation [rad], then translation [m]): R' = dR R, t' = dR t + dt."""
    R = rotation_from_vector(step[..., :3])
    result = np.zeros(np.broadcast_shapes(step.shape[:-1], T.shape[:-2]) + (4, 4))
    result[..., :3, :3] = R @ T[..., :3, :3]
    result[..., :3, 3] = np.einsum("...ij,...j->...i", R, T[..., :3, 3]) + step[..., 3:]
    result[..., 3, 3] = 1.0
    return result


def nearest_rotation(M: Array) -> Array:
    """(..., 3, 3) to the rotation that maximises trace(R^T M): orthogonal Procrustes with det R = +1."""
    U, _, Vt = np.linalg.svd(M)
    sign = np.linalg.det(U @ Vt)
    U = U.copy()
    U[..., :, 2] *= np.where(sign < 0, -1.0, 1.0)[..., None]
    return U @ Vt


def angle_between(a: Array, b: Array) -> Array:
    """(..., 3) unit vectors to the angle between them [rad], exact for small angles too."""
    return np.arctan2(np.linalg.norm(cross(a, b), axis=-1), np.sum(a * b, axis=-1))


def rotation_angle(R: Array) -> float:
    """The angle of a (3, 3) rotation [rad]."""
    axis = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    return float(np.arctan2(np.linalg.norm(axis) / 2, (np.trace(R) - 1) / 2))


def roll_pitch_yaw(R: Array) -> Array:
    """(3, 3) to roll, pitch, yaw [rad] of R = Rz(yaw) Ry(pitch) Rx(roll)."""
    pitch = np.arctan2(-R[2, 0], np.hypot(R[2, 1], R[2, 2]))
    return np.array([np.arctan2(R[2, 1], R[2, 2]), pitch, np.arctan2(R[1, 0], R[0, 0])])


def rotation_from_roll_pitch_yaw(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Array:
    """The inverse of `roll_pitch_yaw`."""
    x, y, z = np.eye(3)
    return (
        rotation_from_vector(z * yaw_rad)
        @ rotation_from_vector(y * pitch_rad)
        @ rotation_from_vector(x * roll_rad)
    )


def rigid(rotation: Array, translation: Array) -> Array:
    """(..., 3, 3) and (..., 3) to (..., 4, 4)."""
    if rotation.ndim == 2:
        return transform(rotation, translation)
    result = np.zeros((*rotation.shape[:-2], 4, 4))
    result[..., :3, :3], result[..., :3, 3], result[..., 3, 3] = rotation, translation, 1.0
    return result


def rotation_vector(R: Array) -> Array:
    """(3, 3) rotation to its vector [rad], the inverse of `rotation_from_vector` for turns below pi."""
    axis = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2
    sine = float(np.linalg.norm(axis))
    angle = np.arctan2(sine, (np.trace(R) - 1) / 2)
    return axis * (angle / sine if sine > 1e-12 else 1.0)
