"""The road a second time: a plane through the tracked road points of a frame, in disparity space.

Tracks are aligned from left to right to a fraction of a pixel, so that a hundred of them in the own lane show
height, pitch and roll better than dense matching does, whose line and slope also take in how the road is
cambered beside the lane. Camber, twist and bend along the lane are fitted beside the plane, as for the direct
alignment, and what bends further makes the plane unsure: where a turn begins, the lane ahead is no plane, and without
that the points are ten times surer than right. The filter takes a pair's own estimate and these by their covariances.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit

from stereocalib_core.back.odometry.packing import PackedTracks
from stereocalib_core.config import DirectConfig, FilterConfig, RoadPointsConfig
from stereocalib_core.geometry import StereoCamera
from stereocalib_core.numeric import bent_square
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.evidence import average_over_sizes
from stereocalib_core.numeric.robust import SIGMA_PER_MAD
from stereocalib_core.results import FrameResult


class Look(NamedTuple):
    """values: (3,) height [m], pitch, roll [rad]; covariance: (3, 3)."""

    values: Array
    covariance: Array


@njit(cache=True, nogil=True)
def fit_surface(
    rays: Array,
    noise: Array,
    shapes: Array,
    further: Array,
    sizes: Array,
    reluctance: float,
    base_m: float,
    per_twist: float,
    per_along: float,
    rounds: int,
    soft_rounds: int,
    least_scale: float,
) -> tuple[Array, Array]:
    """(3,) coefficients of disparity = a y + b x + c [px] of the plane under a bent road, and their (3, 3) covariance.

    rays: (3, M) x = (u - cx) / f, y = (v - cy) / f, disparity [px]. noise: (M,) standard deviation of each
    disparity. shapes: (M, 3) camber, twist and bend along of one metre, further: (M, 4) the bends that are not
    fitted [px]. sizes: of the first, averaged by their evidence; of the others `base_m`, and more with the twist and
    the bend along that are found.
    Weights fall off gently for the first `soft_rounds` of `rounds`, so that the first plane may be a poor one, and
    then to nothing: a kerb beside a bend is a fifth of the points.
    """
    m = rays.shape[1]
    J = np.empty((m, 6))
    J[:, 0], J[:, 1], J[:, 2], J[:, 3:] = rays[1], rays[0], 1.0, shapes
    weight, scale = 1.0 / noise**2, 1.0
    normal, right, solution = np.zeros((6, 6)), np.zeros(6), np.zeros(6)
    for k in range(rounds):
        weighted = J * weight.reshape(m, 1)
        normal[:], right[:] = weighted.T @ J, weighted.T @ rays[2]
        held, size = normal.copy(), sizes[0] if k < soft_rounds else sizes[-2]
        for bend in range(3, 6):
            held[bend, bend] += size**-2.0
        if abs(np.linalg.det(held)) < 1e-9:
            return np.full(3, np.nan), np.full((3, 3), np.nan)
        solution[:] = np.linalg.solve(held, right)
        residual = (rays[2] - J @ solution) / noise
        scale = max(SIGMA_PER_MAD * np.median(np.abs(residual)), least_scale)
        power = 1 if k < soft_rounds else 3
        weight = 1.0 / (noise**2 * (1.0 + (residual / (2.0 * scale)) ** 2) ** power)
    solution, covariance, average = average_over_sizes(
        normal / scale**2, right / scale**2, 3, sizes, reluctance, np.ones(3), np.zeros(3)
    )
    further_m = np.array([base_m, per_twist * solution[4], per_along * solution[5]])
    response = average @ (weighted.T / scale**2 @ further) * np.sqrt(np.sum(further_m**2))
    covariance = covariance + response @ response.T
    return solution[:3].copy(), covariance[:3, :3].copy()


def road_planes(
    results: Sequence[FrameResult], tracks: PackedTracks, config: RoadPointsConfig, surface: DirectConfig
) -> tuple[Array, Array]:
    """(N, 3) height [m], pitch, roll [rad] by the road points of each frame and (N, 3, 3); NaN where there are few.

    tracks: of the same frames. surface: how a road differs from its plane, the same as for the direct alignment.
    """
    values, covariance = np.full((len(results), 3), np.nan), np.full((len(results), 3, 3), np.nan)
    curvature = curvatures(tracks)
    for i, r in enumerate(results):
        if r.tracks is not None and r.road is not None:
            # of the frame itself: the points that the next frame finds again are not known yet
            points = r.tracks.points[r.tracks.on_road].astype(np.float64)[:, 3:]
            seen_from = r.road.extrinsics.height_m, float(curvature[i])
            values[i], covariance[i] = _plane(tracks.camera, points, *seen_from, config, surface)
    return values, covariance


def curvatures(tracks: PackedTracks) -> Array:
    """(N,) of the car's way into each frame [1/m], positive to the right; zero where it stands or nothing is known."""
    motion = tracks.stereo_motion
    travel_m = np.linalg.norm(motion[:, 3:6], axis=1)
    moving = (motion[:, 6] > 0) & ~tracks.still
    # of T_current_previous: the camera turns the other way than what it sees
    return np.where(moving, -motion[:, 1] / np.where(moving, travel_m, 1.0), 0.0)


