"""Where the road bends up or down ahead: how far its surface leaves the plane that was found nearer by.

A pair's values are those of one plane. Over a ramp or a crest the lane is none, and the plane found on its nearer
part differs from the one that fits the whole lane by degrees, however well the nearer part is known. That
difference belongs into the uncertainty. It is counted only where the surface is surely road: left and right half
of the lane rise or fall together, steadily from where they were on the plane, and by more than a kerb. A car, a wall
or the pavement beyond a curve rise on one side first, or at once.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from stereocalib_core.config import LaneConfig
from stereocalib_core.geometry import Extrinsics, StereoCamera
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.results import DisparityMap

_BIN_M = 1.0
_SHARPEST_PER_M = 1.0 / 120.0
"""Curvature beyond which the car leaves its straight lane within it, and turns on: no lane is known ahead."""
_LEVELS, _LEVEL_M = 300, 0.01
"""Heights over the plane are counted in so many steps about zero."""
_LEAST_CELLS = 6
_SPREAD_M = 0.16
"""Between a fifth and four fifths of the cells of one bin: more is no surface."""
_ALIKE_M, _ALIKE_SHARE = 0.05, 0.1
"""Left and right may differ by this, and by this share of their height."""
_ON_PLANE_M = 0.08
_STEEPEST = 0.25
_LONGEST_GAP = 3
"""Rise per metre that is still a road, and bins between two that are sure."""
_HIGH_M, _RISING_M, _RISING_BINS = 0.2, 0.1, 2
"""A rise ends above the first, higher than any kerb, with so many bins above the second."""
_LOW_M = 0.07
"""Nothing but a road lies so far below the plane."""
_KERB_M = 0.09
"""Higher than a hump in the road, lower than a kerb."""
_HUMP_M, _HUMP_BINS = 0.025, 2
"""So many neighbouring bins so far off the plane are a hump or a dip: the matcher's own waves are half as high."""


@njit(cache=True, nogil=True)
def _count(
    values: NDArray[np.float32],
    free: NDArray[np.bool_],
    step: int,
    fb: float,
    cx: float,
    cy: float,
    b: float,
    plane: Array,
    camera_height: float,
    near: float,
    half_lane: float,
    curvature: float,
    counts: NDArray[np.int64],
) -> None:
    """Cells by distance, half of the lane and height over the plane, added to `counts` (bins, 2, levels)."""
    rows, columns = values.shape
    bins, levels = counts.shape[0], counts.shape[2]
    d_far, d_near = fb / (near + bins * _BIN_M), fb / near
    for i in range(rows):
        at_row = plane[0] * ((i + 0.5) * step - 0.5 - cy) + plane[2]
        for j in range(columns):
            d = values[i, j]
            if not (d > d_far and d < d_near) or not free[i, j]:
                continue
            u, z = (j + 0.5) * step - 0.5 - cx, fb / d
            x = u * b / d - 0.5 * curvature * z * z
            if abs(x) > half_lane:
                continue
            over = camera_height * (d - at_row - plane[1] * u) / d
            level = min(max(int(over / _LEVEL_M + 0.5 * levels), 0), levels - 1)
            counts[min(int((z - near) / _BIN_M), bins - 1), 1 if x > 0.0 else 0, level] += 1


@njit(cache=True, nogil=True)
def _quantile(counts: NDArray[np.int64], share: float) -> float:
    """The height [m] below which `share` of the cells lie; counts: (levels,)."""
    levels, total, seen = len(counts), counts.sum(), 0
    for level in range(levels):
        seen += counts[level]
        if seen > share * total:
            return (level + 0.5 - 0.5 * levels) * _LEVEL_M
    return np.nan


