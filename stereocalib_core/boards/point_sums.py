"""Compiled loops over all points of all boards: the distances to their boards, and what these sum up to.

A refinement runs over some ten thousand points some fifty times; whatever hangs on a tick in a page hangs on this.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from stereocalib_core.numeric.arrays import Array


@njit(cache=True, nogil=True)
def distances_and_places(
    points: Array,
    rays: Array,
    owner: NDArray[np.int64],
    axes: Array,
    places: Array,
    errors: Array,
    slant_floor: float,
) -> tuple[Array, Array, Array]:
    """distance (P,) signed [m], slant (P,) |n . u|, along (P, 2) [m] where the rays meet their boards.

    points, rays: (P, 3) and their unit directions in the LiDAR frame. owner: (P,) the board of each. axes: (M, 3, 3)
    boards' axes as columns, places: (M, 3) their origins along these axes [m]. errors: (M, 3) tilt along x, along y
    [rad] and offset [m] of each plane as a whole, which are taken off the distances.
    """
    count = len(points)
    distance, slant, along = np.empty(count), np.empty(count), np.empty((count, 2))
    for p in range(count):
        m = owner[p]
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        u, v, w = rays[p, 0], rays[p, 1], rays[p, 2]
        gap = x * axes[m, 0, 2] + y * axes[m, 1, 2] + z * axes[m, 2, 2] - places[m, 2]
        facing = u * axes[m, 0, 2] + v * axes[m, 1, 2] + w * axes[m, 2, 2]
        slant[p] = max(abs(facing), slant_floor)
        back = gap / (slant[p] if facing >= 0.0 else -slant[p])
        x, y, z = x - back * u, y - back * v, z - back * w
        for k in range(2):
            along[p, k] = x * axes[m, 0, k] + y * axes[m, 1, k] + z * axes[m, 2, k] - places[m, k]
        distance[p] = gap - along[p, 0] * errors[m, 0] - along[p, 1] * errors[m, 1] - errors[m, 2]
    return distance, slant, along


@njit(cache=True, nogil=True)
def huber_sums(
    distance: Array,
    slant: Array,
    along: Array,
    owner: NDArray[np.int64],
    boards: int,
    range_sigma_m: float,
    huber: float,
) -> tuple[float, Array, Array]:
    """Half the sum of squares under Huber's loss, and for each board its weighed moments (M, 3, 3) of (1, x, y) and
    pulls (M, 3) along these."""
    total = 0.0
    moments, pulls = np.zeros((boards, 3, 3)), np.zeros((boards, 3))
    for p in range(len(distance)):
        m = owner[p]
        sigma = slant[p] * range_sigma_m
        residual = distance[p] / sigma
        size = abs(residual)
        weight = 1.0
        if size <= huber:
            total += 0.5 * residual * residual
        else:
            total += huber * size - 0.5 * huber * huber
            weight = huber / size
        x, y, scale = along[p, 0], along[p, 1], weight / (sigma * sigma)
        moments[m, 0, 0] += scale
        moments[m, 0, 1] += scale * x
        moments[m, 0, 2] += scale * y
        moments[m, 1, 1] += scale * x * x
        moments[m, 1, 2] += scale * x * y
        moments[m, 2, 2] += scale * y * y
        pull = weight * residual / sigma
        pulls[m, 0] += pull
        pulls[m, 1] += pull * x
        pulls[m, 2] += pull * y
    for m in range(boards):
        moments[m, 1, 0], moments[m, 2, 0], moments[m, 2, 1] = (
            moments[m, 0, 1],
            moments[m, 0, 2],
            moments[m, 1, 2],
        )
    return total, moments, pulls


def warm_up() -> None:
    """Compile the two for one point."""
    one = np.ones((1, 3))
    owner = np.zeros(1, dtype=np.int64)
    distance, slant, along = distances_and_places(one, one, owner, np.eye(3)[None], one, one, 0.02)
    huber_sums(distance, slant, along, owner, 1, 0.01, 2.5)
