"""The road a second time: a plane through the tracked road points of a frame, in disparity space.

Tracks are aligned from left to right to a fraction of a pixel, so that a hundred of them in the own lane show
height, pitch and roll better than dense matching does, whose line and slope also take in how the road is
cambered beside the lane. Where a pair's own estimate is clearly the less sure one, the filter leans on these.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit

from stereocalib_core.config import LaneConfig, RoadPointsConfig
from stereocalib_core.geometry import StereoCamera
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.robust import SIGMA_PER_MAD
from stereocalib_core.results import FrameResult


@njit(cache=True, nogil=True)
def fit_plane(
    rays: Array, noise: Array, rounds: int, soft_rounds: int, least_scale: float
) -> tuple[Array, Array]:
    """(3,) coefficients of disparity = a y + b x + c [px] and their (3, 3) covariance.

    rays: (3, M) x = (u - cx) / f, y = (v - cy) / f, disparity [px]. noise: (M,) standard deviation of each
    disparity. Weights fall off gently for the first `soft_rounds` of `rounds`, so that the first plane may be a
    poor one, and then to nothing: a kerb beside a bend is a fifth of the points.
    """
    m = rays.shape[1]
    weight, residual = 1.0 / noise**2, np.empty(m)
    normal, solution, scale = np.zeros((3, 3)), np.zeros(3), 1.0
    for k in range(rounds):
        normal[:], right = 0.0, np.zeros(3)
        for i in range(m):
            row = (rays[1, i], rays[0, i], 1.0)
            for p in range(3):
                right[p] += weight[i] * row[p] * rays[2, i]
                for q in range(3):
                    normal[p, q] += weight[i] * row[p] * row[q]
        if abs(np.linalg.det(normal)) < 1e-9:
            return np.full(3, np.nan), np.full((3, 3), np.nan)
        solution[:] = np.linalg.solve(normal, right)
        for i in range(m):
            plane = solution[0] * rays[1, i] + solution[1] * rays[0, i] + solution[2]
            residual[i] = (rays[2, i] - plane) / noise[i]
        scale = max(SIGMA_PER_MAD * np.median(np.abs(residual)), least_scale)
        power = 1 if k < soft_rounds else 3
        for i in range(m):
            weight[i] = 1.0 / (noise[i] ** 2 * (1.0 + (residual[i] / (2.0 * scale)) ** 2) ** power)
    covariance = np.empty((3, 3))
    covariance[:] = np.linalg.inv(normal) * scale**2
    return solution, covariance


def road_planes(
    camera: StereoCamera, results: Sequence[FrameResult], config: RoadPointsConfig, lane: LaneConfig
) -> tuple[Array, Array]:
    """(N, 3) height [m], pitch, roll [rad] by the road points of each frame and (N, 3, 3); NaN where there are few."""
    values, covariance = np.full((len(results), 3), np.nan), np.full((len(results), 3, 3), np.nan)
    for i, r in enumerate(results):
        if r.tracks is not None:
            # of the frame itself: the points that the next frame finds again are not known yet
            points = r.tracks.points[r.tracks.on_road].astype(np.float64)[:, 3:]
            values[i], covariance[i] = _plane(camera, points, config, lane)
    return values, covariance


def _plane(
    camera: StereoCamera, points: Array, config: RoadPointsConfig, lane: LaneConfig
) -> tuple[Array, Array]:
    """The plane through (M, 3) u, v, disparity of road points within the lane."""
    f, b = camera.focal_px, camera.baseline_m
    points = points[np.isfinite(points).all(axis=1) & (points[:, 2] > f * b / lane.far_m)]
    x, y, d = (points[:, 0] - camera.cx_px) / f, (points[:, 1] - camera.cy_px) / f, points[:, 2]
    inside = (np.abs(x) * f * b < config.half_width_m * d) & (d < f * b / lane.near_m)
    nothing = np.full(3, np.nan), np.full((3, 3), np.nan)
    if inside.sum() < config.min_points:
        return nothing
    rays = np.ascontiguousarray(np.stack([x, y, d])[:, inside])
    # disparity grows with the height of the camera: d / h is how much a bump of one metre takes away
    noise = np.hypot(config.noise_px, config.unevenness_m / config.road_height_m * rays[2])
    (a, c_x, c), covariance = fit_plane(rays, noise, config.rounds, config.soft_rounds, config.least_scale)
    if not a > 0.0:
        return nothing
    pitch = np.arctan2(c, a)
    roll = np.arctan(-c_x * np.cos(pitch) / a)
    height = f * b * np.cos(roll) * np.cos(pitch) / a
    reach = a * a + c * c
    jacobian = np.array([[-height / a, 0.0, 0.0], [-c / reach, 0.0, a / reach], [c_x / a**2, -1.0 / a, 0.0]])
    return np.array([height, pitch, roll]), config.alike * jacobian @ covariance @ jacobian.T


def lean_on(
    values: Array, covariance: Array, other: Array, other_covariance: Array, config: RoadPointsConfig
) -> tuple[Array, Array]:
    """(N, 3) and (N, 3, 3) after the surer look has had its say, axis by axis.

    Two looks at one uneven road are wrong alike in part (`correlation`). `other` counts only where it would
    have at least `min_share`; where it then contradicts by more than `gate` sigmas, neither is believed: the
    value stays and its variance grows by the square of the difference.
    """
    p, c = (np.diagonal(m, axis1=1, axis2=2) for m in (covariance, other_covariance))
    common = config.correlation * np.sqrt(p * c)
    share = np.clip((p - common) / (p + c - 2.0 * common), 0.0, 1.0)
    difference = other - values
    used = np.isfinite(difference) & (share >= config.min_share)
    apart = used & (difference**2 > config.gate**2 * (p + c))
    k = np.where(used & ~apart, share, 0.0)
    fused = values + np.where(used, k * difference, 0.0)
    keep = (1.0 - k)[:, :, None] * (1.0 - k)[:, None, :] * covariance
    taken = k[:, :, None] * k[:, None, :] * np.where(np.isfinite(other_covariance), other_covariance, 0.0)
    extra = np.where(used, 2.0 * k * (1.0 - k) * common, 0.0) + np.where(apart, difference**2, 0.0)
    return fused, keep + taken + extra[:, :, None] * np.eye(3)
