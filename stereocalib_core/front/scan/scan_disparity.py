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
from stereocalib_core.front.tracks.patches import match_rows
from stereocalib_core.geometry import Array, StereoCamera
from stereocalib_core.results import DisparityMap, RectificationSample

COLUMNS = 6
"""x, y, disparity by the LiDAR [px], by the pair [px], and d disparity / d u, d v of the surface."""


def scan_disparities(
    camera: StereoCamera,
    left: NDArray[np.uint8],
    right: NDArray[np.uint8],
    disparity: DisparityMap,
    scan: NDArray[np.float32],
    T_camera_lidar: Array,
    config: ScanDisparityConfig,
    rows: RectificationSample | None = None,
) -> NDArray[np.float32]:
    """(K, 6) float32 `COLUMNS` of one pair (H, W) and its scan (N, 4); disparities are geometric, x = (u - cx) / f.

    disparity: the pair's dense map, from which the fine match starts, so that nothing pulls it to the LiDAR's value.
    T_camera_lidar: (4, 4), LiDAR to camera coordinates [m]. rows: what the pair's rows say of themselves; the right
    picture is straightened by that first, since rows that part by a third of a pixel move slanted edges by as much.
    """
    lens = (camera.focal_px, camera.cx_px, camera.cy_px, camera.focal_px * camera.baseline_m)
    size = (camera.width, camera.height)
    T = np.ascontiguousarray(T_camera_lidar, dtype=np.float64)
    seen = in_picture(
        np.ascontiguousarray(scan), T, lens, size, config.cell_px, config.nearest_m, config.farthest_m
    )
    planes = surfaces(seen, camera.width, config.cell_px, config.least_points, config.flat_px)
    if not len(planes):
        return np.zeros((0, COLUMNS), np.float32)
    planes = planes[
        np.arange(min(len(planes), config.most_tried)) * len(planes) // min(len(planes), config.most_tried)
    ]
    if rows is not None:
        right = straightened(camera, right, rows)
    start = _dense(disparity, planes[:, :2])
    planes, start = planes[np.isfinite(start)], start[np.isfinite(start)]
    offset = camera.disparity_offset_px
    measured = match_rows(
        left, right, np.ascontiguousarray(planes[:, :2]), start + offset, np.ascontiguousarray(planes[:, 3:]),
        config.correlation, config.reach_px, PatchConfig().min_contrast,
    ) - offset  # fmt: skip
    agree = np.abs(measured - planes[:, 2]) < config.most_px
    planes, measured = planes[agree], measured[agree]
    keep = np.linspace(0, len(planes) - 1, min(len(planes), config.most_samples)).round().astype(int)
    x, y = (planes[:, 0] - camera.cx_px) / camera.focal_px, (planes[:, 1] - camera.cy_px) / camera.focal_px
    table = np.column_stack([x, y, planes[:, 2], measured, planes[:, 3:]])
    return np.asarray(table[keep], dtype=np.float32)


def _dense(disparity: DisparityMap, where: Array) -> Array:
    """(K,) disparity of the map at image points (K, 2), NaN where it has none."""
    cell = np.floor((where + 0.5) / disparity.step_px).astype(int)
    rows, columns = disparity.values.shape
    cell = np.clip(cell, 0, [columns - 1, rows - 1])
    return disparity.values[cell[:, 1], cell[:, 0]].astype(np.float64)


def straightened(
    camera: StereoCamera, right: NDArray[np.uint8], rows: RectificationSample
) -> NDArray[np.uint8]:
    """The right picture (H, W) with its rows where the left picture has them; columns stay."""
    cx = camera.cx_px if camera.cx_right_px is None else camera.cx_right_px
    bend = (float(rows.values[0]), float(rows.values[2]), float(rows.keystone_rad))
    return shifted_rows(right, bend, (camera.focal_px, cx, camera.cy_px))


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract", "arcp", "nsz"})
def shifted_rows(
    image: NDArray[np.uint8], bend: tuple[float, float, float], lens: tuple[float, float, float]
) -> NDArray[np.uint8]:
    """(H, W) to the picture whose row v is row v + a (1 + y^2) + f (roll x + keystone x y) of the image.

    bend: a [px], roll, keystone [rad]. lens: focal length, cx, cy [px]. Cubic interpolation down a column (Keys 1981).
    """
    height, width = image.shape
    result = np.empty_like(image)
    f, cx, cy = lens
    for i in range(height):
        y = (i - cy) / f
        middle, slope = i + bend[0] * (1.0 + y * y), bend[1] + bend[2] * y
        for j in range(width):
            v = middle + (j - cx) * slope
            row = int(np.floor(v))
            t = v - row
            before, here = min(max(row - 1, 0), height - 1), min(max(row, 0), height - 1)
            after, last = min(max(row + 1, 0), height - 1), min(max(row + 2, 0), height - 1)
            p, q, r, s = image[before, j], image[here, j], image[after, j], image[last, j]
            p0, p1, p2, p3 = float(p), float(q), float(r), float(s)
            value = p1 + 0.5 * t * (
                p2 - p0 + t * (2.0 * p0 - 5.0 * p1 + 4.0 * p2 - p3 + t * (3.0 * (p1 - p2) + p3 - p0))
            )
            result[i, j] = np.uint8(min(max(value + 0.5, 0.0), 255.0))
    return result


