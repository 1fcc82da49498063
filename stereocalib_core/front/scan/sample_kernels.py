"""The loops of `scan_sample`, compiled: over a scan, over the rows of a disparity map, and over its squares."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


Lens = tuple[float, float, float, float, float, float]
"""Width, height, focal length, cx, cy [px], focal length times baseline [m px]."""


@njit(cache=True, nogil=True)
def in_view(
    scan: NDArray[np.float32], T: Array, camera: Lens, margin: float, nearest: float
) -> tuple[NDArray[np.float32], Array]:
    """(N, 4) points to those that the left picture may show, (M, 3) float32, in their order, and their (M, 3) u, v and
    disparity [px].

    margin: how far outside the picture still counts [px]. nearest: least distance ahead [m].
    """
    width, height, f, cx, cy, fb = camera
    found = np.empty((len(scan), 3), np.float32)
    seen = np.empty((len(scan), 3))
    count = 0
    for i in range(len(scan)):
        x, y, z = float(scan[i, 0]), float(scan[i, 1]), float(scan[i, 2])
        ahead = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
        if not ahead > nearest:
            continue
        side = f * (T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]) + cx * ahead
        down = f * (T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]) + cy * ahead
        if (
            -margin * ahead < side < (width + margin) * ahead
            and -margin * ahead < down < (height + margin) * ahead
        ):
            found[count, 0], found[count, 1], found[count, 2] = x, y, z
            seen[count, 0], seen[count, 1], seen[count, 2] = side / ahead, down / ahead, fb / ahead
            count += 1
    return found[:count].copy(), seen[:count].copy()


@njit(cache=True, nogil=True)
def neighbours_share_beams(points: NDArray[np.float32], tilt: float) -> bool:
    """Whether most of (M, 3) points have the elevation (sine, within `tilt`) of the one before them."""
    same, before = 0, 0.0
    for i in range(len(points)):
        x, y, z = float(points[i, 0]), float(points[i, 1]), float(points[i, 2])
        rise = z / math.sqrt(x * x + y * y + z * z)
        if i > 0 and abs(rise - before) < tilt:
            same += 1
        before = rise
    return 2 * same > len(points) - 1


@njit(cache=True, nogil=True)
def beam_edges(
    points: NDArray[np.float32],
    T: Array,
    focal_baseline: float,
    least: float,
    jump: tuple[float, float],
    gap: float,
    tilt: float,
) -> Array:
    """(K, 4) x, y, z [m] where a beam leaves a near thing, in the LiDAR's frame, and the side on which the thing lies.

    points: (M, 3), beam after beam. least: smallest disparity of a near thing [px].
    jump: least change of disparity between neighbours [px] and as a share of the nearer one's.
    The edge is put half way between the two beams, at the nearer one's range: there it is for certain within half
    a step. Side +1: the thing lies at lesser azimuth, right of its edge.
    """
    found = np.empty((len(points), 4))
    count = 0
    ahead1 = 0.0
    for i in range(len(points)):
        ahead0 = ahead1
        x1, y1, z1 = float(points[i, 0]), float(points[i, 1]), float(points[i, 2])
        ahead1 = T[2, 0] * x1 + T[2, 1] * y1 + T[2, 2] * z1 + T[2, 3]
        if i == 0:
            continue
        near = min(ahead0, ahead1)
        disparity, beyond = focal_baseline / near, focal_baseline / max(ahead0, ahead1)
        if disparity < least or disparity - beyond < max(jump[0], jump[1] * disparity):
            continue
        x0, y0, z0 = float(points[i - 1, 0]), float(points[i - 1, 1]), float(points[i - 1, 2])
        r0 = math.sqrt(x0 * x0 + y0 * y0 + z0 * z0)
        r1 = math.sqrt(x1 * x1 + y1 * y1 + z1 * z1)
        step = math.atan2(y1, x1) - math.atan2(y0, x0)
        if abs(step) > gap or abs(z0 / r0 - z1 / r1) > tilt:
            continue
        turn = 0.5 * step
        x, y, z = x0, y0, z0
        if ahead1 < ahead0:
            x, y, z, turn = x1, y1, z1, -turn
        c, s = math.cos(turn), math.sin(turn)
        found[count, 0], found[count, 1], found[count, 2] = c * x - s * y, s * x + c * y, z
        found[count, 3] = 1.0 if turn > 0.0 else -1.0
        count += 1
    return found[:count].copy()


@njit(cache=True, nogil=True)
def _middle(a: float, b: float, c: float) -> float:
    return max(min(a, b), min(max(a, b), c))


@njit(cache=True, nogil=True)
def _contrast(picture: NDArray[np.uint8], u: int, v: int) -> float:
    """|dI/du| [grey/px] at u over the four rows about v + 0.5."""
    total = 0.0
    for row in range(v - 1, v + 3):
        total += float(picture[row, u + 1]) - float(picture[row, u - 1])
    return abs(total) / 8.0


@njit(cache=True, nogil=True)
def picture_edges(
    disparity: NDArray[np.float32],
    step: int,
    picture: NDArray[np.uint8],
    row_step: int,
    least: float,
    jump: tuple[float, float],
    reach: int,
) -> Array:
    """(M, 5) u, v [px], disparity of the near side [px], side and contrast [grey/px] where the disparity breaks along a
    row, in order of v; u is that of the strongest contrast of the picture within `reach` of the break.

    Side +1: the near side lies right of the edge. disparity: (h, w) on a grid of `step` pixels, NaN = none.
    """
    rows, columns = disparity.shape
    height, width = picture.shape
    found = np.empty((rows // row_step + 1, columns, 5))
    counts = np.zeros(rows // row_step + 1, np.int64)
    breaks = np.empty(columns)
    total = 0
    for n, i in enumerate(range(1, rows - 1, row_step)):
        v = (i + 0.5) * step - 0.5
        row = int(v)
        if row < 1 or row > height - 3:
            continue
        breaks[:] = 0.0
        for j in range(2, columns - 2):
            left = _middle(disparity[i - 1, j - 1], disparity[i, j - 1], disparity[i + 1, j - 1])
            right = _middle(disparity[i - 1, j + 1], disparity[i, j + 1], disparity[i + 1, j + 1])
            near = max(left, right)
            # a comparison with NaN is false: no break where there is no disparity
            if near > least and min(left, right) > 0.0 and abs(right - left) > max(jump[0], jump[1] * near):
                breaks[j] = right - left
        for j in range(2, columns - 2):
            size = abs(breaks[j])
            if size == 0.0:
                continue
            largest = True
            for k in range(max(j - 3, 2), min(j + 4, columns - 2)):
                other = abs(breaks[k])
                if other > size or (other == size and k < j):
                    largest = False
            side = 1.0 if breaks[j] > 0.0 else -1.0
            near = disparity[i, j + int(2 * side)]
            if not largest or not near > least:
                continue
            middle = int((j + 0.5) * step - 0.5)
            best, at = 0.0, -1
            for u in range(max(middle - reach, 2), min(middle + reach + 2, width - 2)):
                contrast = _contrast(picture, u, row)
                if contrast > best:
                    best, at = contrast, u
            if at < 0:
                continue
            before, after = _contrast(picture, at - 1, row), _contrast(picture, at + 1, row)
            curve = before - 2.0 * best + after
            shift = 0.5 * (before - after) / curve if curve < -1e-6 else 0.0
            edge = found[n, counts[n]]
            edge[0], edge[1], edge[2] = at + min(max(shift, -0.5), 0.5), v, near
            edge[3], edge[4] = side, best
            counts[n] += 1
            total += 1
    result = np.empty((total, 5))
    at = 0
    for n in range(len(counts)):
        result[at : at + counts[n]] = found[n, : counts[n]]
        at += counts[n]
    return result


@njit(cache=True, nogil=True)
def patches(
    disparity: NDArray[np.float32], step: int, size: int, share: float, most_rms: float, least: float
) -> Array:
    """(P, 5) u, v [px] of the centre, disparity there [px] and its change along u and v [px/px] of every square of
    `size` cells in which the disparity is a plane: at most `most_rms` [px] off it, known in a `share` of the cells."""
    rows, columns = disparity.shape[0] // size, disparity.shape[1] // size
    found = np.empty((rows * columns, 5))
    count = 0
    half = 0.5 * (size - 1)
    for r in range(rows):
        for c in range(columns):
            n = sx = sy = sxx = sxy = syy = sd = sdx = sdy = squares = 0.0
            for i in range(size):
                for j in range(size):
                    d = float(disparity[r * size + i, c * size + j])
                    if not d > least:
                        continue
                    x, y = j - half, i - half
                    n += 1.0
                    sx += x
                    sy += y
                    sxx += x * x
                    sxy += x * y
                    syy += y * y
                    sd += d
                    sdx += d * x
                    sdy += d * y
                    squares += d * d
            if n < max(share * size * size, 6.0):
                continue
            # about the middle of what is known, where the two slopes part from the height (Cramer's rule)
            mx, my, mean = sx / n, sy / n, sd / n
            xx, xy, yy = sxx - n * mx * mx, sxy - n * mx * my, syy - n * my * my
            dx, dy = sdx - n * mx * mean, sdy - n * my * mean
            determinant = xx * yy - xy * xy
            if not determinant > 1e-9 * xx * yy:
                continue
            along_u, along_v = (dx * yy - dy * xy) / determinant, (dy * xx - dx * xy) / determinant
            middle = mean - along_u * mx - along_v * my
            rest = squares - n * mean * mean - dx * along_u - dy * along_v
            if rest > most_rms * most_rms * n or not middle > least:
                continue
            found[count, 0] = (c * size + half + 0.5) * step - 0.5
            found[count, 1] = (r * size + half + 0.5) * step - 0.5
            found[count, 2] = middle
            found[count, 3], found[count, 4] = along_u / step, along_v / step
            count += 1
    return found[:count].copy()


@njit(cache=True, nogil=True)
def smooth_points(points: NDArray[np.float32], straight: float, gap: float, every: int) -> Array:
    """(S, 3) every `every`-th of (M, 3) points whose neighbours of the same beam, two on either side, lie on one
    straight line within `straight` [m] of range; neighbours are at most `gap` [rad] apart."""
    found = np.empty((len(points) // every + 1, 3))
    ranges = np.empty(len(points))
    for i in range(len(points)):
        x, y, z = float(points[i, 0]), float(points[i, 1]), float(points[i, 2])
        ranges[i] = math.sqrt(x * x + y * y + z * z)
    count, passed = 0, 0
    for i in range(2, len(points) - 2):
        twice = 2.0 * ranges[i]
        if (
            max(abs(ranges[i - 2] + ranges[i + 2] - twice), abs(ranges[i - 1] + ranges[i + 1] - twice))
            > straight
        ):
            continue
        a, b = points[i - 2], points[i + 2]
        across = math.hypot(float(b[0]) - float(a[0]), float(b[1]) - float(a[1]))
        if across > 4.0 * gap * ranges[i]:
            continue
        passed += 1
        if passed % every == 0:
            found[count, 0], found[count, 1], found[count, 2] = points[i, 0], points[i, 1], points[i, 2]
            count += 1
    return found[:count].copy()
