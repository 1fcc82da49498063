"""Sparse left-right matches whose rows are free: corners, a coarse search, sub-pixel alignment both ways."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from stereocalib_core.config import RowMatchesConfig
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.small_algebra import solve_square

Bytes = NDArray[np.uint8]


@dataclass(frozen=True)
class RowMatches:
    """What the corners of one pair say.

    points: (M, 4) left u, v and right u, v [px] of the matches that were aligned.
    corners: corners looked at.
    coarse_px: (F,) raw disparities [px] of every corner with a clear coarse match.
    """

    points: Array
    corners: int
    coarse_px: Array


@njit(cache=True, nogil=True)
def _corners(strength: NDArray[np.float32], cell: int, border: int, least: float) -> NDArray[np.int32]:
    """(N, 2) int32 half-resolution u, v of the strongest corner of each cell."""
    height, width = strength.shape
    rows, columns = (height - 2 * border) // cell, (width - 2 * border) // cell
    result = np.empty((max(rows * columns, 0), 2), np.int32)
    count = 0
    for i in range(rows):
        for j in range(columns):
            best, bu, bv = least, -1, -1
            for v in range(border + i * cell, border + (i + 1) * cell):
                for u in range(border + j * cell, border + (j + 1) * cell):
                    if strength[v, u] > best:
                        best, bu, bv = strength[v, u], u, v
            if bu >= 0:
                result[count, 0], result[count, 1] = bu, bv
                count += 1
    return result[:count]


@njit(cache=True, nogil=True)
def _correlation(left: Bytes, right: Bytes, ul: int, vl: int, ur: int, vr: int, side: int) -> float:
    """Zero-mean correlation of two square patches given by their first pixels; -1 outside the picture."""
    height, width = right.shape
    if ur < 0 or vr < 0 or ur + side > width or vr + side > height:
        return -1.0
    sum_l, sum_r, sum_ll = np.int32(0), np.int32(0), np.int32(0)
    sum_rr, sum_lr = np.int32(0), np.int32(0)
    for y in range(side):
        for x in range(side):
            a, b = np.int32(left[vl + y, ul + x]), np.int32(right[vr + y, ur + x])
            sum_l += a
            sum_ll += a * a
            sum_r += b
            sum_rr += b * b
            sum_lr += a * b
    area = float(side * side)
    var_l = area * sum_ll - float(sum_l) * sum_l
    var_r = area * sum_rr - float(sum_r) * sum_r
    return (area * sum_lr - float(sum_l) * sum_r) / np.sqrt(var_l * var_r + 1.0)


@njit(cache=True, nogil=True)
def _search(
    left: Bytes,
    right: Bytes,
    corners: NDArray[np.int32],
    reach: int,
    low: int,
    high: int,
    rows: int,
    every: int,
) -> Array:
    """(N, 4) disparity, row offset, best correlation and the best one elsewhere, half-resolution pixels.

    Only every `every`-th corner is searched beyond infinity, where nothing but a swapped pair matches.
    """
    side = 2 * reach
    result = np.empty((len(corners), 4), np.float64)
    scores = np.empty(high - low + 1, np.float64)
    for k in range(len(corners)):
        u, v = corners[k, 0] - reach, corners[k, 1] - reach
        best, best_d, best_row = -1.0, 0, 0
        start = low if k % every == 0 else max(low, -2)
        for d in range(low, high + 1):
            score = -1.0
            if d >= start:
                for row in range(-rows, rows + 1):
                    value = _correlation(left, right, u, v, u - d, v + row, side)
                    score = max(score, value)
                    if value > best:
                        best, best_d, best_row = value, d, row
            scores[d - low] = score
        second = -1.0
        for d in range(low, high + 1):
            if abs(d - best_d) > 2 and scores[d - low] > second:
                second = scores[d - low]
        centre_d, centre_row = best_d, best_row
        for row in (centre_row - 1, centre_row + 1):
            for d in range(centre_d - 1, centre_d + 2):
                value = _correlation(left, right, u, v, u - d, v + row, side)
                if value > best:
                    best, best_d, best_row = value, d, row
        result[k, 0], result[k, 1], result[k, 2], result[k, 3] = best_d, best_row, best, second
    return result


@njit(cache=True, nogil=True)
def _align(left: Bytes, right: Bytes, starts: Array, radius: int, steps: int) -> Array:
    """(N, 3) right u, v [px] and the final correlation of (N, 4) integer left u, v and first right u, v.

    Gauss-Newton on a shift in both axes and a shear du/dv (a road's disparity grows down the patch) against
    the mean-free, gain-free patch. NaN where it leaves the picture or does not settle.
    """
    height, width = left.shape
    side = 2 * radius + 1
    area = side * side
    template = np.empty(area, np.float64)
    jacobian = np.empty((area, 3), np.float64)
    warped = np.empty(area, np.float64)
    result = np.full((len(starts), 3), np.nan)
    for k in range(len(starts)):
        u, v = int(starts[k, 0]), int(starts[k, 1])
        if u < radius + 1 or v < radius + 1 or u >= width - radius - 1 or v >= height - radius - 1:
            continue
        mean = 0.0
        for y in range(-radius, radius + 1):
            for x in range(-radius, radius + 1):
                i = (y + radius) * side + x + radius
                template[i] = left[v + y, u + x]
                mean += template[i]
                gx = 0.5 * (float(left[v + y, u + x + 1]) - float(left[v + y, u + x - 1]))
                gy = 0.5 * (float(left[v + y + 1, u + x]) - float(left[v + y - 1, u + x]))
                jacobian[i, 0], jacobian[i, 1], jacobian[i, 2] = gx, gy, gx * y
        mean /= area
        power = 0.0
        for i in range(area):
            template[i] -= mean
            power += template[i] * template[i]
        normal, inverse = np.zeros((3, 3)), np.eye(3)
        column_mean = np.zeros(3)
        for i in range(area):
            for a in range(3):
                column_mean[a] += jacobian[i, a] / area
        for i in range(area):
            for a in range(3):
                jacobian[i, a] -= column_mean[a]
        for i in range(area):
            for a in range(3):
                for b in range(a, 3):
                    normal[a, b] += jacobian[i, a] * jacobian[i, b]
        normal[1, 0], normal[2, 0], normal[2, 1] = normal[0, 1], normal[0, 2], normal[1, 2]
        # A shear needs a pull towards zero: patches with one dominant edge cannot tell it from a shift.
        normal[2, 2] += 0.05 * normal[2, 2] + 1e-6
        if abs(solve_square(normal, inverse)) < 1e-3 or power < area:
            continue
        ur, vr, shear = starts[k, 2], starts[k, 3], 0.0
        correlation, settled = 0.0, False
        for _ in range(steps):
            reach_u = radius * (1.0 + abs(shear)) + 1.0
            if ur < reach_u or vr < radius + 1 or ur >= width - 1 - reach_u or vr >= height - radius - 2:
                break
            mean_r, power_r, cross = 0.0, 0.0, 0.0
            v_floor = int(np.floor(vr))
            fv = vr - v_floor
            for y in range(-radius, radius + 1):
                start = ur + shear * y
                u_floor = int(np.floor(start))
                fu = start - u_floor
                for x in range(-radius, radius + 1):
                    p, q = v_floor + y, u_floor + x
                    top = (1.0 - fu) * right[p, q] + fu * right[p, q + 1]
                    bottom = (1.0 - fu) * right[p + 1, q] + fu * right[p + 1, q + 1]
                    value = (1.0 - fv) * top + fv * bottom
                    warped[(y + radius) * side + x + radius] = value
                    mean_r += value
            mean_r /= area
            for i in range(area):
                warped[i] -= mean_r
                power_r += warped[i] * warped[i]
                cross += warped[i] * template[i]
            if power_r < area:
                break
            correlation = cross / np.sqrt(power * power_r)
            gain = power / max(cross, 1e-3 * power)
            s0, s1, s2 = 0.0, 0.0, 0.0
            for i in range(area):
                error = template[i] - gain * warped[i]
                s0 += jacobian[i, 0] * error
                s1 += jacobian[i, 1] * error
                s2 += jacobian[i, 2] * error
            du = inverse[0, 0] * s0 + inverse[0, 1] * s1 + inverse[0, 2] * s2
            dv = inverse[1, 0] * s0 + inverse[1, 1] * s1 + inverse[1, 2] * s2
            ur += du
            vr += dv
            shear += inverse[2, 0] * s0 + inverse[2, 1] * s1 + inverse[2, 2] * s2
            if abs(shear) > 0.8 or abs(ur - starts[k, 2]) > 4.0 or abs(vr - starts[k, 3]) > 4.0:
                break
            if abs(du) < 0.01 and abs(dv) < 0.01:
                settled = True
                break
        if settled:
            result[k, 0], result[k, 1], result[k, 2] = ur, vr, correlation
    return result


def _half(image: Bytes) -> Bytes:
    return np.asarray(cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _smooth(image: Bytes) -> Bytes:
    return np.asarray(cv2.GaussianBlur(image, (3, 3), 0), dtype=np.uint8)


def row_matches(
    left: Bytes,
    right: Bytes,
    farthest_px: float,
    nearest_px: float,
    rows_px: int = 0,
    thorough: bool = False,
    config: RowMatchesConfig | None = None,
) -> RowMatches:
    """Match corners of the left picture in the right one, rows free.

    left, right: (H, W) uint8. farthest_px .. nearest_px: raw disparities searched [px], may start below zero.
    rows_px: rows searched up and down [px]; what is found is then aligned to a fraction of a pixel, so that
    0 still bears rows that are three pixels apart. thorough: all corners beyond infinity, else a third.
    """
    config = config or RowMatchesConfig()
    reach = config.coarse_half_px
    half_left, half_right = _half(left), _half(right)
    strength = np.asarray(cv2.cornerMinEigenVal(half_left, 3), dtype=np.float32)
    cell = max(int(np.sqrt(strength.size / config.cells)), 8)
    corners = _corners(strength, cell, reach + 2, 1e-4)
    low, high = int(np.floor(farthest_px / 2)), int(np.ceil(nearest_px / 2))
    found = _search(half_left, half_right, corners, reach, low, high, rows_px // 2, 1 if thorough else 3)
    clear = (found[:, 2] > config.clear) & (found[:, 3] < found[:, 2] - config.clear_of_others)
    disparity, row = 2.0 * found[clear, 0], 2.0 * found[clear, 1]
    starts = np.empty((int(clear.sum()), 4))
    starts[:, :2] = 2.0 * corners[clear]
    starts[:, 2] = starts[:, 0] - disparity
    starts[:, 3] = starts[:, 1] + row
    # Linear interpolation reads sharp pictures a few hundredths of a pixel towards the pixel grid.
    aligned = _align(_smooth(left), _smooth(right), starts, config.fine_radius_px, config.steps)
    good = aligned[:, 2] > config.aligned
    points = np.concatenate([starts[good, :2], aligned[good, :2]], axis=1)
    return RowMatches(points, len(corners), disparity)
