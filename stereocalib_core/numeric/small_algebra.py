"""Rotations and small linear systems for compiled loops."""

from __future__ import annotations

import numpy as np
from numba import njit

from stereocalib_core.numeric.arrays import Array

FAST = {"reassoc", "contract", "arcp", "nsz"}
"""Fast arithmetic for inner loops that keeps NaN and infinity what they are: points are told by them."""


@njit(cache=True, nogil=True)
def rotation_from_vector(w: Array) -> Array:
    """(3,) rotation vector [rad] to (3, 3), Rodrigues' formula."""
    R = np.eye(3)
    angle2 = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
    angle = np.sqrt(angle2)
    if angle < 1e-6:
        a, b = 1.0 - angle2 / 6.0, 0.5 - angle2 / 24.0
    else:
        a, b = np.sin(angle) / angle, (1.0 - np.cos(angle)) / angle2
    for i in range(3):
        for j in range(3):
            R[i, j] += b * (w[i] * w[j] - (angle2 if i == j else 0.0))
    R[0, 1] -= a * w[2]
    R[1, 0] += a * w[2]
    R[0, 2] += a * w[1]
    R[2, 0] -= a * w[1]
    R[1, 2] -= a * w[0]
    R[2, 1] += a * w[0]
    return R


@njit(cache=True, nogil=True)
def vector_from_rotation(R: Array) -> Array:
    """(3, 3) to (3,) rotation vector [rad], for angles well below pi."""
    w = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) * 0.5
    s = np.sqrt(w[0] ** 2 + w[1] ** 2 + w[2] ** 2)
    c = 0.5 * (R[0, 0] + R[1, 1] + R[2, 2] - 1.0)
    if s > 1e-9:
        w *= np.arctan2(s, c) / s
    return w


@njit(cache=True, nogil=True)
def solve_symmetric(H: Array, g: Array, size: int, out: Array) -> bool:
    """Solve H[:size, :size] out = g by Cholesky; False where H is not positive definite. H is overwritten."""
    for i in range(size):
        for j in range(i + 1):
            s = H[i, j]
            for k in range(j):
                s -= H[i, k] * H[j, k]
            if i == j:
                if not s > 0.0:
                    return False
                H[i, i] = np.sqrt(s)
            else:
                H[i, j] = s / H[j, j]
    for i in range(size):
        s = g[i]
        for k in range(i):
            s -= H[i, k] * out[k]
        out[i] = s / H[i, i]
    for i in range(size - 1, -1, -1):
        s = out[i]
        for k in range(i + 1, size):
            s -= H[k, i] * out[k]
        out[i] = s / H[i, i]
    return True
