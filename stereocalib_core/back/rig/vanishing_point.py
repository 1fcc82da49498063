"""The vanishing point of one pair of frames: road tracks, turned back, meet where the camera travels.

Eq. 2, 1: each track is a line; lines of points at rest meet in one point while the camera only translates.
Small rotations between the frames bend them, so the tracks are turned back first.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from stereocalib_core.config import YawConfig
from stereocalib_core.geometry import StereoCamera
from stereocalib_core.numeric.arrays import Array


@dataclass(frozen=True)
class VanishingPointView:
    """Figure 1c of the paper for one pair, all in pixels of the previous left image.

    tracks: (M, 4) u, v of the previous point and of the current one turned back. inlier: (M,) bool.
    intersections: (K, 2) where pairs of inlier lines meet. vanishing_point: (2,), NaN where there is none.
    """

    tracks: Array
    inlier: NDArray[np.bool_]
    intersections: Array
    vanishing_point: Array


@njit(cache=True, nogil=True)
def derotate(rays: Array, rotation: Array) -> Array:
    """(4, M) previous x, y and current x, y turned back by `rotation` (3, 3) = R_current_previous.

    rays: (5, M) of `PackedTracks`.
    """
    result = np.empty((4, rays.shape[1]))
    R = rotation
    for k in range(rays.shape[1]):
        x, y = rays[3, k], rays[4, k]
        z = R[0, 2] * x + R[1, 2] * y + R[2, 2]
        result[0, k], result[1, k] = rays[0, k], rays[1, k]
        result[2, k] = (R[0, 0] * x + R[1, 0] * y + R[2, 0]) / z
        result[3, k] = (R[0, 1] * x + R[1, 1] * y + R[2, 1]) / z
    return result


@njit(cache=True, nogil=True)
def _miss(tracks: Array, k: int, ex: float, ey: float) -> float:
    """How far the current end lies beside the line from the previous one through (ex, ey)."""
    nx, ny = ex - tracks[0, k], ey - tracks[1, k]
    length = np.sqrt(nx * nx + ny * ny) + 1e-9
    return ((tracks[2, k] - tracks[0, k]) * ny - (tracks[3, k] - tracks[1, k]) * nx) / length


@njit(cache=True, nogil=True)
def _meet(tracks: Array, i: int, j: int) -> tuple[float, float, bool]:
    """Where the lines of two tracks intersect, and whether they do."""
    ax, ay = tracks[2, i] - tracks[0, i], tracks[3, i] - tracks[1, i]
    bx, by = tracks[2, j] - tracks[0, j], tracks[3, j] - tracks[1, j]
    cross = ax * by - ay * bx
    if abs(cross) < 1e-12:
        return 0.0, 0.0, False
    s = ((tracks[0, j] - tracks[0, i]) * by - (tracks[1, j] - tracks[1, i]) * bx) / cross
    return tracks[0, i] + s * ax, tracks[1, i] + s * ay, True


@njit(cache=True, nogil=True)
def find_vanishing_point(
    tracks: Array, tolerance: float, least_flow: float, samples: int, seed: int
) -> Array:
    """(4,) x, y of the point, inliers, and the variance of a miss; by RANSAC over intersections.

    tracks: (4, M) as from `derotate`. Then Gauss-Newton with Tukey weights on the misses.
    """
    result = np.full(4, np.nan)
    result[2] = 0.0
    usable = np.empty(tracks.shape[1], np.int64)
    count = 0
    for k in range(tracks.shape[1]):
        if (tracks[2, k] - tracks[0, k]) ** 2 + (tracks[3, k] - tracks[1, k]) ** 2 > least_flow**2:
            usable[count] = k
            count += 1
    if count < 8:
        return result
    state = np.uint64(seed * 2654435761 + 97)
    best, bx, by = -1.0, 0.0, 0.0
    for _ in range(samples):
        state = state * np.uint64(6364136223846793005) + np.uint64(1442695040888963407)
        i = usable[np.int64((state >> np.uint64(33)) % np.uint64(count))]
        state = state * np.uint64(6364136223846793005) + np.uint64(1442695040888963407)
        j = usable[np.int64((state >> np.uint64(33)) % np.uint64(count))]
        ex, ey, met = _meet(tracks, i, j)
        if not met or abs(ex) > 1.0 or abs(ey) > 1.0:
            continue
        score = 0.0
        for k in range(count):
            score += max(0.0, 1.0 - (_miss(tracks, usable[k], ex, ey) / tolerance) ** 2)
        if score > best:
            best, bx, by = score, ex, ey
    if best < 6.0:
        return result
    total, cost, inliers = 1.0, 0.0, 0
    for _ in range(10):
        a, b, c, g, h, total, cost, inliers = 1e-12, 0.0, 1e-12, 0.0, 0.0, 0.0, 0.0, 0
        for m in range(count):
            k = usable[m]
            dx, dy = tracks[2, k] - tracks[0, k], tracks[3, k] - tracks[1, k]
            nx, ny = bx - tracks[0, k], by - tracks[1, k]
            length = np.sqrt(nx * nx + ny * ny) + 1e-9
            nx, ny = nx / length, ny / length
            miss = dx * ny - dy * nx
            along = (dx * nx + dy * ny) / length
            jx, jy = ny * along, -nx * along
            w = max(0.0, 1.0 - (miss / (1.5 * tolerance)) ** 2) ** 2
            a, b, c = a + w * jx * jx, b + w * jx * jy, c + w * jy * jy
            g, h = g + w * jx * miss, h + w * jy * miss
            total, cost = total + w, cost + w * miss * miss
            inliers += abs(miss) < tolerance
        det = a * c - b * b
        # miss falls along (-jx, -jy) for a point that moves by (jx, jy) across the line
        sx, sy = (c * g - b * h) / det, (a * h - b * g) / det
        bx, by = bx + sx, by + sy
        if abs(sx) + abs(sy) < 1e-8:
            break
    result[0], result[1], result[2], result[3] = bx, by, inliers, cost / max(total, 1.0)
    return result


@njit(cache=True, nogil=True)
def vanishing_points(
    first: int,
    last: int,
    rays: Array,
    start: NDArray[np.int64],
    end: NDArray[np.int64],
    rotations: Array,
    active: NDArray[np.bool_],
    tolerance: float,
    least_flow: float,
    samples: int,
    result: Array,
) -> None:
    """Fill rows first ... last of result (N, 4) by `find_vanishing_point` for every active pair.

    rotations: (N, 3, 3) R_current_previous.
    """
    for i in range(first, last):
        if active[i]:
            tracks = derotate(np.ascontiguousarray(rays[:, start[i] : end[i]]), rotations[i])
            result[i] = find_vanishing_point(tracks, tolerance, least_flow, samples, i)


def view_pair(camera: StereoCamera, rays: Array, rotation: Array, config: YawConfig) -> VanishingPointView:
    """Lines, intersections and vanishing point of one pair, for display; `rays` (5, M) of its road tracks."""
    f, tolerance, flow = camera.focal_px, config.tolerance_px, config.min_flow_px
    tracks = derotate(np.ascontiguousarray(rays), rotation)
    found = find_vanishing_point(tracks, tolerance / f, flow / f, config.samples, 0)
    centre = np.array([camera.cx_px, camera.cy_px])
    point = centre + f * found[:2]
    pixels = (tracks.reshape(2, 2, -1) * f + centre[None, :, None]).reshape(4, -1).T
    inlier = np.zeros(tracks.shape[1], dtype=bool)
    crossings = []
    if np.isfinite(point).all():
        misses = np.array([_miss(tracks, k, found[0], found[1]) for k in range(tracks.shape[1])])
        moved = np.hypot(tracks[2] - tracks[0], tracks[3] - tracks[1]) > flow / f
        inlier = (np.abs(misses) < tolerance / f) & moved
        chosen = np.flatnonzero(inlier)[:: max(1, int(inlier.sum()) // 40)]
        for n, i in enumerate(chosen):
            for j in chosen[n + 1 :]:
                x, y, met = _meet(tracks, int(i), int(j))
                if met:
                    crossings.append(centre + f * np.array([x, y]))
    return VanishingPointView(pixels, inlier, np.array(crossings).reshape(-1, 2), point)