@njit(cache=True, nogil=True)
def _surface(counts: NDArray[np.int64]) -> Array:
    """(bins,) height of the surface over the plane [m], NaN where nothing is surely one."""
    bins = len(counts)
    surface = np.full(bins, np.nan)
    for k in range(bins):
        half = np.full(2, np.nan)
        blocked = False
        for side in range(2):
            cells = counts[k, side]
            if cells.sum() < _LEAST_CELLS:
                continue
            half[side] = _quantile(cells, 0.5)
            if half[side] > -_LOW_M and _quantile(cells, 0.8) - _quantile(cells, 0.2) > _SPREAD_M:
                blocked = True
        if blocked:
            continue
        if np.isfinite(half[0]) and np.isfinite(half[1]):
            mean = 0.5 * (half[0] + half[1])
            alike = abs(half[0] - half[1]) <= _ALIKE_M + _ALIKE_SHARE * abs(mean)
            if alike or max(half[0], half[1]) < -_ALIKE_M:
                surface[k] = mean
        elif half[0] < -_LOW_M:
            surface[k] = half[0]
        elif half[1] < -_LOW_M:
            surface[k] = half[1]
    return surface


def _walk(surface: Array) -> list[int]:
    """The bins of one unbroken surface that begins on the plane."""
    path: list[int] = []
    for k in np.flatnonzero(np.isfinite(surface)):
        if not path:
            if abs(surface[k]) < _ON_PLANE_M:
                path.append(int(k))
        elif k - path[-1] > _LONGEST_GAP:
            break
        elif abs(surface[k] - surface[path[-1]]) <= _STEEPEST * _BIN_M * (k - path[-1]):
            path.append(int(k))
    return path


def _below_kerb(path: list[int], surface: Array) -> list[int]:
    """The path as far as it is no higher than a hump: what is higher and yet no ramp is a pavement."""
    ends = [n for n, k in enumerate(path) if surface[k] > _KERB_M]
    return path[: ends[0]] if ends else path


def _uneven(path: list[int], surface: Array) -> bool:
    """Whether the path has a hump or a dip, which the plane leaves out and the lane as a whole does not."""
    if not path:
        return False
    off = np.zeros(len(surface))
    off[path] = surface[path] - np.median(surface[path])
    for sign in (1.0, -1.0):
        high = sign * off >= _HUMP_M
        if any(high[k : k + _HUMP_BINS].all() for k in range(len(high) - _HUMP_BINS + 1)):
            return True
    return False


def bend_ahead(
    disparity: DisparityMap,
    free: NDArray[np.bool_],
    camera: StereoCamera,
    extrinsics: Extrinsics,
    config: LaneConfig,
    curvature_per_m: float = 0.0,
) -> tuple[float, float]:
    """By how much height [m] and pitch [rad] over the whole lane differ from `extrinsics`; zeros without a bend.

    The lane's plane is the least-squares one, uniform over its length; where a bend leads out of sight it is
    taken to go on as it was. curvature_per_m: of the car's way, positive to the right; in a sharp turn what lies
    ahead is not where the car goes.
    """
    if abs(curvature_per_m) > _SHARPEST_PER_M:
        return 0.0, 0.0
    plane = extrinsics.disparity_plane(camera)
    bins = round((config.far_m - config.near_m) / _BIN_M)
    counts = np.zeros((bins, 2, _LEVELS), np.int64)
    _count(
        disparity.values, free, disparity.step_px, camera.focal_px * camera.baseline_m, camera.cx_px, camera.cy_px,
        camera.baseline_m, np.array([plane.a, plane.b, plane.c_px]), extrinsics.height_m, config.near_m,
        config.half_width_m, curvature_per_m, counts,
    )  # fmt: skip
    surface = _surface(counts)
    path = _walk(surface)
    height = surface[path]
    up = len(path) > 2 and height.max() > _HIGH_M and np.count_nonzero(height > _RISING_M) >= _RISING_BINS
    down = len(path) > 2 and height.min() < -_LOW_M
    at = np.arange(bins)
    if up or down:
        whole = np.interp(at, path, height, left=0.0)
        last, before = path[-1], path[-2]
        slope = (surface[last] - surface[before]) / (last - before)
        whole[last:] = surface[last] + slope * (at[last:] - last)
    elif _uneven(path := _below_kerb(path, surface), surface):
        whole = np.interp(at, path, surface[path], left=0.0, right=0.0)
    else:
        return 0.0, 0.0
    z = config.near_m + (at + 0.5) * _BIN_M
    rise, offset = np.polyfit(z, whole, 1)
    return -float(offset), float(np.arctan(rise))
