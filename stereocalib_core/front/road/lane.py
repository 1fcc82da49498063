"""How well a plane describes the car's own lane: coverage, agreement and range, counted on the disparity grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from stereocalib_core.config import LaneConfig
from stereocalib_core.geometry import Extrinsics, StereoCamera
from stereocalib_core.results import DisparityMap

_BINS_PER_M = 2


@dataclass(frozen=True)
class LaneSupport:
    """covered: free cells / cells of the lane in the picture. agreement: agreeing / free cells. Both 0...1.

    cells: how many cells of the lane are in the picture; agreeing: how many agree.
    range_m: nearest and farthest road distance with agreeing cells.
    """

    covered: float
    agreement: float
    cells: int
    agreeing: int
    range_m: tuple[float, float]


@njit(cache=True, nogil=True)
def _count(
    values: NDArray[np.float32],
    free: NDArray[np.bool_],
    step: int,
    fb: float,
    cx: float,
    cy: float,
    b: float,
    plane: NDArray[np.float64],
    camera_height: float,
    near: float,
    far: float,
    half_lane: float,
    height_tolerance: float,
    pixel_tolerance: float,
    histogram: NDArray[np.int64],
) -> tuple[int, int, int]:
    rows, columns = values.shape
    cells = valid = agreeing = 0
    for i in range(rows):
        v = (i + 0.5) * step - 0.5
        for j in range(columns):
            u = (j + 0.5) * step - 0.5
            d = plane[0] * (v - cy) + plane[1] * (u - cx) + plane[2]
            if d * far < fb or d * near > fb or abs(u - cx) * b > half_lane * d:
                continue
            cells += 1
            if not free[i, j]:
                continue
            valid += 1
            if abs(values[i, j] - d) < max(height_tolerance / camera_height * d, pixel_tolerance):
                agreeing += 1
                histogram[min(int(fb / d * _BINS_PER_M), len(histogram) - 1)] += 1
    return cells, valid, agreeing


def measure(
    disparity: DisparityMap,
    free: NDArray[np.bool_],
    camera: StereoCamera,
    extrinsics: Extrinsics,
    far_m: float,
    config: LaneConfig,
) -> LaneSupport:
    """Support of the plane of `extrinsics` in the lane up to `far_m`; `free` is the (h, w) free map."""
    plane = extrinsics.disparity_plane(camera)
    histogram = np.zeros(int(far_m * _BINS_PER_M) + 2, np.int64)
    cells, valid, agreeing = _count(
        disparity.values, free, disparity.step_px, camera.focal_px * camera.baseline_m, camera.cx_px, camera.cy_px,
        camera.baseline_m, np.array([plane.a, plane.b, plane.c_px]), extrinsics.height_m, config.near_m, far_m,
        config.half_width_m, config.agree_height_m, config.agree_px, histogram,
    )  # fmt: skip
    populated = np.nonzero(histogram > 3)[0]
    reach = (0.0, 0.0)
    if len(populated):
        reach = (float(populated[0] / _BINS_PER_M), float(min((populated[-1] + 1) / _BINS_PER_M, far_m)))
    return LaneSupport(valid / max(cells, 1), agreeing / max(valid, 1), cells, agreeing, reach)


@njit(cache=True, nogil=True)
def _road_mask(
    values: NDArray[np.float32],
    free: NDArray[np.bool_],
    step: int,
    cx: float,
    cy: float,
    plane: NDArray[np.float64],
    camera_height: float,
    height_tolerance: float,
    pixel_tolerance: float,
) -> tuple[NDArray[np.bool_], int, int]:
    rows, columns = values.shape
    road = np.zeros((rows, columns), np.bool_)
    below = free_below = 0
    for i in range(rows):
        v = (i + 0.5) * step - 0.5
        for j in range(columns):
            d = plane[0] * (v - cy) + plane[1] * ((j + 0.5) * step - 0.5 - cx) + plane[2]
            if d <= 0.0:
                continue
            below += 1
            if free[i, j]:
                free_below += 1
                road[i, j] = abs(values[i, j] - d) < max(
                    height_tolerance / camera_height * d, pixel_tolerance
                )
    return road, free_below, below


def road_mask(
    disparity: DisparityMap,
    free: NDArray[np.bool_],
    camera: StereoCamera,
    extrinsics: Extrinsics,
    config: LaneConfig,
) -> tuple[NDArray[np.bool_], float]:
    """(h, w) free cells on the plane wherever they are, and free cells / cells below the horizon."""
    plane = extrinsics.disparity_plane(camera)
    road, free_below, below = _road_mask(
        disparity.values, free, disparity.step_px, camera.cx_px, camera.cy_px,
        np.array([plane.a, plane.b, plane.c_px]), extrinsics.height_m, config.agree_height_m, config.agree_px,
    )  # fmt: skip
    return road, free_below / max(below, 1)
