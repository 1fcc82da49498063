"""The road's own region: the connected part of the picture that lies on the road's plane in front of the car.

Grown from a candidate plane: the free cells on it, pinholes closed, of which the connected piece with the most road
in front of the car is kept and the plane fitted again to that piece. Kerbs, lawns, snow banks and other cars end it
because they leave the plane; black borders and the car's own bonnet because they are none of the `allowed` cells.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from stereocalib_core.config import RegionConfig, SightConfig
from stereocalib_core.front.road.candidates import Way
from stereocalib_core.front.sight import Reach, noise_px, reach_of
from stereocalib_core.geometry import DisparityPlane, StereoCamera
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.small_algebra import solve_square
from stereocalib_core.results import DisparityMap

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Region:
    """The road's region and the plane through it.

    cells: (h, w) bool on the disparity grid. plane: of the cells' disparities, least squares. reach: looked at.
    strip: about what the plane is meant: straight ahead, or where that is hardly road, the car's way.
    range_m: nearest and farthest road distance in that strip. share: of the strip, how much the region covers, 0...1.
    planar: of the measured cells of that strip up to where the region ends, how many lie on the plane.
    count: cells in all. scatter_px: rms of the cells over the plane. focal_px: of the camera.
    """

    cells: Mask
    plane: DisparityPlane
    reach: Reach
    strip: Way
    range_m: tuple[float, float]
    share: float
    planar: float
    count: int
    scatter_px: float
    focal_px: float

    def plane_at(self, camera: StereoCamera) -> DisparityPlane:
        """The same plane for shrunk pictures of the same camera: only `c_px` knows their size."""
        by = self.focal_px / camera.focal_px
        return DisparityPlane(self.plane.a, self.plane.b, self.plane.c_px / by)


@njit(cache=True, nogil=True)
def _on_plane(
    values: NDArray[np.float32],
    allowed: Mask,
    step: int,
    camera: Array,
    plane: Array,
    way: Array,
    near: float,
    far: float,
    half_width: float,
    height_tolerance: float,
    pixel_tolerance: float,
    length: float,
    on: NDArray[np.uint8],
    weight: NDArray[np.float32],
) -> None:
    """Marks the cells on the plane, and gives each its road area by nearness to the car; fills `on` and `weight`.

    camera: f, cx, cy, b. way: slope, curvature, side length [m], slope straight ahead.
    """
    f, cx, cy, b = camera
    rows, columns = values.shape
    for i in range(rows):
        v = (i + 0.5) * step - 0.5 - cy
        for j in range(columns):
            on[i, j] = 0
            if not allowed[i, j]:
                continue
            u = (j + 0.5) * step - 0.5 - cx
            d = plane[0] * v + plane[1] * u + plane[2]
            if d * far < f * b or d * near > f * b:
                continue
            e = values[i, j] - d
            if abs(e) > max(height_tolerance * d, pixel_tolerance):
                continue
            z = f * b / d
            x = u * b / d - way[0] * z - 0.5 * way[1] * z * z
            if min(abs(x), abs(u * b / d - way[3] * z)) > half_width:
                continue
            on[i, j] = 1
            q = z / length
            weight[i, j] = z * z * z / ((1.0 + (x / way[2]) ** 2) ** 2 * (1.0 + q * q * q * q))


@njit(cache=True, nogil=True)
def _root(parent: NDArray[np.int32], k: int) -> int:
    while parent[k] != k:
        parent[k] = parent[parent[k]]
        k = parent[k]
    return k


@njit(cache=True, nogil=True)
def connected(mask: NDArray[np.uint8]) -> tuple[int, NDArray[np.int32]]:
    """Labels 1, 2, ... of the 4-connected pieces of (h, w) `mask`, 0 elsewhere, and how many labels there are with 0.

    Two passes with union-find, as OpenCV's, which would wait for a second core here.
    """
    rows, columns = mask.shape
    labels = np.zeros((rows, columns), np.int32)
    parent = np.zeros(rows * columns // 2 + 2, np.int32)
    count = 1
    for i in range(rows):
        for j in range(columns):
            if not mask[i, j]:
                continue
            above = labels[i - 1, j] if i > 0 else 0
            before = labels[i, j - 1] if j > 0 else 0
            if above and before and above != before:
                a, b = _root(parent, above), _root(parent, before)
                parent[max(a, b)] = min(a, b)
                labels[i, j] = min(a, b)
            elif above or before:
                labels[i, j] = max(above, before)
            else:
                labels[i, j] = parent[count] = count
                count += 1
    names = np.zeros(count, np.int32)
    pieces = 0
    for k in range(1, count):
        root = _root(parent, k)
        if names[root] == 0:
            pieces += 1
            names[root] = pieces
        names[k] = names[root]
    for i in range(rows):
        for j in range(columns):
            labels[i, j] = names[labels[i, j]]
    return pieces + 1, labels


@njit(cache=True, nogil=True)
def _piece_weights(
    labels: NDArray[np.int32], on: NDArray[np.uint8], weight: NDArray[np.float32], n: int
) -> Array:
    total = np.zeros(n)
    rows, columns = labels.shape
    for i in range(rows):
        for j in range(columns):
            if on[i, j]:
                total[labels[i, j]] += weight[i, j]
    total[0] = 0.0
    return total


# Sums may be reordered, so that several cells are taken at once.
@njit(cache=True, nogil=True, fastmath={"reassoc", "contract", "arcp", "nsz"})
def _refit(
    values: NDArray[np.float32],
    labels: NDArray[np.int32],
    on: NDArray[np.uint8],
    piece: int,
    step: int,
    cx: float,
    cy: float,
    plane: Array,
    limit_px: float,
) -> tuple[Array, int, float]:
    """Tukey-weighted least squares of disparity over the cells of one piece: plane, cells, rms [px]; NaN = failed."""
    rows, columns = values.shape
    H, r = np.zeros((3, 3)), np.zeros((3, 1))
    n, squares, total = 0, 0.0, 0.0
    for i in range(rows):
        v = (i + 0.5) * step - 0.5 - cy
        s0 = s1 = s2 = t0 = t1 = 0.0
        for j in range(columns):
            if not on[i, j] or labels[i, j] != piece:
                continue
            u = (j + 0.5) * step - 0.5 - cx
            e = values[i, j] - (plane[0] * v + plane[1] * u + plane[2])
            q = e / limit_px
            inside = max(1.0 - q * q, 0.0)
            w = inside * inside
            n += 1
            s0 += w
            s1 += w * u
            s2 += w * u * u
            t0 += w * e
            t1 += w * e * u
            squares += w * e * e
        H[0, 0] += v * v * s0
        H[0, 1] += v * s1
        H[0, 2] += v * s0
        H[1, 1] += s2
        H[1, 2] += s1
        H[2, 2] += s0
        r[0, 0] += v * t0
        r[1, 0] += t1
        r[2, 0] += t0
        total += s0
    H[1, 0], H[2, 0], H[2, 1] = H[0, 1], H[0, 2], H[1, 2]
    if n < 10 or not solve_square(H, r) > 0.0:
        return np.full(3, np.nan), n, np.nan
    refitted = np.empty(3)
    for p in range(3):
        refitted[p] = plane[p] + r[p, 0]
    return refitted, n, np.sqrt(squares / max(total, 1e-9))


@njit(cache=True, nogil=True)
def _survey(
    allowed: Mask,
    region: Mask,
    step: int,
    camera: Array,
    plane: Array,
    way: Array,
    near: float,
    far: float,
    half_strip: float,
    bins_per_near: float,
) -> tuple[int, Array, Array, Array]:
    """Cells of the strip about the way by distance: all of them, measured ones, and those of the region."""
    f, cx, cy, b = camera
    count = int((far / near - 1.0) * bins_per_near) + 1
    every, seen, mine = np.zeros(count), np.zeros(count), np.zeros(count)
    rows, columns = region.shape
    total = 0
    for i in range(rows):
        v = (i + 0.5) * step - 0.5 - cy
        for j in range(columns):
            u = (j + 0.5) * step - 0.5 - cx
            d = plane[0] * v + plane[1] * u + plane[2]
            if d * far < f * b or d * near > f * b:
                continue
            z = f * b / d
            if region[i, j]:
                total += 1
            x = u * b / d - way[0] * z - 0.5 * way[1] * z * z
            if abs(x) > half_strip:
                continue
            k = min(int((z / near - 1.0) * bins_per_near), count - 1)
            every[k] += 1.0
            seen[k] += allowed[i, j]
            mine[k] += region[i, j]
    return total, every, seen, mine


def grow(
    disparity: DisparityMap,
    allowed: Mask,
    camera: StereoCamera,
    start: DisparityPlane,
    strips: tuple[Way, Way],
    sight: SightConfig,
    config: RegionConfig,
) -> Region | None:
    """The region of the plane `start` among the (h, w) `allowed` cells; None where too little is connected.

    strips: straight ahead, and where the car goes.
    """
    straight, way = strips
    values, step = disparity.values, disparity.step_px
    track = np.array([way.slope, way.curvature_per_m, config.way_side_m, straight.slope])
    on, labels = np.zeros((0, 0), np.uint8), np.zeros((0, 0), np.int32)
    hole = np.ones((config.pinhole_cells, config.pinhole_cells), np.uint8)
    plane = np.array([start.a, start.b, start.c_px])
    noise = noise_px(step, sight)
    piece, scatter = 0, noise
    top = 0
    for round_ in range(config.rounds):
        reach = reach_of(camera, DisparityPlane(*plane), step, sight)
        height = camera.baseline_m / plane[0]
        relative = min(config.tolerance_m, config.tolerance_of_height * height) / height
        top = _first_row(camera, plane, step, reach.far_m, len(values), config)
        optics = np.array([camera.focal_px, camera.cx_px, camera.cy_px - top * step, camera.baseline_m])
        on, weight = np.zeros(values[top:].shape, np.uint8), np.empty(values[top:].shape, np.float32)
        _on_plane(
            values[top:], allowed[top:], step, optics, plane, track, 0.9 * reach.near_m, reach.far_m,
            config.half_width_m, relative, config.tolerance_noise * noise, config.near_length * reach.near_m,
            on, weight,
        )  # fmt: skip
        closed = cv2.morphologyEx(on, cv2.MORPH_CLOSE, hole)
        n, labels = connected(np.asarray(closed, dtype=np.uint8))
        if n < 2:
            return None
        piece = int(np.argmax(_piece_weights(labels, on, weight, n)))
        limit = config.tukey * max(scatter, noise) * (2.0 if round_ == 0 else 1.0)
        fitted, count, scatter = _refit(
            values[top:], labels, on, piece, step, camera.cx_px, camera.cy_px - top * step, plane, limit
        )
        if count < config.min_cells or not np.isfinite(fitted).all() or fitted[0] <= 0:
            return None
        plane = fitted
    cells = np.zeros(values.shape, np.bool_)
    cells[top:] = (labels == piece) & on.view(np.bool_)
    found = DisparityPlane(*(float(x) for x in plane))
    reach = reach_of(camera, found, step, sight)
    ahead = _surveyed(step, allowed, cells, camera, found, straight, reach, float(scatter), config)
    if ahead.share >= config.min_share_ahead:
        return ahead
    turning = _surveyed(step, allowed, cells, camera, found, way, reach, float(scatter), config)
    return turning if turning.share > ahead.share else ahead


def _first_row(
    camera: StereoCamera, plane: Array, step_px: int, far_m: float, rows: int, config: RegionConfig
) -> int:
    """The first row of the grid in which the plane is nearer than `far_m` anywhere, less what closing holes takes."""
    ends = np.array([0.0, camera.width - 1.0]) - camera.cx_px
    nearer = camera.focal_px * camera.baseline_m / far_m
    v = camera.cy_px + np.min((nearer - plane[2] - plane[1] * ends) / plane[0])
    return int(np.clip(np.floor(v / step_px) - config.pinhole_cells - 1, 0, rows - 1))


def _surveyed(
    step_px: int,
    allowed: Mask,
    cells: Mask,
    camera: StereoCamera,
    plane: DisparityPlane,
    strip: Way,
    reach: Reach,
    scatter: float,
    config: RegionConfig,
) -> Region:
    """The region with what it covers of a strip."""
    parameters = np.array([plane.a, plane.b, plane.c_px])
    top = _first_row(camera, parameters, step_px, reach.far_m, len(cells), config)
    optics = np.array([camera.focal_px, camera.cx_px, camera.cy_px - top * step_px, camera.baseline_m])
    total, every, seen, mine = _survey(
        allowed[top:], cells[top:], step_px, optics, parameters,
        np.array([strip.slope, strip.curvature_per_m]),
        reach.near_m, reach.far_m, config.half_strip_m, config.bins_per_near,
    )  # fmt: skip
    filled = np.flatnonzero(mine > config.bin_share * np.maximum(every, 1.0))
    width = reach.near_m / config.bins_per_near
    if len(filled):
        ends = reach.near_m + width * filled[0], min(reach.near_m + width * (filled[-1] + 1), reach.far_m)
        inside = slice(0, filled[-1] + 1)
    else:
        ends, inside = (reach.near_m, reach.near_m), slice(0, 0)
    # every bin is as much road as any other, however many cells see it
    share = float(np.mean(mine / np.maximum(every, 1.0))) if len(every) else 0.0
    planar = float(mine[inside].sum() / max(seen[inside].sum(), 1.0))
    return Region(cells, plane, reach, strip, ends, share, planar, total, scatter, camera.focal_px)
