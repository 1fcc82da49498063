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

_BLOCK = 64
"""Points taken at once: what is worked on stays in the processor's first cache."""
_GIVEN = 16 * _BLOCK
_ROOM = 22 * _BLOCK
"""A block's room, in one array whose parts lie at fixed places, so that the compiler may take several points at once:
sixteen rows of the Jacobian and the residual, unknown by unknown along the flow and across it, then what is given of
the points."""


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
def _rows(
    count: int,
    R: Array,
    t: Array,
    depth: float,
    scaled: float,
    noise2: float,
    weight: float,
    room: Array,
) -> float:
    """Fill the rows of `room` with the weighted Jacobian of `count` points and their residual, zero where a point is
    not seen. Returns the sum of weights."""
    r00, r01, r02 = R[0, 0], R[0, 1], R[0, 2]
    r10, r11, r12 = R[1, 0], R[1, 1], R[1, 2]
    r20, r21, r22 = R[2, 0], R[2, 1], R[2, 2]
    t0, t1, t2 = t[0], t[1], t[2]
    depth2 = depth * depth / noise2
    total = 0.0
    for k in range(count):
        x, y, measured = room[_GIVEN + k], room[_GIVEN + _BLOCK + k], depth * room[_GIVEN + 2 * _BLOCK + k]
        in_front = r20 * x + r21 * y + r22 + t2 * measured
        seen = (measured > 1e-4) & (in_front > 0.05)
        inverse = measured if seen else 1.0
        iz = 1.0 / (in_front if seen else 1.0)
        X = (r00 * x + r01 * y + r02 + t0 * inverse) * iz
        Y = (r10 * x + r11 * y + r12 + t1 * inverse) * iz
        ru, rv = room[_GIVEN + 3 * _BLOCK + k] - X, room[_GIVEN + 4 * _BLOCK + k] - Y
        # image motion per inverse depth: the direction of the flow
        fu, fv = iz * (t0 - X * t2), iz * (t1 - Y * t2)
        f2 = fu * fu + fv * fv + 1e-18
        along = 1.0 / np.sqrt(f2)
        fu, fv = fu * along, fv * along
        shrink = 1.0 / np.sqrt(1.0 + depth2 * room[_GIVEN + 5 * _BLOCK + k] * f2)
        pu, pv = shrink * fu, shrink * fv
        ra, rc = pu * ru + pv * rv, fu * rv - fv * ru
        w = 1.0 / (1.0 + (ra * ra + rc * rc) * weight)
        w = w if seen else 0.0
        total += w
        root = np.sqrt(w)
        s = inverse * iz
        # the Jacobian: rotation, translation, logarithm of the depth factor
        u0, u1, u2 = -X * Y, 1.0 + X * X, -Y
        v0, v1, v2 = -1.0 - Y * Y, X * Y, X
        pu, pv, cu, cv = root * pu, root * pv, root * fu, root * fv
        room[k], room[_BLOCK + k] = pu * u0 + pv * v0, cu * v0 - cv * u0
        room[2 * _BLOCK + k], room[3 * _BLOCK + k] = pu * u1 + pv * v1, cu * v1 - cv * u1
        room[4 * _BLOCK + k], room[5 * _BLOCK + k] = pu * u2 + pv * v2, cu * v2 - cv * u2
        room[6 * _BLOCK + k], room[7 * _BLOCK + k] = pu * s, -cv * s
        room[8 * _BLOCK + k], room[9 * _BLOCK + k] = pv * s, cu * s
        room[10 * _BLOCK + k], room[11 * _BLOCK + k] = -s * (pu * X + pv * Y), s * (cv * X - cu * Y)
        # the flow has no part across itself
        room[12 * _BLOCK + k], room[13 * _BLOCK + k] = scaled * root * inverse * shrink * f2 * along, 0.0
        room[14 * _BLOCK + k], room[15 * _BLOCK + k] = root * ra, root * rc
    return total


@njit(cache=True, nogil=True, fastmath=FAST)
def _accumulate(
    rays: Array,
    first: int,
    last: int,
    R: Array,
    t: Array,
    depth: float,
    scaled: float,
    noise2: float,
    weight: float,
    room: Array,
    H: Array,
    g: Array,
) -> tuple[float, float]:
    """Add the normal equations of points first ... last to H (7, 7, lower) and g (7,).

    rays: (6, M), the last row being the variance of the inverse depth. depth: factor of the inverse depths, whose
    logarithm is the seventh unknown if `scaled` is 1 and not 0. noise2: variance of a track, weight: 1 / Cauchy
    scale^2 (normalised units). room: (`_ROOM`,) to work in. Each residual is split along the flow and across it,
    and the first is shrunk to the track's noise. Returns the weighted squared error and the sum of weights.
    """
    cost = total = 0.0
    for begin in range(first, last, _BLOCK):
        count = min(_BLOCK, last - begin)
        for j in range(6):
            room[_GIVEN + j * _BLOCK : _GIVEN + j * _BLOCK + count] = rays[j, begin : begin + count]
        total += _rows(count, R, t, depth, scaled, noise2, weight, room)
        for i in range(8):
            p = room[2 * i * _BLOCK : 2 * (i + 1) * _BLOCK]
            for j in range(i + 1):
                q = room[2 * j * _BLOCK : 2 * (j + 1) * _BLOCK]
                product = 0.0
                for k in range(count):
                    product += p[k] * q[k] + p[_BLOCK + k] * q[_BLOCK + k]
                if i < 7:
                    H[i, j] += product
                elif j < 7:
                    g[j] += product
                else:
                    cost += product
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
    """Six degrees of freedom of one pair; `motion` (6,) is start and result, `information` (6, 6) is filled.

    The depths of points `first` ... `middle` are taken as they are. Those of `middle` ... `last` have one common
    factor, whose logarithm is held to zero by `scale_sigma`: they steady the rotation and leave the scale to the
    others. solver: typical residual [px], iterations at most, and points of either kind without which there is no
    factor. Returns the variance of one image coordinate in normalised units, negative where there is no solution.
    """
    noise_px, iterations, least = solver
    R = rotation_from_vector(motion[:3])
    t = motion[3:].copy()
    weight = (focal_px / cauchy_px) ** 2
    noise2 = (noise_px / focal_px) ** 2
    size = 7 if middle - first >= least and last - middle >= least else 6
    depth, scaled = 1.0, 1.0 if size == 7 else 0.0
    room = np.empty(_ROOM)
    # in the units of the residuals, which are taken as `noise_px`
    prior = noise2 / scale_sigma**2
    H = np.zeros((7, 7))
    g = np.zeros(7)
    step = np.zeros(7)
    variance = -1.0
    for _ in range(iterations):
        H[:] = 0.0
        g[:] = 0.0
        cost, total = _accumulate(rays, first, middle, R, t, 1.0, 0.0, noise2, weight, room, H, g)
        more, votes = _accumulate(rays, middle, last, R, t, depth, scaled, noise2, weight, room, H, g)
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
    turned = vector_from_rotation(R)
    for i in range(3):
        motion[i], motion[3 + i] = turned[i], t[i]
    return variance
