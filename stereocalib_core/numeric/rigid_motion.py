"""The rigid motion of a camera between two pictures from points of known inverse depth, robustly.

Gauss-Newton with Cauchy weights on the reprojection error. Rays (5, M) hold x, y, inverse depth, x', y' in
normalised coordinates. A motion is (rotation vector, translation) of T_current_previous.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.small_algebra import (
    FAST,
    rotation_from_vector,
    solve_symmetric,
    vector_from_rotation,
)


@njit(cache=True, nogil=True, fastmath=FAST)
def _accumulate(
    rays: Array,
    first: int,
    last: int,
    R: Array,
    t: Array,
    weight: float,
    H: Array,
    g: Array,
) -> tuple[float, float]:
    """Normal equations of points first ... last: H (6, 6, lower) and g (6,), overwritten.

    weight: 1 / Cauchy scale^2 (normalised units). Returns the weighted squared error and the sum of weights.
    """
    r00, r01, r02 = R[0, 0], R[0, 1], R[0, 2]
    r10, r11, r12 = R[1, 0], R[1, 1], R[1, 2]
    r20, r21, r22 = R[2, 0], R[2, 1], R[2, 2]
    t0, t1, t2 = t[0], t[1], t[2]
    a = np.zeros(21)
    b = np.zeros(6)
    cost = 0.0
    total = 0.0
    for k in range(first, last):
        x, y = rays[0, k], rays[1, k]
        inverse = rays[2, k]
        if not inverse > 1e-4:
            continue
        qz = r20 * x + r21 * y + r22 + t2 * inverse
        if not qz > 0.05:
            continue
        iz = 1.0 / qz
        X = (r00 * x + r01 * y + r02 + t0 * inverse) * iz
        Y = (r10 * x + r11 * y + r12 + t1 * inverse) * iz
        ru, rv = rays[3, k] - X, rays[4, k] - Y
        e2 = ru * ru + rv * rv
        w = 1.0 / (1.0 + e2 * weight)
        cost += w * e2
        total += w
        s = inverse * iz
        # rows of the Jacobian: rotation, translation
        u0, u1, u2, u3, u5 = -X * Y, 1.0 + X * X, -Y, s, -s * X
        v0, v1, v2, v4, v5 = -1.0 - Y * Y, X * Y, X, s, -s * Y
        a[0] += w * (u0 * u0 + v0 * v0)
        a[1] += w * (u1 * u0 + v1 * v0)
        a[2] += w * (u1 * u1 + v1 * v1)
        a[3] += w * (u2 * u0 + v2 * v0)
        a[4] += w * (u2 * u1 + v2 * v1)
        a[5] += w * (u2 * u2 + v2 * v2)
        a[6] += w * u3 * u0
        a[7] += w * u3 * u1
        a[8] += w * u3 * u2
        a[9] += w * u3 * u3
        a[10] += w * v4 * v0
        a[11] += w * v4 * v1
        a[12] += w * v4 * v2
        a[14] += w * v4 * v4
        a[15] += w * (u5 * u0 + v5 * v0)
        a[16] += w * (u5 * u1 + v5 * v1)
        a[17] += w * (u5 * u2 + v5 * v2)
        a[18] += w * u5 * u3
        a[19] += w * v5 * v4
        a[20] += w * (u5 * u5 + v5 * v5)
        b[0] += w * (u0 * ru + v0 * rv)
        b[1] += w * (u1 * ru + v1 * rv)
        b[2] += w * (u2 * ru + v2 * rv)
        b[3] += w * u3 * ru
        b[4] += w * v4 * rv
        b[5] += w * (u5 * ru + v5 * rv)
    n = 0
    for i in range(6):
        g[i] = b[i]
        for j in range(i + 1):
            H[i, j] = a[n]
            n += 1
    return cost, total


@njit(cache=True, nogil=True)
def moved(R: Array, t: Array, step: Array) -> Array:
    """Left update of (R, t); changes t in place and returns the new R."""
    E = rotation_from_vector(step[:3])
    turned = E @ t
    for i in range(3):
        t[i] = turned[i] + step[3 + i]
    return E @ R


@njit(cache=True, nogil=True)
def rigid_pair(
    rays: Array,
    first: int,
    last: int,
    motion: Array,
    focal_px: float,
    cauchy_px: float,
    iterations: int,
    information: Array,
) -> float:
    """Six degrees of freedom from points first ... last; `motion` (6,) is start and result, `information` (6, 6) is
    filled. Returns the variance of one image coordinate in normalised units, negative where there is no solution."""
    R = rotation_from_vector(motion[:3])
    t = motion[3:].copy()
    scale = (focal_px / cauchy_px) ** 2
    H = np.zeros((6, 6))
    g = np.zeros(6)
    step = np.zeros(6)
    variance = -1.0
    for _ in range(iterations):
        cost, total = _accumulate(rays, first, last, R, t, scale, H, g)
        for i in range(6):
            H[i, i] += 1e-9
            for j in range(i + 1):
                information[i, j] = information[j, i] = H[i, j]
        if total <= 0.0 or not solve_symmetric(H, g, 6, step):
            return -1.0
        R = moved(R, t, step)
        variance = 0.5 * cost / total
        largest = 0.0
        for i in range(6):
            largest = max(largest, abs(step[i]))
        if largest < 2e-6:
            break
    turned = vector_from_rotation(R)
    for i in range(3):
        motion[i], motion[3 + i] = turned[i], t[i]
    return variance
