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

from stereocalib_core.config import BendConfig, LaneConfig
from stereocalib_core.geometry import Extrinsics, StereoCamera
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.results import DisparityMap


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
    bin_m: float,
    level_m: float,
    counts: NDArray[np.int64],
) -> None:
    """Cells by distance, half of the lane and height over the plane, added to `counts` (bins, 2, levels)."""
    rows, columns = values.shape
    bins, levels = counts.shape[0], counts.shape[2]
    d_far, d_near = fb / (near + bins * bin_m), fb / near
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
            level = min(max(int(over / level_m + 0.5 * levels), 0), levels - 1)
            counts[min(int((z - near) / bin_m), bins - 1), 1 if x > 0.0 else 0, level] += 1


@njit(cache=True, nogil=True)
def _quantile(counts: NDArray[np.int64], share: float, level_m: float) -> float:
    """The height [m] below which `share` of the cells lie; counts: (levels,)."""
    levels, total, seen = len(counts), counts.sum(), 0
    for level in range(levels):
        seen += counts[level]
        if seen > share * total:
            return (level + 0.5 - 0.5 * levels) * level_m
    return np.nan


@njit(cache=True, nogil=True)
def _surface(
    counts: NDArray[np.int64],
    level_m: float,
    least_cells: int,
    spread_m: float,
    alike_m: float,
    alike_share: float,
    low_m: float,
) -> Array:
    """(bins,) height of the surface over the plane [m], NaN where nothing is surely one."""
    bins = len(counts)
    surface = np.full(bins, np.nan)
    for k in range(bins):
        half = np.full(2, np.nan)
        blocked = False
        for side in range(2):
            cells = counts[k, side]
            if cells.sum() < least_cells:
                continue
            half[side] = _quantile(cells, 0.5, level_m)
            spread = _quantile(cells, 0.8, level_m) - _quantile(cells, 0.2, level_m)
            if half[side] > -low_m and spread > spread_m:
                blocked = True
        if blocked:
            continue
        if np.isfinite(half[0]) and np.isfinite(half[1]):
            mean = 0.5 * (half[0] + half[1])
            alike = abs(half[0] - half[1]) <= alike_m + alike_share * abs(mean)
            if alike or max(half[0], half[1]) < -alike_m:
                surface[k] = mean
        elif half[0] < -low_m:
            surface[k] = half[0]
        elif half[1] < -low_m:
            surface[k] = half[1]
    return surface


def _walk(surface: Array, config: BendConfig) -> list[int]:
    """The bins of one unbroken surface that begins on the plane."""
    path: list[int] = []
    for k in np.flatnonzero(np.isfinite(surface)):
        if not path:
            if abs(surface[k]) < config.on_plane_m:
                path.append(int(k))
        elif k - path[-1] > config.longest_gap:
            break
        elif abs(surface[k] - surface[path[-1]]) <= config.steepest * config.bin_m * (k - path[-1]):
            path.append(int(k))
    return path


def _below_kerb(path: list[int], surface: Array, config: BendConfig) -> list[int]:
    """The path as far as it is no higher than a hump: what is higher and yet no ramp is a pavement."""
    ends = [n for n, k in enumerate(path) if surface[k] > config.kerb_m]
    return path[: ends[0]] if ends else path


def _uneven(path: list[int], surface: Array, config: BendConfig) -> bool:
    """Whether the path has a hump or a dip, which the plane leaves out and the lane as a whole does not."""
    if not path:
        return False
    off = np.zeros(len(surface))
    off[path] = surface[path] - np.median(surface[path])
    for sign in (1.0, -1.0):
        high = sign * off >= config.hump_m
        if any(high[k : k + config.hump_bins].all() for k in range(len(high) - config.hump_bins + 1)):
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
    taken to go on as it was, or level where it was coming back. curvature_per_m: of the car's way, positive to the
    right; in a sharp turn what lies ahead is not where the car goes.
    """
    bend = config.bend
    if abs(curvature_per_m) > bend.sharpest_per_m:
        return 0.0, 0.0
    plane = extrinsics.disparity_plane(camera)
    bins = round((config.far_m - config.near_m) / bend.bin_m)
    counts = np.zeros((bins, 2, bend.levels), np.int64)
    _count(
        disparity.values, free, disparity.step_px, camera.focal_px * camera.baseline_m, camera.cx_px, camera.cy_px,
        camera.baseline_m, np.array([plane.a, plane.b, plane.c_px]), extrinsics.height_m, config.near_m,
        config.half_width_m, curvature_per_m, bend.bin_m, bend.level_m, counts,
    )  # fmt: skip
    surface = _surface(
        counts, bend.level_m, bend.least_cells, bend.spread_m, bend.alike_m, bend.alike_share, bend.low_m
    )
    path = _walk(surface, bend)
    height = surface[path]
    rising = np.count_nonzero(height > bend.rising_m) >= bend.rising_bins
    up = len(path) > 2 and height.max() > bend.high_m and rising
    falling = np.count_nonzero(height < -0.5 * bend.low_m) >= bend.rising_bins
    down = len(path) > 2 and height.min() < -bend.low_m and falling
    at = np.arange(bins)
    if up or down:
        whole = np.interp(at, path, height, left=0.0)
        last, before = path[-1], path[-2]
        slope = (surface[last] - surface[before]) / (last - before)
        if slope * surface[last] < 0.0:
            slope = 0.0  # two bins that lead back to the plane may be noise, and five more of it a hill
        whole[last:] = surface[last] + slope * (at[last:] - last)
    elif _uneven(path := _below_kerb(path, surface, bend), surface, bend):
        whole = np.interp(at, path, surface[path], left=0.0, right=0.0)
    else:
        return 0.0, 0.0
    z = config.near_m + (at + 0.5) * bend.bin_m
    rise, offset = np.polyfit(z, whole, 1)
    return -float(offset), float(np.arctan(rise))
