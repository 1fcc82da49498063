"""The motion of the camera in six degrees of freedom between two frames, for every pair of a drive at once.

- `solve_full`: road points at the depths that the caller gives them, and points above the road, which have one
  common depth factor per pair, close to one: they steady the rotation and leave the scale to the road.
- `solve_stereo`: all points alike, from measured disparities; no road needed.

Arrays are those of `PackedTracks`: `rays` (5, M) holds x, y, inverse depth, x', y' in normalised coordinates. A
motion of the camera is (rotation vector, translation) of T_current_previous. Frames are solved in parallel, each by
one worker in a fixed order, so a result repeats bit for bit.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from stereocalib_core.back.odometry.road_depth import fuse
from stereocalib_core.back.odometry.weighted_motion import weighted_pair
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.rigid_motion import rigid_pair


@njit(cache=True, nogil=True)
def solve_full(
    first: int,
    last: int,
    rays: Array,
    start: NDArray[np.int64],
    road_end: NDArray[np.int64],
    previous: NDArray[np.int64],
    on_road: NDArray[np.bool_],
    used: Array,
    given: Array,
    sigma: Array,
    disparity_variance: float,
    active: NDArray[np.bool_],
    initial: Array,
    focal_px: float,
    scale_sigma: float,
    cauchy_px: float,
    solver: tuple[float, int, int],
    motions: Array,
    covariances: Array,
) -> None:
    """Every active pair of first ... last by `weighted_pair`, in place; rays (5, M), fused pair by pair: see `fuse`.

    initial: (N, 6 or more) where to start. scale_sigma: of the depth factor of points off the road.
    motions: (N, 7) motion, and 1 where it was solved. covariances: (N, 6, 6).
    """
    most = 0
    for i in range(first, last):
        most = max(most, start[i + 1] - start[i])
    fused = np.empty((6, most))
    for i in range(first, last):
        if not active[i]:
            continue
        motion = initial[i, :6].copy()
        information = np.zeros((6, 6))
        p = max(previous[i], 0)
        fuse(
            rays, start[i], road_end[i], start[i + 1], used[p], given[p], sigma[p], disparity_variance, on_road[i],
            fused,
        )  # fmt: skip
        variance = weighted_pair(
            fused, 0, road_end[i] - start[i], start[i + 1] - start[i], motion,
            focal_px, scale_sigma, cauchy_px, solver, information,
        )  # fmt: skip
        if variance >= 0.0:
            motions[i, :6] = motion
            motions[i, 6] = 1.0
            covariances[i] = np.linalg.inv(information) * variance


@njit(cache=True, nogil=True)
def solve_stereo(
    first: int,
    last: int,
    rays: Array,
    start: NDArray[np.int64],
    previous: NDArray[np.int64],
    focal_px: float,
    min_points: int,
    cauchy_px: tuple[float, ...],
    iterations: int,
    motions: Array,
    covariances: Array,
) -> None:
    """Every pair of first ... last from measured disparities alone, in place; arrays as in `solve_full`.

    cauchy_px: scales, wide to narrow, because nothing is known of the motion yet.
    """
    for i in range(first, last):
        count = 0
        for k in range(start[i], start[i + 1]):
            count += rays[2, k] > 0.0
        if previous[i] < 0 or count < min_points:
            continue
        motion = np.zeros(6)
        information = np.zeros((6, 6))
        solved, variance = True, 0.0
        for width_px in cauchy_px:
            variance = rigid_pair(
                rays, start[i], start[i + 1], motion, focal_px, width_px, iterations, information
            )
            solved = solved and variance >= 0.0
        if solved:
            motions[i, :6] = motion
            motions[i, 6] = 1.0
            covariances[i] = np.linalg.inv(information) * variance
