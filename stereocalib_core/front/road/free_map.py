"""Obstacles and the free map by u-disparity.

What stands upright piles up in one cell of the u-disparity: an obstacle of height H at disparity Delta
covers H Delta / b rows of its column at (nearly) one disparity, a road only h / b rows per pixel of
disparity however near it is. Valid cells outside such piles are the free map.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from stereocalib_core.config import FreeMapConfig
from stereocalib_core.geometry import StereoCamera
from stereocalib_core.results import DisparityMap


@njit(cache=True, nogil=True)
def _pile_cells(u_counts: NDArray[np.int32], limits: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Cells of the u-disparity in whose three-bin neighbourhood more rows pile up than `limits` allows."""
    bins, width = u_counts.shape
    piles = np.zeros((bins, width), np.bool_)
    for k in range(bins):
        for j in range(width):
            total = u_counts[k, j]
            if total == 0:
                continue
            if k > 0:
                total += u_counts[k - 1, j]
            if k + 1 < bins:
                total += u_counts[k + 1, j]
            piles[k, j] = total > limits[k]
    return piles


@njit(cache=True, nogil=True)
def _label(
    values: NDArray[np.float32], piles: NDArray[np.bool_], bin_px: float
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    height, width = values.shape
    bins = piles.shape[0]
    obstacles = np.zeros((height, width), np.bool_)
    free = np.zeros((height, width), np.bool_)
    for i in range(height):
        for j in range(width):
            d = values[i, j]
            if d > 0:
                k = int(d / bin_px)
                if k < bins and piles[k, j]:
                    obstacles[i, j] = True
                else:
                    free[i, j] = True
    return obstacles, free


def pile_limits(
    camera: StereoCamera, step_px: int, bin_px: float, bins: int, config: FreeMapConfig
) -> NDArray:
    """(bins,) rows of the grid beyond which three neighbouring u-disparity cells are an obstacle."""
    disparity = (np.arange(bins) + 0.5) * bin_px
    road_rows = 3.0 * bin_px * config.road_height_m / camera.baseline_m
    obstacle_rows = config.obstacle_height_m * disparity / camera.baseline_m
    return np.maximum(config.road_margin * road_rows, obstacle_rows + road_rows) / step_px


def separate(
    disparity: DisparityMap,
    u_counts: NDArray[np.int32],
    bin_px: float,
    camera: StereoCamera,
    config: FreeMapConfig,
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Obstacle and free masks, both (h, w) bool on the disparity grid; a cell without disparity is in neither."""
    limits = pile_limits(camera, disparity.step_px, bin_px, len(u_counts), config)
    return _label(disparity.values, _pile_cells(u_counts, limits), bin_px)
