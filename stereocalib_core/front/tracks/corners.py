"""Where to track: corners of the left picture, well spread, with the disparity of their pair."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from stereocalib_core.config import TracksConfig
from stereocalib_core.front.tracks.patches import HALF
from stereocalib_core.front.tracks.row_patches import match_rows
from stereocalib_core.geometry import Extrinsics, StereoCamera
from stereocalib_core.numeric.arrays import Array, Grey
from stereocalib_core.results import DisparityMap


@dataclass(frozen=True)
class Corners:
    """points: (N, 2) left u, v [px]. disparity: (N,) geometric [px]. on_road: (N,) bool."""

    points: Array
    disparity: Array
    on_road: NDArray[np.bool_]


def halve(image: Grey) -> Grey:
    """2x2 means; an odd last row or column is cut."""
    height, width = image.shape[0] // 2, image.shape[1] // 2
    return np.asarray(
        cv2.resize(image[: 2 * height, : 2 * width], (width, height), interpolation=cv2.INTER_AREA),
        dtype=np.uint8,
    )


@dataclass(frozen=True)
class Sharpness:
    """What a left picture shows by itself: nothing of it needs the road or the pair before.

    pyramid: at full, half and quarter size, uint8. strength: (H // 2, W // 2) float32, least eigenvalue of the
    gradients about each pixel of the half size (OpenCV's cornerMinEigenVal).
    """

    pyramid: tuple[Grey, Grey, Grey]
    strength: NDArray[np.float32]

    @staticmethod
    def of(left: Grey) -> Sharpness:
        """left: (H, W) uint8."""
        half = halve(left)
        strength = np.asarray(cv2.cornerMinEigenVal(half, 5, ksize=3), dtype=np.float32)
        return Sharpness((left, half, halve(half)), strength)


@njit(cache=True, nogil=True)
def _best_of_cells(
    score: NDArray[np.float32],
    disparity: NDArray[np.float32],
    plane: Array,
    cell: tuple[int, int],
    want_road: bool,
    tolerance: float,
    limits: Array,
    min_score: float,
) -> Array:
    """(N, 5) column, row, score, disparity, plane disparity of the best cell of each grid cell (half size).

    plane: disparity by half-size column, row and 1; zero = no road known. limits: least and largest plane
    disparity, then the half width in disparity units per column, used for road points.
    """
    rows, columns = score.shape
    border = HALF // 2 + 2
    width, height = cell
    found = np.empty(((rows // height + 1) * (columns // width + 1), 5))
    count = 0
    for top in range(border, rows - border, height):
        for left in range(border, columns - border, width):
            best = min_score
            for i in range(top, min(top + height, rows - border)):
                for j in range(left, min(left + width, columns - border)):
                    s = score[i, j]
                    if not s > best:
                        continue
                    d = disparity[i, j]
                    if not d > 1.0:
                        continue
                    road = plane[0] * j + plane[1] * i + plane[2]
                    if want_road:
                        inside = limits[0] < road < limits[1] and abs(j - limits[3]) < limits[2] * road
                        good = inside and abs(d - road) < tolerance
                    else:
                        good = d - road > limits[4] * d
                    if good:
                        best = s
                        found[count, 0], found[count, 1], found[count, 2] = j, i, s
                        found[count, 3], found[count, 4] = d, road
            if best > min_score:
                count += 1
    return found[:count]


def at_half_size(disparity: DisparityMap) -> NDArray[np.float32]:
    """(H // 2, W // 2) of a map on any grid, at least as large; on coarser grids a cell stands for its pixels."""
    step = disparity.step_px
    if step <= 2:
        return disparity.values if step == 2 else disparity.values[::2, ::2]
    return disparity.values.repeat(step // 2, axis=0).repeat(step // 2, axis=1)


def find_corners(
    camera: StereoCamera,
    left: Grey,
    right: Grey,
    strength: NDArray[np.float32],
    extrinsics: Extrinsics,
    disparity: DisparityMap,
    road_known: bool,
    config: TracksConfig | None = None,
) -> Corners:
    """Corners on and above the road, their disparity refined; left, right (H, W), strength as in `Sharpness`.

    `road_known` False gives none on the road and takes `extrinsics` as a rough guess.
    """
    settings = config or TracksConfig()
    rules, patch = settings.corners, settings.patch
    values = at_half_size(disparity)
    rows, columns = min(strength.shape[0], values.shape[0]), min(strength.shape[1], values.shape[1])
    p = extrinsics.disparity_plane(camera)
    # half-size column j is u = 2 j + 0.5
    plane = np.array(
        [2 * p.b, 2 * p.a, p.a * (0.5 - camera.cy_px) + p.b * (0.5 - camera.cx_px) + p.c_px], dtype=np.float64
    )
    fb = camera.focal_px * camera.baseline_m
    limits = np.array(
        [
            fb / rules.road_far_m,
            fb / rules.road_near_m,
            rules.road_half_width_m / camera.baseline_m / 2,
            (camera.cx_px - 0.5) / 2,
            rules.above_road_m / extrinsics.height_m,
        ]
    )
    score = np.ascontiguousarray(strength[:rows, :columns])
    values = np.ascontiguousarray(values[:rows, :columns])
    least, tolerance = rules.min_score, rules.road_tolerance_px
    cell = (rules.road_cell_px[0] // 2, rules.road_cell_px[1] // 2)
    road = _best_of_cells(score, values, plane, cell, True, tolerance + rules.matcher_px, limits, least)
    road = road[np.argsort(-road[:, 2], kind="stable")[: rules.max_road if road_known else 0]]
    cell = (rules.above_cell_px[0] // 2, rules.above_cell_px[1] // 2)
    above = _best_of_cells(score, values, plane, cell, False, 0.0, limits, 4 * least)
    above = above[np.argsort(-above[:, 2], kind="stable")[: rules.max_above]]
    points = np.concatenate([road, above])
    on_road = np.arange(len(points)) < len(road)
    uv = np.floor(2 * points[:, :2] + 1.0)
    expected = np.where(on_road, p.disparity(camera, uv[:, 0], uv[:, 1]), points[:, 3])
    offset = camera.disparity_offset_px
    tilt, reach = slopes(p.a, p.b, on_road), rules.search_disparity_px
    matched = match_rows(
        left,
        right,
        uv,
        expected + offset,
        tilt,
        np.zeros(len(uv)),
        patch.min_correlation,
        reach,
        patch.min_contrast,
    )
    refined = matched - offset
    keep = np.isfinite(refined) & (refined > 1.0) & (~on_road | (np.abs(refined - expected) < tolerance))
    return Corners(uv[keep], refined[keep], on_road[keep])


def slopes(a: float, b: float, on_road: NDArray[np.bool_]) -> Array:
    """(N, 2) slope of disparity along u and v: the road's for road points, none for others."""
    return np.where(on_road[:, None], np.array([b, a]), 0.0)
