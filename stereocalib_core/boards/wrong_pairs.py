"""Pairs that do not belong together, found by asking each what the others say of it."""

from __future__ import annotations

import numpy as np

from stereocalib_core.boards.rotations import apply_twist
from stereocalib_core.boards.solve import (
    PlanePairs,
    covariance_of,
    in_plane_offset,
    mismatch,
    mismatch_covariance,
    pseudo_inverse,
    weighted,
    weights_of,
)
from stereocalib_core.config.boards import WRONG_PAIR
from stereocalib_core.numeric.arrays import Array


def leave_one_out(pairs: PlanePairs, T_camera_lidar: Array) -> tuple[Array, Array]:
    """The solution without each pair: (M, 4, 4) transforms and (M, 6, 6) covariances of their left twist.

    One Gauss-Newton step from the common solution, which is exact to second order in a pair's influence.
    """
    W = weights_of(mismatch_covariance(pairs, T_camera_lidar))
    z, J = mismatch(pairs, T_camera_lidar)
    JW = np.swapaxes(J, 1, 2) @ W
    H_each = JW @ J
    g_each = np.einsum("mka,ma->mk", JW, z)
    H_rest = H_each.sum(axis=0) - H_each
    g_rest = g_each.sum(axis=0) - g_each
    covariance = np.array([covariance_of(H) for H in H_rest])
    steps = -np.array([pseudo_inverse(H) @ g for H, g in zip(H_rest, g_rest, strict=True)])
    return apply_twist(steps, T_camera_lidar[None]), covariance


def wrong_pairs(pairs: PlanePairs, T_camera_lidar: Array, short_side_m: float) -> dict[int, str]:
    """Index and reason of every pair that the others contradict; the worst goes first, then all are asked again."""
    wrong: dict[int, str] = {}
    T = T_camera_lidar
    while True:
        index = np.array([i for i in range(len(pairs)) if i not in wrong])
        if len(index) < WRONG_PAIR.least_to_judge:
            return wrong
        rest = pairs.select(index)
        T, _ = weighted(rest, T)
        others, covariance = leave_one_out(rest, T)
        z, J = mismatch(rest, others)
        expected = mismatch_covariance(rest, T) + J @ covariance @ np.swapaxes(J, 1, 2)
        surprise = np.sqrt(np.einsum("ma,mab,mb->m", z, weights_of(expected), z) / 3.0)
        surprise = surprise / max(float(np.median(surprise)) / WRONG_PAIR.median_surprise, 1.0)
        angle, offset = np.linalg.norm(z[:, :2], axis=1), np.abs(z[:, 2])
        aside = in_plane_offset(rest, T)
        bad = (surprise > WRONG_PAIR.outlier) & (
            (angle > WRONG_PAIR.harmless_rad) | (offset > WRONG_PAIR.harmless_m)
        )
        bad |= aside > WRONG_PAIR.farthest_aside * short_side_m
        if not bad.any():
            return wrong
        rank = np.where(bad, surprise + WRONG_PAIR.aside_weight * aside / short_side_m, -1.0)
        worst = int(np.argmax(rank))
        wrong[int(index[worst])] = (
            f"wrong pair: the other pairs put its board {100 * offset[worst]:.1f} cm and "
            f"{np.rad2deg(angle[worst]):.1f} deg elsewhere, {100 * aside[worst]:.0f} cm to the side"
        )
