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
        u, v = int(np.rint(points[k, 0])), int(np.rint(points[k, 1] + down[k]))
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
def row_leans(left: Image, right: Image, points: Array, matched: Array, slopes: Array, down: Array) -> Array:
    """(N,) [px/px] how `match_rows` misreads left points (N, 2) where the rows of the pair are not as it takes them.

    matched: (N,) raw disparities that it gave, NaN = none. slopes, down: as it was given them. A right picture whose
    rows lie lower by a small d than that shows, along the row that is read, what belongs to d above. Least squares over
    the patch then find a disparity that is less by d times sum(g R_v) / sum(g R_u), g the gradient of the template and
    R the right patch: the slope of the surface, and that of slanted edges; nothing for upright edges of a wall. The
    left picture's own gradients would not do: the noise in sum(g^2) makes leans of a road half as large as they are.
    A road's texture is fine from row to row, so that R_v is taken over five rows.
    """
    result = np.zeros(len(points))
    height, width = left.shape
    values = np.empty((2 * HALF_V + 1, 2 * HALF_U + 1), np.float32)
    gradients = np.empty((2 * HALF_V + 1, 2 * HALF_U + 1), np.float32)
    one, four_thirds, sixth = np.float32(1.0), np.float32(4.0 / 3.0), np.float32(1.0 / 6.0)
    for k in range(len(points)):
        if not np.isfinite(points[k, 0] + points[k, 1] + matched[k] + slopes[k, 0] + slopes[k, 1] + down[k]):
            continue
        u, v = int(np.rint(points[k, 0])), int(np.rint(points[k, 1] + down[k]))
        there = v - down[k]
        first = int(np.floor(there))
        if u < HALF_U + 2 or u + HALF_U + 2 >= width or v < HALF_V + 2 or v + HALF_V + 2 >= height:
            continue
        if first - 1 < HALF_V or first + 2 + HALF_V >= height:
            continue
        _, _, steepness = _row_template(left, u, first, there - first, values, gradients)
        carry = slopes[k, 0] * (points[k, 0] - u) + slopes[k, 1] * (points[k, 1] - there)
        start = u - HALF_U - (matched[k] - carry)
        reach = HALF_V * abs(slopes[k, 1])
        if start - reach < 2.0 or start + 2 * HALF_U + reach > width - 4.0:
            continue
        steep = both = np.float32(0.0)
        for r in range(0, 2 * HALF_V + 1, 2):  # every other row says the same at half of the time
            x = start - slopes[k, 1] * (r - HALF_V)
            i = int(x)
            w = np.float32(x - i)
            columns = slice(i - 1, i + 2 * HALF_U + 3)
            row = v + r - HALF_V
            here = right[row, columns]
            above, below = right[row - 1, columns], right[row + 1, columns]
            top, bottom = right[row - 2, columns], right[row + 2, columns]
            for c in range(2 * HALF_U + 1):
                x0, x1 = np.float32(here[c]), np.float32(here[c + 1])
                x2, x3 = np.float32(here[c + 2]), np.float32(here[c + 3])
                along = (one - w) * (x2 - x0) + w * (x3 - x1)
                near = (one - w) * (np.float32(below[c + 1]) - np.float32(above[c + 1]))
                near += w * (np.float32(below[c + 2]) - np.float32(above[c + 2]))
                wide = (one - w) * (np.float32(bottom[c + 1]) - np.float32(top[c + 1]))
                wide += w * (np.float32(bottom[c + 2]) - np.float32(top[c + 2]))
                steep += gradients[r, c] * along
                both += gradients[r, c] * (four_thirds * near - sixth * wide)
        # twice the gradients; a patch that is half something else shows no lean
        if steep > np.float32(0.2 * steepness):
            result[k] = both / steep
    return result
