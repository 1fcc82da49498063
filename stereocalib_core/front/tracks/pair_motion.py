"""The front end's own motion of a pair: from measured disparities, so that no correction setting enters.

It predicts where the next points will be and throws out what does not move with the world: cars, shadows,
mismatches. It is not the odometry; that is the back end's.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.rigid_motion import rigid_pair
from stereocalib_core.numeric.small_algebra import rotation_from_vector


@njit(cache=True, nogil=True)
def reprojection(rays: Array, motion: Array) -> Array:
    """(3, N) x', y' and inverse depth' that a motion (6,) predicts for rays (5, N)."""
    R = rotation_from_vector(motion[:3])
    result = np.empty((3, rays.shape[1]))
    for k in range(rays.shape[1]):
        x, y, w = rays[0, k], rays[1, k], rays[2, k]
        z = R[2, 0] * x + R[2, 1] * y + R[2, 2] + motion[5] * w
        if z < 0.02:
            z = 0.02
        result[0, k] = (R[0, 0] * x + R[0, 1] * y + R[0, 2] + motion[3] * w) / z
        result[1, k] = (R[1, 0] * x + R[1, 1] * y + R[1, 2] + motion[4] * w) / z
        result[2, k] = w / z
    return result


@njit(cache=True, nogil=True)
def _score(rays: Array, votes: Array, motion: Array, tolerance: float) -> float:
    """The votes (N,) of the points that agree, each counted by how well it does."""
    seen = reprojection(rays, motion)
    total = 0.0
    for k in range(rays.shape[1]):
        e2 = (seen[0, k] - rays[3, k]) ** 2 + (seen[1, k] - rays[4, k]) ** 2
        total += votes[k] * max(0.0, 1.0 - e2 / (tolerance * tolerance))
    return total


@njit(cache=True, nogil=True)
def robust_motion(
    rays: Array,
    votes: Array,
    predicted: Array,
    focal_px: float,
    tolerance_px: float,
    samples: int,
    iterations: int,
) -> tuple[Array, float]:
    """(6,) motion that the points (5, N) with the most votes (N,) agree with, and these votes.

    The candidates are the prediction and `samples` triples drawn by a fixed sequence.
    """
    count = rays.shape[1]
    candidates = np.zeros((samples + 1, 6))
    scores = np.zeros(samples + 1)
    tolerance = tolerance_px / focal_px
    # as literals they would be compiled for by themselves
    none: Any = np.int64(0)
    three: Any = np.int64(3)
    for s in range(samples + 1):
        motion = predicted.copy()
        information = np.zeros((6, 6))
        if s == 0:
            rigid_pair(rays, none, count, motion, focal_px, 4.0 * tolerance_px, iterations, information)
        else:
            triple = np.empty((5, 3))
            seed = np.uint64(s * 2654435761 + 12345)
            for k in range(3):
                seed = (seed * np.uint64(6364136223846793005) + np.uint64(1442695040888963407)) & np.uint64(
                    0xFFFFFFFFFFFFFFFF
                )
                pick = np.int64((seed >> np.uint64(33)) % np.uint64(count))
                triple[:, k] = rays[:, pick]
            rigid_pair(triple, none, three, motion, focal_px, 1000.0, iterations, information)
        candidates[s] = motion
        scores[s] = _score(rays, votes, motion, tolerance)
    best = int(np.argmax(scores))
    motion = candidates[best].copy()
    information = np.zeros((6, 6))
    rigid_pair(rays, none, count, motion, focal_px, 0.5 * tolerance_px, iterations, information)
    refined = _score(rays, votes, motion, tolerance)
    if refined >= scores[best]:
        return motion, refined
    return candidates[best], scores[best]