def _plane(
    camera: StereoCamera,
    points: Array,
    height_m: float,
    curvature_per_m: float,
    config: RoadPointsConfig,
    surface: DirectConfig,
) -> tuple[Array, Array]:
    """The plane through (M, 3) u, v, disparity of road points within the lane, seen from about `height_m`."""
    f, b = camera.focal_px, camera.baseline_m
    points = points[np.isfinite(points).all(axis=1) & (points[:, 2] > f * b / surface.far_m)]
    x, y, d = (points[:, 0] - camera.cx_px) / f, (points[:, 1] - camera.cy_px) / f, points[:, 2]
    inside = (np.abs(x) * f * b < surface.fit_half_width_m * d) & (d < f * b / surface.near_m)
    nothing = np.full(3, np.nan), np.full((3, 3), np.nan)
    if inside.sum() < config.min_points:
        return nothing
    rays = np.ascontiguousarray(np.stack([x, y, d])[:, inside])
    # disparity grows with the height of the camera: d / h is how much a bump of one metre takes away
    px_per_m = rays[2] / height_m
    noise = np.hypot(config.noise_px, config.unevenness_m * px_per_m)
    z = f * b / rays[2]
    across = rays[0] * z / surface.lane_half_width_m
    along = (2.0 * z - surface.far_m - surface.near_m) / (surface.far_m - surface.near_m)
    # in a turn the road straight ahead is another's: of the lane along the car's way less is seen
    about_way = across - 0.5 * curvature_per_m * z**2 / surface.lane_half_width_m
    unseen_m = config.unseen_bend_m * bent_square.unseen_share(about_way, along) ** 2
    (a, c_x, c), covariance = fit_surface(
        rays,
        noise,
        bent_square.bends(across, along) * px_per_m[:, None],
        bent_square.further_bends(across, along) * px_per_m[:, None],
        np.geomspace(max(surface.min_bend_m, unseen_m), surface.max_bend_m, surface.bend_sizes),
        surface.bend_reluctance,
        float(np.hypot(surface.further_bend_m, unseen_m)),
        surface.further_per_twist,
        config.further_per_along,
        config.rounds,
        config.soft_rounds,
        config.least_scale,
    )
    if not a > 0.0:
        return nothing
    pitch = np.arctan2(c, a)
    roll = np.arctan(-c_x * np.cos(pitch) / a)
    height = f * b * np.cos(roll) * np.cos(pitch) / a
    reach = a * a + c * c
    jacobian = np.array([[-height / a, 0.0, 0.0], [-c / reach, 0.0, a / reach], [c_x / a**2, -1.0 / a, 0.0]])
    return np.array([height, pitch, roll]), jacobian @ covariance @ jacobian.T


def lean_on(look: Look, other: Look, expected: Look | None, slack: Array, config: FilterConfig) -> Look:
    """One look at the road after another look of the same frame has had its say.

    Two looks at one uneven road are wrong alike in part (`correlation`); axis by axis, the surer counts more. Where
    they contradict by more than `gate` sigmas, one of them has something else for the road, a kerb or the slope of a
    hump: each counts as likely as it is by what was expected of the frame, and how far they are apart goes into the
    covariance. Without an expectation the first look stays, as unsure as that.

    expected: of the filter, before this frame; slack: (3, 3) what a body may do besides, in a hump.
    """
    (values, covariance), (others, other_covariance) = look, other
    if not np.isfinite(others).all():
        return look
    gate, correlation = config.road_points.gate, config.road_points.correlation
    p, c, difference = np.diag(covariance), np.diag(other_covariance), others - values
    if (difference**2 > gate**2 * (p + c)).any():
        apart = np.outer(difference, difference)
        if expected is None:
            return Look(values, covariance + np.diag(np.diag(apart)))
        k = _likelier(look, other, expected, slack, config.hump_share)
        mean = (1.0 - k) * covariance + k * other_covariance
        return Look(values + k * difference, mean + k * (1.0 - k) * apart)
    common = correlation * np.sqrt(p * c)
    share = np.clip((p - common) / (p + c - 2.0 * common), 0.0, 1.0)
    rest = np.outer(1.0 - share, 1.0 - share) * covariance + np.outer(share, share) * other_covariance
    return Look(values + share * difference, rest + np.diag(2.0 * share * (1.0 - share) * common))


def _likelier(look: Look, other: Look, expected: Look, slack: Array, hump_share: float) -> float:
    """Probability that the other look is right and not the first, if one of them is."""
    density = [0.0, 0.0]
    for free, prior in ((np.zeros((3, 3)), 1.0 - hump_share), (slack, hump_share)):
        for i, (values, covariance) in enumerate((look, other)):
            S, off = expected.covariance + covariance + free, values - expected.values
            density[i] += prior * float(
                np.exp(-0.5 * off @ np.linalg.solve(S, off)) / np.sqrt(np.linalg.det(S))
            )
    return density[1] / max(sum(density), 1e-300)
