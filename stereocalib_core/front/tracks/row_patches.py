"""Small patches found again along a row of the right picture: disparities of single points.

Inverse-compositional Gauss-Newton as in `patches`, with one unknown: the template's gradients stay fixed, and the right
picture's patch is brought to the template's mean and contrast before it is compared.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from stereocalib_core.config.tracks import PatchConfig
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.small_algebra import FAST

Image = NDArray[np.uint8]
Floats = NDArray[np.float32]

_SIZES = PatchConfig()
HALF_U, HALF_V = _SIZES.row_half_u_px, _SIZES.row_half_v_px
"""Compiled into the loops below, whose speed lives on them."""


@njit(cache=True, nogil=True, fastmath=FAST)
def _cubic(t: float) -> tuple[np.float32, np.float32, np.float32, np.float32]:
    """Weights of four neighbours, t in 0 ... 1 past the second (cubic convolution, Keys 1981)."""
    return (
        np.float32(0.5 * t * (-1.0 + t * (2.0 - t))),
        np.float32(1.0 + 0.5 * t * t * (-5.0 + 3.0 * t)),
        np.float32(0.5 * t * (1.0 + t * (4.0 - 3.0 * t))),
        np.float32(0.5 * t * t * (t - 1.0)),
    )


@njit(cache=True, nogil=True, fastmath=FAST)
def _row_template(
    left: Image, u: int, v: int, past: float, values: Floats, gradients: Floats
) -> tuple[float, float, float]:
    """Fill the patch around column u and row v + past of the left picture, past in 0 ... 1, without its mean, and its
    gradients along u; returns the mean, and the sum of squares of either. Cubic between rows."""
    n_v, n_u = values.shape
    mean = np.float32(0.0)
    half = np.float32(0.5)
    w0, w1, w2, w3 = _cubic(past)
    line = np.empty(n_u + 2, np.float32)
    for r in range(n_v):
        columns = slice(u - HALF_U - 1, u + HALF_U + 2)
        here = left[v + r - HALF_V, columns]
        if past == 0.0:
            for c in range(n_u + 2):
                line[c] = np.float32(here[c])
        else:
            above, below = left[v + r - HALF_V - 1, columns], left[v + r - HALF_V + 1, columns]
            last = left[v + r - HALF_V + 2, columns]
            for c in range(n_u + 2):
                value = w0 * np.float32(above[c]) + w1 * np.float32(here[c])
                line[c] = value + w2 * np.float32(below[c]) + w3 * np.float32(last[c])
        for c in range(n_u):
            values[r, c] = line[c + 1]
            gradients[r, c] = half * (line[c + 2] - line[c])
            mean += values[r, c]
    mean /= np.float32(n_u * n_v)
    squares = steepness = np.float32(0.0)
    for r in range(n_v):
        for c in range(n_u):
            values[r, c] -= mean
            squares += values[r, c] * values[r, c]
            steepness += gradients[r, c] * gradients[r, c]
    return float(mean), float(squares), float(steepness)


@njit(cache=True, nogil=True, fastmath=FAST)
def _match_row(
    right: Image,
    u: int,
    v: int,
    guess: float,
    slope_v: float,
    values: Floats,
    gradients: Floats,
    sums: tuple[float, float, float],
    min_contrast: float,
) -> tuple[float, float]:
    """Raw disparity of a template and the correlation (-1 = lost); the right patch is sheared along the rows.

    sums: of the template, as `_row_template` gives them. Each row is read between its pixels by cubic convolution. The
    shear across columns is left out: a road's is a few hundredths of a pixel over the patch, as much to the left as to
    the right.
    """
    n_v, n_u = values.shape
    count = n_u * n_v
    width = right.shape[1]
    mean_left, squares, steepness = sums
    off = np.float32(mean_left)
    own = gradient_sum = np.float32(0.0)
    for r in range(n_v):
        for c in range(n_u):
            own += gradients[r, c] * values[r, c]
            gradient_sum += gradients[r, c]
    disparity = guess
    correlation = -1.0
    for _ in range(8):
        reach = HALF_V * abs(slope_v)
        if u - HALF_U - disparity - reach < 2.0 or u + HALF_U - disparity + reach > width - 4.0:
            return disparity, -1.0
        total = square = product = b = np.float32(0.0)
        for r in range(n_v):
            x = u - HALF_U - disparity - slope_v * (r - HALF_V)
            i = int(x)
            w0, w1, w2, w3 = _cubic(x - i)
            row = right[v + r - HALF_V, i - 1 : i + n_u + 2]
            for c in range(n_u):
                other = w0 * np.float32(row[c]) + w1 * np.float32(row[c + 1]) - off
                other += w2 * np.float32(row[c + 2]) + w3 * np.float32(row[c + 3])
                total += other
                square += other * other
                product += other * values[r, c]
                b += other * gradients[r, c]
        mean = float(total) / count
        other_squares = square - mean * total
        if other_squares < count * (0.4 * min_contrast) ** 2:
            return disparity, -1.0
        correlation = product / np.sqrt(squares * other_squares)
        # gradient . (gain (right - mean) - (left - mean)): a larger disparity moves the right patch to the left
        error = np.sqrt(squares / other_squares) * (b - gradient_sum * mean) - own
        step = min(max(error / steepness, -1.0), 1.0)
        disparity += step
        if abs(step) < 0.01:
            break
    return disparity, correlation


@njit(cache=True, nogil=True)
def match_rows(
    left: Image,
    right: Image,
    points: Array,
    guess: Array,
    slopes: Array,
    down: Array,
    min_correlation: float,
    reach_px: float,
    min_contrast: float,
) -> Array:
    """(N,) raw disparity u_left - u_right [px] of left points (N, 2), NaN where it is lost.

    guess: (N,) within a pixel or two. slopes: (N, 2) d disparity / d u, d v of the surface under the patch.
    down: (N,) [px] right row minus left row, where the rows of the pair are not true. Along rows that part, a slanted
    edge is found elsewhere than it is (`row_leans`), and lines that run towards the vanishing point slant alike.
    The match is made at the nearest whole pixel of the right row and carried to the point along the surface.
    """
    result = np.full(len(points), np.nan)
    height, width = left.shape
    values = np.empty((2 * HALF_V + 1, 2 * HALF_U + 1), np.float32)
    gradients = np.empty((2 * HALF_V + 1, 2 * HALF_U + 1), np.float32)
    for k in range(len(points)):
        # NaN or infinity is no place in a picture
        sound = points[k, 0] + points[k, 1] + guess[k] + slopes[k, 0] + slopes[k, 1] + down[k]
        if not np.isfinite(sound):
            continue
        u, v = int(np.round(points[k, 0])), int(np.round(points[k, 1] + down[k]))
        # the left picture is read between its rows, once, so that the right one is read along its own
        there = v - down[k]
        first = int(np.floor(there))
        past = there - first
        highest, lowest = (v, v) if past == 0.0 else (min(v, first - 1), max(v, first + 2))
        if u < HALF_U + 2 or u + HALF_U + 2 >= width or highest < HALF_V or lowest + HALF_V >= height:
            continue
        sums = _row_template(left, u, first, past, values, gradients)
        _, squares, steepness = sums
        if squares < values.size * min_contrast**2 or steepness < values.size:
            continue
        carry = slopes[k, 0] * (points[k, 0] - u) + slopes[k, 1] * (points[k, 1] - there)
        start = guess[k] - carry
        disparity, correlation = _match_row(
            right, u, v, start, slopes[k, 1], values, gradients, sums, min_contrast
        )
        if correlation >= min_correlation and abs(disparity - start) < reach_px:
            result[k] = disparity + carry
    return result


@njit(cache=True, nogil=True, fastmath=FAST)
def row_leans(left: Image, points: Array) -> Array:
    """(N,) [px/px] how `match_rows` misreads points (N, 2) where the rows of the pair are not true.

    A right picture whose rows lie lower by a small `down` than the match takes them to shows the patch L as L(v - down)
    along the row that is read. Least squares over the patch then find a disparity that is less by down times
    sum(L_u L_v) / sum(L_u^2): nothing for upright edges, and their slope for slanted ones.
    """
    result = np.zeros(len(points))
    height, width = left.shape
    for k in range(len(points)):
        u, v = int(np.round(points[k, 0])), int(np.round(points[k, 1]))
        if u <= HALF_U or v <= HALF_V or u + HALF_U + 1 >= width or v + HALF_V + 1 >= height:
            continue
        steep = both = np.float32(0.0)
        for r in range(-HALF_V, HALF_V + 1):
            above = left[v + r - 1, u - HALF_U : u + HALF_U + 1]
            here = left[v + r, u - HALF_U - 1 : u + HALF_U + 2]
            below = left[v + r + 1, u - HALF_U : u + HALF_U + 1]
            for c in range(2 * HALF_U + 1):
                x = np.float32(here[c + 2]) - np.float32(here[c])
                y = np.float32(below[c]) - np.float32(above[c])
                steep += x * x
                both += x * y
        if steep > 0.0:
            result[k] = both / steep
    return result
