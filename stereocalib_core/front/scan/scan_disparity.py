"""Disparities that a LiDAR scan predicts, beside those that the pair measures, on smooth surfaces.

Where scan and picture look at the same smooth surface, two things stand side by side: the disparity f b / Z by the
LiDAR's metres, and the one by the pictures. Over near and far surfaces the two together show the pair's disparity
offset (relative yaw) and the scale of its depths (focal length times baseline) apart: `back.rig.depth_scale`.

The picture is cut into cells. The points of the scan within one must lie on one plane in disparity space, which
drops edges, occlusions (the LiDAR looks over things that hide what is behind them from the camera) and foliage. The
pair's disparity is found by the matcher of the tracks, on the shear of that plane, to a few hundredths of a pixel.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from stereocalib_core.config.pair import ScanDisparityConfig
from stereocalib_core.config.tracks import PatchConfig
from stereocalib_core.front.rows.offsets import rows_down
from stereocalib_core.front.scan.view import ScanView
from stereocalib_core.front.tracks.row_patches import match_rows, row_leans
from stereocalib_core.geometry import Array, StereoCamera
from stereocalib_core.results import DisparityMap, RectificationSample

COLUMNS = 8
"""x, y, disparity by the LiDAR [px], by the pair [px], d disparity / d u, d v of the surface, how the match leans
(`row_leans`), and by how much the right row was taken to lie lower than the left one [px]."""


def scan_disparities(
    camera: StereoCamera,
    left: NDArray[np.uint8],
    right: NDArray[np.uint8],
    disparity: DisparityMap,
    view: ScanView,
    config: ScanDisparityConfig,
    rows: RectificationSample | None = None,
) -> NDArray[np.float32]:
    """(K, 8) float32 `COLUMNS` of one pair (H, W) and its scan; disparities are geometric, x = (u - cx) / f.

    disparity: the pair's dense map, from which the fine match starts, so that nothing pulls it to the LiDAR's value.
    rows: what the pair's rows say of themselves:
    it is matched along rows as they are, since rows that part by a third of a pixel move slanted edges by as much.
    """
    focal_baseline = camera.focal_px * camera.baseline_m
    near_to_far = focal_baseline / config.farthest_m, focal_baseline / config.nearest_m
    size = (camera.width, camera.height)
    planes = surfaces(view.seen, size, near_to_far, config.cell_px, config.least_points, config.flat_px)
    if not len(planes):
        return np.zeros((0, COLUMNS), np.float32)
    planes = planes[
        np.arange(min(len(planes), config.most_tried)) * len(planes) // min(len(planes), config.most_tried)
    ]
    start = _dense(disparity, planes[:, :2])
    planes, start = planes[np.isfinite(start)], start[np.isfinite(start)]
    offset = camera.disparity_offset_px
    points, down = np.ascontiguousarray(planes[:, :2]), rows_down(camera, rows, planes[:, :2], start)
    measured = match_rows(
        left, right, points, start + offset, np.ascontiguousarray(planes[:, 3:]), down,
        config.correlation, config.reach_px, PatchConfig().min_contrast,
    ) - offset  # fmt: skip
    agree = np.flatnonzero(np.abs(measured - planes[:, 2]) < config.most_px)
    agree = agree[np.linspace(0, len(agree) - 1, min(len(agree), config.most_samples)).round().astype(int)]
    planes, points, measured, down = planes[agree], points[agree], measured[agree], down[agree]
    lean = row_leans(left, right, points, measured + offset, np.ascontiguousarray(planes[:, 3:]), down)
    x, y = (planes[:, 0] - camera.cx_px) / camera.focal_px, (planes[:, 1] - camera.cy_px) / camera.focal_px
    table = np.column_stack([x, y, planes[:, 2], measured, planes[:, 3:], lean, down])
    return np.asarray(table, dtype=np.float32)


def _dense(disparity: DisparityMap, where: Array) -> Array:
    """(K,) disparity of the map at image points (K, 2), NaN where it has none."""
    cell = np.floor((where + 0.5) / disparity.step_px).astype(int)
    rows, columns = disparity.values.shape
    cell = np.clip(cell, 0, [columns - 1, rows - 1])
    return disparity.values[cell[:, 1], cell[:, 0]].astype(np.float64)


@njit(cache=True, nogil=True)
def surfaces(
    seen: Array, size: tuple[int, int], between: tuple[float, float], cell_px: int, least: int, flat_px: float
) -> Array:
    """(K, 5) u, v, disparity, and its slopes along u and v, of the cells whose points lie on one plane.

    seen: (N, 3) u, v and disparity [px] of the scan's points. size: width and height of the picture, whose outermost
    cells are left out. between: least and largest disparity [px]. least: points of a cell. flat_px: how far one
    of them may be off its plane.
    """
    columns = size[0] // cell_px + 1
    cells = columns * (size[1] // cell_px + 1)
    index = np.full(len(seen), -1, np.int32)
    # the points of cell k, in their order, are order[start[k]] ... order[start[k + 1] - 1]
    start = np.zeros(cells + 1, np.int32)
    for i in range(len(seen)):
        u, v, d = seen[i]
        within = cell_px < u < size[0] - cell_px and cell_px < v < size[1] - cell_px
        if within and between[0] < d < between[1]:
            index[i] = int(v) // cell_px * columns + int(u) // cell_px
            start[index[i] + 1] += 1
    for k in range(cells):
        start[k + 1] += start[k]
    order, next_one = np.empty(start[cells], np.int32), start[:cells].copy()
    for i in range(len(seen)):
        if index[i] >= 0:
            order[next_one[index[i]]] = i
            next_one[index[i]] += 1
    found = np.empty((len(seen) // max(least, 1) + 1, 5))
    count = 0
    for cell in range(cells):
        first, last = start[cell], start[cell + 1]
        n = last - first
        if n < least:
            continue
        u_mean = v_mean = d_mean = 0.0
        for k in range(first, last):
            i = order[k]
            u_mean += seen[i, 0] / n
            v_mean += seen[i, 1] / n
            d_mean += seen[i, 2] / n
        uu = uv = vv = ud = vd = 0.0
        for k in range(first, last):
            i = order[k]
            u, v, d = seen[i, 0] - u_mean, seen[i, 1] - v_mean, seen[i, 2] - d_mean
            uu += u * u
            uv += u * v
            vv += v * v
            ud += u * d
            vd += v * d
        determinant = uu * vv - uv * uv
        # points of one beam alone lie on a line and show no plane
        if not (determinant > 1e-2 * uu * uu and vv > n * 1.0):
            continue
        du, dv = (ud * vv - vd * uv) / determinant, (vd * uu - ud * uv) / determinant
        flat = True
        for k in range(first, last):
            i = order[k]
            off = seen[i, 2] - d_mean - du * (seen[i, 0] - u_mean) - dv * (seen[i, 1] - v_mean)
            flat = flat and abs(off) <= flat_px
        if flat:
            found[count, 0], found[count, 1], found[count, 2] = u_mean, v_mean, d_mean
            found[count, 3], found[count, 4] = du, dv
            count += 1
    return found[:count]


def warm_up() -> None:
    """Compile the loops by a small made-up scan."""
    seen = np.random.default_rng(0).uniform(4.0, 60.0, (90, 3))
    surfaces(seen, (64, 64), (1.0, 50.0), 10, 3, 9.0)
