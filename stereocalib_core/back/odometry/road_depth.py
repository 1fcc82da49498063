"""How far away a road point is: what the road's extrinsics say (eq. 16) and what its disparity says, together.

Eq. 16 divided by f b gives the inverse depth of an image point that lies on the road,

    q(x, y) = (cos(roll) cos(pitch) y - sin(roll) x + cos(roll) sin(pitch)) / h,

with x = (u - u0) / f, y = (v - v0) / f, so that the road is metric by the height of the camera as everything else is
by the baseline. Both have an error: the extrinsics' by their sigma, the disparity's by its noise. The depth
that the odometry uses is the mean weighted by their precisions.

The weights belong to the drive and not to a variant: what a correction, a strength or an injected error does to the
extrinsics changes q and nothing else.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from stereocalib_core.config import OdometryConfig
from stereocalib_core.numeric.arrays import Array


@njit(cache=True, nogil=True)
def fuse(
    rays: Array,
    first: int,
    middle: int,
    last: int,
    used: Array,
    given: Array,
    sigma: Array,
    disparity_variance: float,
    on_road: bool,
    result: Array,
) -> None:
    """Fill result (6, last - first or more): points first ... last of `rays` (5, M), and the variance of their depths.

    With `on_road` the inverse depths of the road points, first ... middle, are fused. used: (3 or more) height [m],
    pitch, roll [rad] of the frame before as a variant has them; given: as the drive has them, with sigma (3,).
    disparity_variance: of a measured inverse depth [1/m^2].
    """
    for row in range(5):
        for k in range(last - first):
            result[row, k] = rays[row, first + k]
    for k in range(last - first):
        result[5, k] = disparity_variance
    if not on_road:
        return
    J = np.zeros(3)
    h, cp, sp = given[0], np.cos(given[1]), np.sin(given[1])
    cr, sr = np.cos(given[2]), np.sin(given[2])
    h_used = used[0]
    cp_used, sp_used = np.cos(used[1]), np.sin(used[1])
    cr_used, sr_used = np.cos(used[2]), np.sin(used[2])
    for k in range(first, middle):
        x, y = rays[0, k], rays[1, k]
        J[0] = -(cr * cp * y - sr * x + cr * sp) / (h * h)
        J[1] = (-cr * sp * y + cr * cp) / h
        J[2] = (-sr * cp * y - cr * x - sr * sp) / h
        variance = 0.0
        for a in range(3):
            variance += (J[a] * sigma[a]) ** 2
        share = disparity_variance / (disparity_variance + variance)
        road = (cr_used * cp_used * y - sr_used * x + cr_used * sp_used) / h_used
        result[5, k - first] = share * variance
        result[2, k - first] = share * road + (1.0 - share) * rays[2, k]


@njit(cache=True, nogil=True)
def fused_rays(
    rays: Array,
    start: NDArray[np.int64],
    road_end: NDArray[np.int64],
    previous: NDArray[np.int64],
    on_road: NDArray[np.bool_],
    used: Array,
    given: Array,
    sigma: Array,
    disparity_variance: float,
) -> Array:
    """(6, M) `rays` of all pairs with the inverse depths of the road points of the pairs in `on_road` (N,) fused, and
    all variances; extrinsics (N, 3 or more), else as for `fuse`."""
    result = np.empty((6, rays.shape[1]))
    for i in range(len(previous)):
        p = max(previous[i], 0)
        fuse(
            rays, start[i], road_end[i], start[i + 1], used[p], given[p], sigma[p], disparity_variance, on_road[i],
            result[:, start[i] :],
        )  # fmt: skip
    return result


def with_floors(sigma: Array | None, count: int, config: OdometryConfig) -> Array:
    """(N, 3) standard deviations of height, pitch, roll as a single point of the road sees them.

    A plane's sigma says how well it fits the road; the road under one point differs from any plane. Frames without a
    sigma are told by the floors alone.
    """
    floors = (
        config.road_height_floor_m,
        *np.deg2rad([config.road_pitch_floor_deg, config.road_roll_floor_deg]),
    )
    known = np.zeros((count, 3)) if sigma is None else np.where(np.isfinite(sigma), sigma, 0.0)
    return np.hypot(known, np.array(floors))
