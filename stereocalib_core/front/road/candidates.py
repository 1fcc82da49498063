"""Candidate planes for the road, weighed: by the road area on them, by what lies below, by nearness to the car's way.

Whatever a plane is, nothing can be seen through it: cells that lie *below* it tell a car's roof, a lawn or a wall
from the road, whose own neighbourhood has nothing beneath. Among planes that pass, the one that the rig stood on a
moment ago is the more likely one.

Everything is in disparity space, where a plane is Delta = A (v - v0) + B (u - u0) + C (eq. 16).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from stereocalib_core.config import LimitsConfig, RegionConfig, SightConfig
from stereocalib_core.front.road.carried import Past, likeness, nearest_of
from stereocalib_core.front.sight import noise_px
from stereocalib_core.geometry import DisparityPlane, StereoCamera
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.small_algebra import solve_square
from stereocalib_core.results import DisparityMap


@dataclass(frozen=True)
class Way:
    """Where the car goes, seen from above: x = slope z + curvature z^2 / 2 [m], positive to the right."""

    slope: float = 0.0
    curvature_per_m: float = 0.0


@dataclass(frozen=True)
class Cells:
    """Cells of the disparity grid about the road, thinned: u, v from the principal point and disparity [px], all (N,).

    x_m, z_m: where they are, x from the car's way. weight: road area that a cell stands for, by nearness to the way.
    """

    u: Array
    v: Array
    d: Array
    x_m: Array
    z_m: Array
    weight: Array


@njit(cache=True, nogil=True)
def _gather(
    values: NDArray[np.float32],
    step: int,
    every: int,
    f: float,
    cx: float,
    cy: float,
    b: float,
    d_min: float,
    slope: float,
    curvature: float,
    side_m: float,
) -> Array:
    rows, columns = values.shape
    out = np.empty((6, (rows // every + 1) * (columns // every + 1)))
    n = 0
    for i in range(every // 2, rows, every):
        for j in range(every // 2, columns, every):
            d = values[i, j]
            if not d > d_min:
                continue
            z = f * b / d
            u = (j + 0.5) * step - 0.5 - cx
            x = u * b / d - slope * z - 0.5 * curvature * z * z
            out[0, n], out[1, n], out[2, n] = u, (i + 0.5) * step - 0.5 - cy, d
            out[3, n], out[4, n] = x, z
            out[5, n] = z * z * z / (1.0 + (x / side_m) ** 2) ** 2
            n += 1
    return out[:, :n].copy()


def gather(
    disparity: DisparityMap, camera: StereoCamera, way: Way, sight: SightConfig, config: RegionConfig
) -> Cells:
    """At most about `candidate_cells` cells, evenly over the picture."""
    values = disparity.values
    every = max(1, int(np.sqrt(values.size / config.candidate_cells)))
    d_min = sight.least_disparity * noise_px(disparity.step_px, sight)
    out = _gather(
        values, disparity.step_px, every, camera.focal_px, camera.cx_px, camera.cy_px, camera.baseline_m,
        d_min, way.slope, way.curvature_per_m, config.way_side_m,
    )  # fmt: skip
    return Cells(*out)


@njit(cache=True, nogil=True)
def _draw(u: Array, v: Array, d: Array, cumulative: Array, count: int) -> Array:
    """(count, 3) planes A, B, C through three cells each, drawn by weight from a fixed sequence."""
    planes = np.full((count, 3), np.nan)
    seed = np.uint64(88172645463325252)
    pick = np.empty(3, np.int64)
    for k in range(count):
        for m in range(3):
            seed ^= seed << np.uint64(13)
            seed ^= seed >> np.uint64(7)
            seed ^= seed << np.uint64(17)
            share = float(seed >> np.uint64(11)) / 9007199254740992.0
            low, high = 0, len(u) - 1
            while low < high:
                middle = (low + high) // 2
                if cumulative[middle] < share * cumulative[-1]:
                    low = middle + 1
                else:
                    high = middle
            pick[m] = low
        i, j, h = pick
        v1, u1, d1 = v[j] - v[i], u[j] - u[i], d[j] - d[i]
        v2, u2, d2 = v[h] - v[i], u[h] - u[i], d[h] - d[i]
        det = v1 * u2 - v2 * u1
        if abs(det) < 100.0:
            continue
        a = (d1 * u2 - d2 * u1) / det
        b = (v1 * d2 - v2 * d1) / det
        planes[k, 0], planes[k, 1], planes[k, 2] = a, b, d[i] - a * v[i] - b * u[i]
    return planes


# Sums may be reordered, so that several cells are taken at once.
@njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def _score(
    u: Array,
    v: Array,
    d: Array,
    z: Array,
    weight: Array,
    planes: Array,
    fb: float,
    b: float,
    bottom_v: float,
    noise: float,
    scale: Array,
) -> Array:
    """(K,) area on each plane near the car, less what lies below it.

    scale: tolerance of height [m] and of the camera's height, [noise], near length in near ends, weight of below, the
    far limits of `sight.reach_of`, and how far below the plane [m] a cell tells against it.
    """
    scores = np.full(len(planes), -np.inf)
    for k in range(len(planes)):
        a, bu, c = planes[k, 0], planes[k, 1], planes[k, 2]
        bottom = a * bottom_v + c
        if not (a > 0.0 and bottom > 0.0):
            continue
        height = b / a
        near = fb / bottom
        far = max(min(fb * scale[5] / noise, scale[7]), scale[6] * near)
        length = scale[3] * near
        height_tolerance = min(scale[0], scale[1] * height) / height
        below_tolerance = min(scale[8], scale[1] * height) / height
        least, first, against, total = scale[2] * noise, 0.8 * near, scale[4], 0.0
        # no branches, so that several cells are weighed at once
        for i in range(len(u)):
            e = d[i] - (a * v[i] + bu * u[i] + c)
            tolerance = height_tolerance * d[i]
            tolerance = tolerance if tolerance > least else least
            below = below_tolerance * d[i]
            below = below if below > tolerance else tolerance
            q = z[i] / length
            w = weight[i] / (1.0 + q * q * q * q)
            # a compromise between road and pavement has many cells near it, the road itself has them on it
            off = e / tolerance
            on = 1.0 - off * off
            worth = on * on if on > 0.0 else 0.0
            worth = worth if e > -below else -against
            total += worth * w if (z[i] <= far) & (z[i] >= first) else 0.0
        # area in the picture becomes area of road: a lower camera sees it flatter
        scores[k] = total / height / (near * near)
    return scores


@njit(cache=True, nogil=True)
def _refined(
    u: Array,
    v: Array,
    d: Array,
    z: Array,
    weight: Array,
    planes: Array,
    fb: float,
    bottom_v: float,
    noise: float,
    scale: Array,
    rounds: int,
) -> Array:
    """(K, 3) planes, each fitted to the cells that lie on it as `_score` weighs them; NaN where there are too few."""
    refined = planes.copy()
    H, r = np.empty((3, 3)), np.empty((3, 1))
    for k in range(len(planes)):
        for _ in range(rounds):
            a, bu, c = refined[k, 0], refined[k, 1], refined[k, 2]
            bottom = a * bottom_v + c
            if not (a > 0.0 and bottom > 0.0):
                refined[k, 0] = refined[k, 1] = refined[k, 2] = np.nan
                break
            near = fb / bottom
            far = max(min(fb * scale[5] / noise, scale[7]), scale[6] * near)
            length, least = scale[3] * near, scale[2] * noise
            # height is baseline over a
            height_tolerance = min(scale[0] * a / scale[9], scale[1])
            H.fill(0.0)
            r.fill(0.0)
            n = 0
            for i in range(len(u)):
                if z[i] > far or z[i] < 0.8 * near:
                    continue
                e = d[i] - (a * v[i] + bu * u[i] + c)
                tolerance = max(height_tolerance * d[i], least)
                if abs(e) >= tolerance:
                    continue
                q = z[i] / length
                on = 1.0 - (e / tolerance) ** 2
                # the score's own slope: the more a cell off the plane costs the nearer its limit
                w = on * weight[i] / ((1.0 + q * q * q * q) * tolerance * tolerance)
                n += 1
                H[0, 0] += w * v[i] * v[i]
                H[0, 1] += w * v[i] * u[i]
                H[0, 2] += w * v[i]
                H[1, 1] += w * u[i] * u[i]
                H[1, 2] += w * u[i]
                H[2, 2] += w
                r[0, 0] += w * e * v[i]
                r[1, 0] += w * e * u[i]
                r[2, 0] += w * e
            H[1, 0], H[2, 0], H[2, 1] = H[0, 1], H[0, 2], H[1, 2]
            if n < 10 or not solve_square(H, r) > 0.0:
                refined[k, 0] = refined[k, 1] = refined[k, 2] = np.nan
                break
            for p in range(3):
                refined[k, p] += r[p, 0]
    return refined


def weigh(
    cells: Cells, planes: Array, camera: StereoCamera, step_px: int, sight: SightConfig, config: RegionConfig
) -> Array:
    """(K,) scores of planes (K, 3) A, B, C; -inf for what is no plane in front of the camera."""
    return _score(
        cells.u, cells.v, cells.d, cells.z_m, cells.weight, planes, camera.focal_px * camera.baseline_m,
        camera.baseline_m, camera.height - 1.0 - camera.cy_px, noise_px(step_px, sight),
        _scale(camera, sight, config),
    )  # fmt: skip


def _scale(camera: StereoCamera, sight: SightConfig, config: RegionConfig) -> Array:
    return np.array(
        [
            config.candidate_tolerance_m, config.tolerance_of_height, config.tolerance_noise, config.near_length,
            config.below_weight, sight.most_noise, sight.least_reach, sight.lane_far_m,
            config.tolerance_m, camera.baseline_m,
        ]
    )  # fmt: skip


def refine(
    cells: Cells, planes: Array, camera: StereoCamera, step_px: int, sight: SightConfig, config: RegionConfig
) -> Array:
    """(K, 3) planes A, B, C moved to where most lies on them; NaN for what is no plane in front of the camera."""
    return _refined(
        cells.u, cells.v, cells.d, cells.z_m, cells.weight, planes, camera.focal_px * camera.baseline_m,
        camera.height - 1.0 - camera.cy_px, noise_px(step_px, sight), _scale(camera, sight, config),
        config.refine_rounds,
    )  # fmt: skip


def angles_of(planes: Array, camera: StereoCamera) -> Array:
    """(K, 3) planes A, B, C to height [m], pitch, roll [rad]: the inverse of eq. 16."""
    a, b, c = planes.T
    pitch = np.arctan2(c, camera.focal_px * a)
    roll = np.arctan2(-b * np.cos(pitch), a)
    return np.column_stack([camera.baseline_m * np.cos(roll) * np.cos(pitch) / a, pitch, roll])


def _allowed(rig: Array, limits: LimitsConfig) -> NDArray[np.bool_]:
    return (
        (rig[:, 0] >= limits.min_height_m)
        & (rig[:, 0] <= limits.max_height_m)
        & (np.abs(rig[:, 1]) <= limits.max_pitch_rad)
        & (np.abs(rig[:, 2]) <= limits.max_roll_rad)
    )


def best_plane(
    cells: Cells,
    camera: StereoCamera,
    step_px: int,
    past: Past,
    limits: LimitsConfig,
    sight: SightConfig,
    config: RegionConfig,
) -> DisparityPlane | None:
    """The candidate with the highest score; None where nothing in front of the camera is a plane within `limits`.

    past: the road of a moment ago, which this one may well be.
    """
    if len(cells.u) < 3:
        return None
    drawn = cells.weight / (1.0 + (cells.z_m / np.quantile(cells.z_m, config.draw_within)) ** 4)
    drawn = np.minimum(drawn, np.quantile(drawn, 0.98))
    count = config.candidates_with_past if past.known else config.candidates
    planes = _draw(cells.u, cells.v, cells.d, np.cumsum(drawn), count)
    known = [road.disparity_plane(camera) for road in past.known]
    planes = np.vstack([*([[p.a, p.b, p.c_px]] for p in known), planes])
    planes, scores = _weighed(planes, cells, camera, step_px, past, limits, sight, config)
    if not len(planes):
        return None
    # Three cells are a rough plane. The best ones are moved to where most lies on them before they are compared.
    first = np.argsort(-scores, kind="stable")[: config.refined]
    refined = refine(cells, np.ascontiguousarray(planes[first]), camera, step_px, sight, config)
    planes, scores = _weighed(
        np.vstack([planes[first], refined]), cells, camera, step_px, past, limits, sight, config
    )
    best = int(np.argmax(scores))
    if not scores[best] > 0:
        return None
    return DisparityPlane(*(float(x) for x in planes[best]))


def _weighed(
    planes: Array,
    cells: Cells,
    camera: StereoCamera,
    step_px: int,
    past: Past,
    limits: LimitsConfig,
    sight: SightConfig,
    config: RegionConfig,
) -> tuple[Array, Array]:
    """Those of planes (K, 3) that are within `limits`, and their scores by likeness (M,)."""
    planes = planes[np.isfinite(planes).all(axis=1) & (planes[:, 0] > 0)]
    rig = angles_of(planes, camera)
    inside = _allowed(rig, limits)
    planes, rig = np.ascontiguousarray(planes[inside]), rig[inside]
    scores = weigh(cells, planes, camera, step_px, sight, config)
    likely = likeness(rig, past, nearest_of(past.carried, camera), config)
    return planes, np.where(scores > 0, scores * likely, scores)
