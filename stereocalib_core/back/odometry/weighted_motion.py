"""The motion of a pair of frames from points whose depths have variances of their own.

As `numeric.rigid_motion`, but an image point is off by its track and, along its flow, by what its depth is off: the
nearer a point and the longer the way, the more. So near road points, whose flow is a hundred pixels, bring the scale
and not the rotation.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.rigid_motion import moved
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
    depth: float,
    scaled: bool,
    noise2: float,
    weight: float,
    H: Array,
    g: Array,
) -> tuple[float, float]:
    """Add the normal equations of points first ... last to H (7, 7, lower) and g (7,).

    rays: (6, M), the last row being the variance of the inverse depth. depth: factor of the inverse depths, whose
    logarithm is the seventh unknown if `scaled`. noise2: variance of a track, weight: 1 / Cauchy scale^2 (normalised
    units). Each residual is split along the flow and across it, and the first is shrunk to the track's noise.
    Returns the weighted squared error and the sum of weights.
    """
    r00, r01, r02 = R[0, 0], R[0, 1], R[0, 2]
    r10, r11, r12 = R[1, 0], R[1, 1], R[1, 2]
    r20, r21, r22 = R[2, 0], R[2, 1], R[2, 2]
    t0, t1, t2 = t[0], t[1], t[2]
    h = np.zeros(28)
    b = np.zeros(7)
    cost = 0.0
    total = 0.0
    for k in range(first, last):
        x, y = rays[0, k], rays[1, k]
        inverse = depth * rays[2, k]
        if not inverse > 1e-4:
            continue
        qz = r20 * x + r21 * y + r22 + t2 * inverse
        if not qz > 0.05:
            continue
        iz = 1.0 / qz
        X = (r00 * x + r01 * y + r02 + t0 * inverse) * iz
        Y = (r10 * x + r11 * y + r12 + t1 * inverse) * iz
        ru, rv = rays[3, k] - X, rays[4, k] - Y
        # image motion per inverse depth: the direction of the flow
        fu, fv = iz * (t0 - X * t2), iz * (t1 - Y * t2)
        f2 = fu * fu + fv * fv + 1e-18
        along = 1.0 / np.sqrt(f2)
        fu, fv = fu * along, fv * along
        shrink = 1.0 / np.sqrt(1.0 + depth * depth * rays[5, k] * f2 / noise2)
        pu, pv = shrink * fu, shrink * fv
        ra, rc = pu * ru + pv * rv, fu * rv - fv * ru
        e2 = ra * ra + rc * rc
        w = 1.0 / (1.0 + e2 * weight)
        cost += w * e2
        total += w
        s = inverse * iz
        # rows of the Jacobian: rotation, translation, logarithm of the depth factor
        u0, u1, u2 = -X * Y, 1.0 + X * X, -Y
        v0, v1, v2 = -1.0 - Y * Y, X * Y, X
        a0, c0 = pu * u0 + pv * v0, fu * v0 - fv * u0
        a1, c1 = pu * u1 + pv * v1, fu * v1 - fv * u1
        a2, c2 = pu * u2 + pv * v2, fu * v2 - fv * u2
        a3, c3 = pu * s, -fv * s
        a4, c4 = pv * s, fu * s
        a5, c5 = -s * (pu * X + pv * Y), s * (fv * X - fu * Y)
        # the flow has no part across itself
        a6, c6 = (inverse * shrink / along if scaled else 0.0), 0.0
        h[0] += w * (a0 * a0 + c0 * c0)
        h[1] += w * (a1 * a0 + c1 * c0)
        h[2] += w * (a1 * a1 + c1 * c1)
        h[3] += w * (a2 * a0 + c2 * c0)
        h[4] += w * (a2 * a1 + c2 * c1)
        h[5] += w * (a2 * a2 + c2 * c2)
        h[6] += w * (a3 * a0 + c3 * c0)
        h[7] += w * (a3 * a1 + c3 * c1)
        h[8] += w * (a3 * a2 + c3 * c2)
        h[9] += w * (a3 * a3 + c3 * c3)
        h[10] += w * (a4 * a0 + c4 * c0)
        h[11] += w * (a4 * a1 + c4 * c1)
        h[12] += w * (a4 * a2 + c4 * c2)
        h[13] += w * (a4 * a3 + c4 * c3)
        h[14] += w * (a4 * a4 + c4 * c4)
        h[15] += w * (a5 * a0 + c5 * c0)
        h[16] += w * (a5 * a1 + c5 * c1)
        h[17] += w * (a5 * a2 + c5 * c2)
        h[18] += w * (a5 * a3 + c5 * c3)
        h[19] += w * (a5 * a4 + c5 * c4)
        h[20] += w * (a5 * a5 + c5 * c5)
        h[21] += w * (a6 * a0 + c6 * c0)
        h[22] += w * (a6 * a1 + c6 * c1)
        h[23] += w * (a6 * a2 + c6 * c2)
        h[24] += w * (a6 * a3 + c6 * c3)
        h[25] += w * (a6 * a4 + c6 * c4)
        h[26] += w * (a6 * a5 + c6 * c5)
        h[27] += w * (a6 * a6 + c6 * c6)
        b[0] += w * (a0 * ra + c0 * rc)
        b[1] += w * (a1 * ra + c1 * rc)
        b[2] += w * (a2 * ra + c2 * rc)
        b[3] += w * (a3 * ra + c3 * rc)
        b[4] += w * (a4 * ra + c4 * rc)
        b[5] += w * (a5 * ra + c5 * rc)
        b[6] += w * (a6 * ra + c6 * rc)
    n = 0
    for i in range(7):
        g[i] += b[i]
        for j in range(i + 1):
            H[i, j] += h[n]
            n += 1
    return cost, total


@njit(cache=True, nogil=True)
def weighted_pair(
    rays: Array,
    first: int,
    middle: int,
    last: int,
    motion: Array,
    focal_px: float,
    scale_sigma: float,
    cauchy_px: float,
    solver: tuple[float, int, int],
    information: Array,
) -> float:
    """Six degrees of freedom of one pair by points with depth variances; arguments as of `full_pair`, rays (6, M)."""
    noise_px, iterations, least = solver
    R = rotation_from_vector(motion[:3])
    t = motion[3:].copy()
    weight = (focal_px / cauchy_px) ** 2
    noise2 = (noise_px / focal_px) ** 2
    size = 7 if middle - first >= least and last - middle >= least else 6
    depth = 1.0
    # in the units of the residuals, which are taken as `noise_px`
    prior = noise2 / scale_sigma**2
    H = np.zeros((7, 7))
    g = np.zeros(7)
    step = np.zeros(7)
    variance = -1.0
    for _ in range(iterations):
        H[:] = 0.0
        g[:] = 0.0
        cost, total = _accumulate(rays, first, middle, R, t, 1.0, False, noise2, weight, H, g)
        more, votes = _accumulate(rays, middle, last, R, t, depth, size == 7, noise2, weight, H, g)
        cost, total = cost + more, total + votes
        H[6, 6] += prior
        g[6] -= prior * np.log(depth)
        for i in range(6):
            H[i, i] += 1e-9
            for j in range(i + 1):
                information[i, j] = information[j, i] = H[i, j]
        if size == 7:
            for i in range(6):
                for j in range(6):
                    information[i, j] -= H[6, i] * H[6, j] / H[6, 6]
        if total <= 0.0 or not solve_symmetric(H, g, size, step):
            return -1.0
        R = moved(R, t, step)
        if size == 7:
            depth *= np.exp(min(max(step[6], -0.5), 0.5))
        variance = 0.5 * cost / total
        largest = 0.0
        for i in range(6):
            largest = max(largest, abs(step[i]))
        if largest < 2e-6:
            break
    motion[:3] = vector_from_rotation(R)
    motion[3:] = t
    return variance