@njit(cache=True, nogil=True)
def in_picture(
    scan: NDArray[np.float32],
    T: Array,
    lens: tuple[float, float, float, float],
    size: tuple[int, int],
    margin: int,
    nearest_m: float,
    farthest_m: float,
) -> Array:
    """(M, 3) u, v, disparity [px] of the points (N, 4) of a scan that the left picture shows.

    lens: focal length, cx, cy [px], focal length times baseline [px m]. size: width and height. margin: [px].
    """
    found = np.empty((len(scan), 3))
    count = 0
    for i in range(len(scan)):
        x, y, z = float(scan[i, 0]), float(scan[i, 1]), float(scan[i, 2])
        ahead = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
        if not nearest_m < ahead < farthest_m:
            continue
        u = lens[0] * (T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]) / ahead + lens[1]
        v = lens[0] * (T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]) / ahead + lens[2]
        if margin < u < size[0] - margin and margin < v < size[1] - margin:
            found[count, 0], found[count, 1], found[count, 2] = u, v, lens[3] / ahead
            count += 1
    return found[:count].copy()


@njit(cache=True, nogil=True)
def surfaces(seen: Array, width: int, cell_px: int, least: int, flat_px: float) -> Array:
    """(K, 5) u, v, disparity, and its slopes along u and v, of the cells whose points lie on one plane.

    seen: (N, 3) u, v [px] and disparity [px] of the scan's points. least: points of a cell. flat_px: how far one of
    them may be off its plane.
    """
    columns = width // cell_px + 1
    index = np.empty(len(seen), np.int64)
    for i in range(len(seen)):
        index[i] = int(seen[i, 1]) // cell_px * columns + int(seen[i, 0]) // cell_px
    order = np.argsort(index, kind="mergesort")
    found = np.empty((len(seen) // max(least, 1) + 1, 5))
    count, first = 0, 0
    while first < len(order):
        last = first
        while last < len(order) and index[order[last]] == index[order[first]]:
            last += 1
        n = last - first
        if n >= least:
            mean = np.zeros(3)
            for k in range(first, last):
                mean += seen[order[k]] / n
            uu = uv = vv = ud = vd = 0.0
            for k in range(first, last):
                u, v, d = seen[order[k]] - mean
                uu += u * u
                uv += u * v
                vv += v * v
                ud += u * d
                vd += v * d
            determinant = uu * vv - uv * uv
            # points of one beam alone lie on a line and show no plane
            if determinant > 1e-2 * uu * uu and vv > n * 1.0:
                du, dv = (ud * vv - vd * uv) / determinant, (vd * uu - ud * uv) / determinant
                flat = True
                for k in range(first, last):
                    u, v, d = seen[order[k]] - mean
                    if abs(d - du * u - dv * v) > flat_px:
                        flat = False
                        break
                if flat:
                    found[count, 0], found[count, 1], found[count, 2] = mean
                    found[count, 3], found[count, 4] = du, dv
                    count += 1
        first = last
    return found[:count]


def warm_up() -> None:
    """Compile the loops by a small made-up scan."""
    scan = np.ones((8, 4), np.float32)
    shifted_rows(np.zeros((8, 8), np.uint8), (0.1, 0.0, 0.0), (10.0, 4.0, 4.0))
    seen = in_picture(scan, np.eye(4), (100.0, 50.0, 50.0, 50.0), (100, 100), 2, 0.5, 10.0)
    surfaces(np.concatenate([seen, np.random.default_rng(0).uniform(4.0, 8.0, (30, 3))]), 100, 4, 3, 9.0)
