"""The road plane of each frame as the road tracks' own disparities show it."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from stereocalib_core.odometry.small_algebra import solve_symmetric

Array = NDArray[np.float64]

_FAST = {"reassoc", "contract", "arcp", "nsz"}


@njit(cache=True, nogil=True, fastmath=_FAST)
def _add_plane(
    x: Array, y: Array, inverse: Array, plane: Array, first: int, last: int, scale: float, H: Array, g: Array
) -> float:
    """Add the normal equations of inverse = plane . (x, y, 1); returns the sum of weights."""
    total = 0.0
    for k in range(first, last):
        if not inverse[k] > 0.0:
            continue
        r = inverse[k] - plane[0] * x[k] - plane[1] * y[k] - plane[2]
        w = 1.0 / (1.0 + r * r * scale)
        total += w
        H[0, 0] += w * x[k] * x[k]
        H[1, 0] += w * y[k] * x[k]
        H[1, 1] += w * y[k] * y[k]
        H[2, 0] += w * x[k]
        H[2, 1] += w * y[k]
        H[2, 2] += w
        g[0] += w * x[k] * r
        g[1] += w * y[k] * r
        g[2] += w * r
    return total


@njit(cache=True, nogil=True)
def fit_planes(
    rays: Array,
    current_inverse: Array,
    start: NDArray[np.int64],
    road_end: NDArray[np.int64],
    following: NDArray[np.int64],
    cauchy: float,
) -> Array:
    """(N, 4) normal / height [1/m] of the road by the road tracks' own disparities, and the points behind it.

    following: (N,) the pair whose previous frame is this one, -1 = none. cauchy: scale of the residual [1/m].
    """
    n = len(start) - 1
    planes = np.zeros((n, 4))
    for i in range(n):
        H = np.zeros((3, 3))
        g = np.zeros(3)
        step = np.zeros(3)
        plane = np.zeros(3)
        total = 0.0
        solved = True
        for iteration in range(6):
            H[:] = 0.0
            g[:] = 0.0
            scale = 0.0 if iteration == 0 else 1.0 / cauchy**2
            total = _add_plane(rays[3], rays[4], current_inverse, plane, start[i], road_end[i], scale, H, g)
            j = following[i]
            if j >= 0:
                total += _add_plane(rays[0], rays[1], rays[2], plane, start[j], road_end[j], scale, H, g)
            solved = total >= 20.0 and solve_symmetric(H, g, 3, step)
            if not solved:
                break
            plane += step
        if solved:
            planes[i, :3] = plane
            planes[i, 3] = total
    return planes
