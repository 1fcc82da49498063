"""Normal equations of the pair's own turn, for every two frames of a drive at once.

A point of the world is seen four times: in both pictures of the frame before and in both of this one. Its inverse
depth is unknown and eliminated here, exactly, so that the noise of a disparity cannot pass for a slope (errors in
variables); what is left are the six unknowns of the motion between the frames and the three of the pair.

Units: image coordinates are divided by the focal length, disparities too, and translations by the baseline, so
that a point's disparity is its inverse depth. The pair's turn is (yaw, roll, pitch) of the right camera, signs as
in `front.rows.self_check`: P_right = Rx(pitch) Rz(roll) Ry(yaw) P. To first order it takes from the disparity
yaw (1 + x^2) - roll y - pitch x y, with x, y of the point in the right picture; and it moves the rows of the right
picture down by yaw x y + roll x, of which a match along rows takes `lean` times as much from the disparity
(`front.tracks.row_patches.row_leans`). What a pitch moves is left out: it leans both ways, and 0.06 deg, 0.75 px, are
beyond what is linear in it (on a rendered drive the yaw was off by 0.0037 deg with it, by 0.0013 deg without).
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from stereocalib_core.numeric.small_algebra import FAST, rotation_from_vector, vector_from_rotation

Array = NDArray[np.float64]

MOTION, TURN = 6, 3
"""Unknowns of a motion (rotation vector, translation) and of the pair's turn (yaw, roll, pitch)."""


@njit(cache=True, nogil=True, fastmath=FAST)
def _turned(x_right: float, y: float, lean: float, out: Array) -> None:
    """(3,) what a turn by (yaw, roll, pitch) takes from the disparity at a point of the right picture."""
    out[0] = 1.0 + x_right * x_right + lean * x_right * y
    out[1] = -y + lean * x_right
    out[2] = -x_right * y


@njit(cache=True, nogil=True, fastmath=FAST)
def pair_equations(
    first: int,
    last: int,
    rays: Array,
    start: NDArray[np.int64],
    active: NDArray[np.bool_],
    motions: Array,
    turn: Array,
    noise: float,
    tuning: float,
    normal: Array,
    right: Array,
    misfit: Array,
) -> None:
    """Fill rows first ... last of `normal` (N, 9, 9) and `right` (N, 9), and `misfit` (M,), all in place.

    rays: (8, M) x, y, disparity before, x, y, disparity now, lean of either. motions: (N, 6) of T_current_previous.
    turn: (3,) so far. noise: standard deviation of every one of the four measurements of a point. tuning: misfit /
    noise^2 at which a point's weight is a quarter (Geman-McClure). misfit: squared residual of each point over noise^2,
    with its best inverse depth; 3 on average where all is well.
    """
    J = np.zeros((4, MOTION + TURN))
    e, slope = np.zeros(4), np.zeros(4)
    before, now = np.zeros(TURN), np.zeros(TURN)
    column = np.zeros(MOTION + TURN)
    scale = 1.0 / noise
    for i in range(first, last):
        normal[i] = 0.0
        right[i] = 0.0
        if not active[i]:
            continue
        R, t = rotation_from_vector(motions[i, :3]), motions[i, 3:6]
        for k in range(start[i], start[i + 1]):
            x, y, x2, y2 = rays[0, k], rays[1, k], rays[3, k], rays[4, k]
            _turned(x - rays[2, k], y, rays[6, k], before)
            _turned(x2 - rays[5, k], y2, rays[7, k], now)
            d1, d2 = rays[2, k], rays[5, k]
            for p in range(TURN):
                d1 += before[p] * turn[p]
                d2 += now[p] * turn[p]
            q0 = R[0, 0] * x + R[0, 1] * y + R[0, 2]
            q1 = R[1, 0] * x + R[1, 1] * y + R[1, 2]
            q2 = R[2, 0] * x + R[2, 1] * y + R[2, 2]
            w, squares, gradient = d1, 1.0, 0.0
            X = Y = W = iz = 0.0
            behind = False
            # the inverse depth is almost linear: one step and a last look at the residuals
            for look in range(2):
                z = q2 + t[2] * w
                if not z > 0.05:
                    behind = True
                    break
                iz = 1.0 / z
                X, Y, W = (q0 + t[0] * w) * iz, (q1 + t[1] * w) * iz, w * iz
                e[0], e[1], e[2], e[3] = d1 - w, x2 - X, y2 - Y, d2 - W
                slope[0] = -1.0
                slope[1] = -(t[0] - X * t[2]) * iz
                slope[2] = -(t[1] - Y * t[2]) * iz
                slope[3] = -(1.0 - W * t[2]) * iz
                squares = gradient = 0.0
                for r in range(4):
                    squares += slope[r] * slope[r]
                    gradient += slope[r] * e[r]
                if look == 0:
                    w -= gradient / squares
            if behind:
                misfit[k] = np.inf
                continue
            total = -gradient * gradient / squares
            for r in range(4):
                total += e[r] * e[r]
            total *= scale * scale
            misfit[k] = total
            weight = 1.0 / (1.0 + total / tuning) ** 2
            for p in range(TURN):
                J[0, MOTION + p] = before[p]
                J[3, MOTION + p] = now[p]
            J[1, 0], J[1, 1], J[1, 2], J[1, 3], J[1, 5] = X * Y, -1.0 - X * X, Y, -W, X * W
            J[2, 0], J[2, 1], J[2, 2], J[2, 4], J[2, 5] = 1.0 + Y * Y, -X * Y, -X, -W, Y * W
            J[3, 0], J[3, 1], J[3, 5] = W * Y, -W * X, W * W
            for p in range(MOTION + TURN):
                column[p] = 0.0
                for r in range(4):
                    column[p] += J[r, p] * slope[r]
            share = weight * scale * scale
            for p in range(MOTION + TURN):
                value = -column[p] * gradient / squares
                for r in range(4):
                    value += J[r, p] * e[r]
                right[i, p] -= share * value
                for q in range(p + 1):
                    value = -column[p] * column[q] / squares
                    for r in range(4):
                        value += J[r, p] * J[r, q]
                    normal[i, p, q] += share * value
        for p in range(MOTION + TURN):
            for q in range(p):
                normal[i, q, p] = normal[i, p, q]


@njit(cache=True, nogil=True)
def move(motions: Array, used: NDArray[np.int64], steps: Array) -> None:
    """Left update of the motions (N, 6) of the `used` (K,) pairs by (K, 6) steps, in place."""
    for n in range(len(used)):
        i = used[n]
        turn = rotation_from_vector(steps[n, :3])
        translation = turn @ motions[i, 3:].copy()
        motions[i, :3] = vector_from_rotation(turn @ rotation_from_vector(motions[i, :3]))
        for p in range(3):
            motions[i, 3 + p] = translation[p] + steps[n, 3 + p]
