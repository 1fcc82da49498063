"""Small patches found again: in the next left picture (two unknowns) and in the right one (disparity).

Both are inverse-compositional Gauss-Newton: the template's gradients and their matrix stay fixed, and the
other picture's patch is brought to the template's mean and contrast before it is compared, so exposure and
shade do not matter.

Pictures of a pyramid are 2x2 means of the level below, so full-size u is (u + 0.5) / 2^level - 0.5 there.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from stereocalib_core.config.tracks import PatchConfig
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.small_algebra import FAST

Image = NDArray[np.uint8]

_SIZES = PatchConfig()
HALF, HALF_U, HALF_V = _SIZES.half_px, _SIZES.row_half_u_px, _SIZES.row_half_v_px
"""Compiled into the loops below, whose speed lives on them."""


@njit(cache=True, nogil=True, fastmath=FAST)
def _sample(
    image: Image, u: float, v: float, axu: float, axv: float, ayu: float, ayv: float, out: Array
) -> bool:
    """Fill out (n, n) with the patch around (u, v), one step of columns being (axu, axv), of rows (ayu, ayv).

    Bilinear; False where the patch leaves the image.
    """
    n = out.shape[0]
    h = (n - 1) // 2
    reach_u, reach_v = h * (abs(axu) + abs(ayu)), h * (abs(axv) + abs(ayv))
    if not (u - reach_u >= 0.0 and v - reach_v >= 0.0):
        return False
    if not (u + reach_u < image.shape[1] - 1 and v + reach_v < image.shape[0] - 1):
        return False
    for r in range(n):
        x = u - h * axu + (r - h) * ayu
        y = v - h * axv + (r - h) * ayv
        for c in range(n):
            i, j = int(y), int(x)
            fy, fx = y - i, x - j
            top = image[i, j] + fx * (np.float64(image[i, j + 1]) - image[i, j])
            low = image[i + 1, j] + fx * (np.float64(image[i + 1, j + 1]) - image[i + 1, j])
            out[r, c] = top + fy * (low - top)
            x += axu
            y += axv
    return True


@njit(cache=True, nogil=True, fastmath=FAST)
def _normalise(patch: Array, margin: int) -> float:
    """Bring the inner part of a patch to zero mean and unit deviation; returns the deviation before."""
    n = patch.shape[0]
    total = 0.0
    square = 0.0
    for r in range(margin, n - margin):
        for c in range(margin, n - margin):
            total += patch[r, c]
            square += patch[r, c] * patch[r, c]
    count = (n - 2 * margin) ** 2
    mean = total / count
    deviation = np.sqrt(max(square / count - mean * mean, 1e-12))
    scale = 1.0 / deviation
    for r in range(n):
        for c in range(n):
            patch[r, c] = (patch[r, c] - mean) * scale
    return deviation


@njit(cache=True, nogil=True, fastmath=FAST)
def _align(
    template_image: Image,
    image: Image,
    tu: float,
    tv: float,
    guess: Array,
    affine: Array,
    iterations: int,
    enough: float,
    min_contrast: float,
    template: Array,
    patch: Array,
) -> float:
    """Move `guess` (2,) to where the patch around (tu, tv) is seen in `image`; all in pixels of one level.

    affine (4,): d(u', v') / d(u, v), row by row. `enough`: step [px] that ends the iteration. min_contrast:
    standard deviation [grey levels] below which a patch shows nothing.
    Returns the correlation, or -1 where it is lost.
    """
    n = 2 * HALF + 1
    if not _sample(template_image, tu, tv, 1.0, 0.0, 0.0, 1.0, template):
        return -1.0
    if _normalise(template, 1) < min_contrast:
        return -1.0
    h00 = h01 = h11 = 1e-9
    for r in range(n):
        for c in range(n):
            gx = 0.5 * (template[r + 1, c + 2] - template[r + 1, c])
            gy = 0.5 * (template[r + 2, c + 1] - template[r, c + 1])
            h00 += gx * gx
            h01 += gx * gy
            h11 += gy * gy
    determinant = h00 * h11 - h01 * h01
    if determinant < 1e-3 * h00 * h11 or min(h00, h11) < 0.5:
        return -1.0
    correlation = -1.0
    for _ in range(iterations):
        if not _sample(image, guess[0], guess[1], affine[0], affine[2], affine[1], affine[3], patch):
            return -1.0
        if _normalise(patch, 0) < 0.4 * min_contrast:
            return -1.0
        b0 = b1 = product = 0.0
        for r in range(n):
            for c in range(n):
                gx = 0.5 * (template[r + 1, c + 2] - template[r + 1, c])
                gy = 0.5 * (template[r + 2, c + 1] - template[r, c + 1])
                difference = patch[r, c] - template[r + 1, c + 1]
                b0 += gx * difference
                b1 += gy * difference
                product += patch[r, c] * template[r + 1, c + 1]
        correlation = product / (n * n)
        eu = (h11 * b0 - h01 * b1) / determinant
        ev = (h00 * b1 - h01 * b0) / determinant
        size = np.sqrt(eu * eu + ev * ev)
        if size > 2.0:
            eu, ev = 2.0 * eu / size, 2.0 * ev / size
        guess[0] -= affine[0] * eu + affine[1] * ev
        guess[1] -= affine[2] * eu + affine[3] * ev
        if size < enough:
            break
    return correlation


@njit(cache=True, nogil=True)
def follow(
    before: tuple[Image, Image, Image],
    after: tuple[Image, Image, Image],
    points: Array,
    predicted: Array,
    affine: Array,
    coarsest: int,
    min_correlation: float,
    max_return_px: float,
    min_contrast: float,
) -> tuple[Array, NDArray[np.bool_]]:
    """Points (N, 2) of one picture in the next, coarse to fine, and back again.

    before, after: pyramids, full size first. predicted: (N, 2) [px]. affine: (N, 4). coarsest: first level.
    Returns (N, 2) [px] and which came back to within `max_return_px` from a start one pixel aside.
    """
    count = len(points)
    found = np.zeros((count, 2))
    ok = np.zeros(count, dtype=np.bool_)
    for k in range(count):
        template = np.empty((2 * HALF + 3, 2 * HALF + 3))
        patch = np.empty((2 * HALF + 1, 2 * HALF + 1))
        guess = np.empty(2)
        here = predicted[k].copy()
        A = affine[k]
        correlation = -1.0
        for step in range(coarsest + 1):
            level = coarsest - step
            scale = 1.0 / (1 << level)
            guess[0] = (here[0] + 0.5) * scale - 0.5
            guess[1] = (here[1] + 0.5) * scale - 0.5
            tu = (points[k, 0] + 0.5) * scale - 0.5
            tv = (points[k, 1] + 0.5) * scale - 0.5
            if level == 2:
                correlation = _align(
                    before[2], after[2], tu, tv, guess, A, 6, 0.1, min_contrast, template, patch
                )
            elif level == 1:
                correlation = _align(
                    before[1], after[1], tu, tv, guess, A, 6, 0.1, min_contrast, template, patch
                )
            else:
                correlation = _align(
                    before[0], after[0], tu, tv, guess, A, 8, 0.01, min_contrast, template, patch
                )
            if correlation > 0.3:
                here[0] = (guess[0] + 0.5) / scale - 0.5
                here[1] = (guess[1] + 0.5) / scale - 0.5
        if correlation < min_correlation:
            continue
        determinant = A[0] * A[3] - A[1] * A[2]
        back = np.array([A[3], -A[1], -A[2], A[0]]) / determinant
        guess[0], guess[1] = points[k, 0] + 0.7, points[k, 1] + 0.7
        if (
            _align(after[0], before[0], here[0], here[1], guess, back, 6, 0.1, min_contrast, template, patch)
            < min_correlation
        ):
            continue
        if (guess[0] - points[k, 0]) ** 2 + (guess[1] - points[k, 1]) ** 2 < max_return_px**2:
            found[k] = here
            ok[k] = True
    return found, ok


@njit(cache=True, nogil=True, fastmath=FAST)
def _row_template(left: Image, u: int, v: int, values: Array, gradients: Array) -> tuple[float, float]:
    """Fill the patch around left pixel (u, v), without its mean, and its gradients along u; returns the sum of
    squares of either."""
    n_v, n_u = values.shape
    mean = 0.0
    for r in range(n_v):
        for c in range(n_u):
            i, j = v + r - HALF_V, u + c - HALF_U
            values[r, c] = left[i, j]
            gradients[r, c] = 0.5 * (np.float64(left[i, j + 1]) - np.float64(left[i, j - 1]))
            mean += values[r, c]
    mean /= n_u * n_v
    squares = steepness = 0.0
    for r in range(n_v):
        for c in range(n_u):
            values[r, c] -= mean
            squares += values[r, c] * values[r, c]
            steepness += gradients[r, c] * gradients[r, c]
    return squares, steepness


@njit(cache=True, nogil=True, fastmath=FAST)
def _match_row(
    right: Image,
    u: int,
    v: int,
    guess: float,
    slope_v: float,
    values: Array,
    gradients: Array,
    squares: float,
    steepness: float,
    min_contrast: float,
) -> tuple[float, float]:
    """Raw disparity of a template and the correlation (-1 = lost); the right patch is sheared along the rows.

    Each row is read between its pixels by cubic convolution. The shear across columns is left out: a road's is
    a few hundredths of a pixel over the patch, as much to the left as to the right.
    """
    n_v, n_u = values.shape
    count = n_u * n_v
    width = right.shape[1]
    disparity = guess
    correlation = -1.0
    for _ in range(8):
        reach = HALF_V * abs(slope_v)
        if u - HALF_U - disparity - reach < 2.0 or u + HALF_U - disparity + reach > width - 4.0:
            return disparity, -1.0
        total = square = product = b = gradient_sum = 0.0
        for r in range(n_v):
            x = u - HALF_U - disparity - slope_v * (r - HALF_V)
            i = int(x)
            t = x - i
            w0 = 0.5 * t * (-1.0 + t * (2.0 - t))
            w1 = 1.0 + 0.5 * t * t * (-5.0 + 3.0 * t)
            w2 = 0.5 * t * (1.0 + t * (4.0 - 3.0 * t))
            w3 = 0.5 * t * t * (t - 1.0)
            row = right[v + r - HALF_V]
            for c in range(n_u):
                k = i + c
                other = w0 * row[k - 1] + w1 * row[k] + w2 * row[k + 1] + w3 * row[k + 2]
                total += other
                square += other * other
                product += other * values[r, c]
                b += other * gradients[r, c]
                gradient_sum += gradients[r, c]
        mean = total / count
        other_squares = square - mean * total
        if other_squares < count * (0.4 * min_contrast) ** 2:
            return disparity, -1.0
        correlation = product / np.sqrt(squares * other_squares)
        # gradient . (gain (right - mean) - (left - mean)): a larger disparity moves the right patch to the left
        error = np.sqrt(squares / other_squares) * (b - gradient_sum * mean)
        for r in range(n_v):
            for c in range(n_u):
                error -= gradients[r, c] * values[r, c]
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
    min_correlation: float,
    reach_px: float,
    min_contrast: float,
) -> Array:
    """(N,) raw disparity u_left - u_right [px] of left points (N, 2), NaN where it is lost.

    guess: (N,) within a pixel or two. slopes: (N, 2) d disparity / d u, d v of the surface under the patch.
    The match is made at the nearest whole pixel and carried to the point along the surface.
    """
    result = np.full(len(points), np.nan)
    height, width = left.shape
    values = np.empty((2 * HALF_V + 1, 2 * HALF_U + 1))
    gradients = np.empty((2 * HALF_V + 1, 2 * HALF_U + 1))
    for k in range(len(points)):
        # NaN or infinity is no place in a picture
        if not np.isfinite(points[k, 0] + points[k, 1] + guess[k] + slopes[k, 0] + slopes[k, 1]):
            continue
        u, v = int(np.round(points[k, 0])), int(np.round(points[k, 1]))
        if u < HALF_U + 2 or v < HALF_V or u + HALF_U + 2 >= width or v + HALF_V >= height:
            continue
        squares, steepness = _row_template(left, u, v, values, gradients)
        if squares < values.size * min_contrast**2 or steepness < values.size:
            continue
        carry = slopes[k, 0] * (points[k, 0] - u) + slopes[k, 1] * (points[k, 1] - v)
        start = guess[k] - carry
        disparity, correlation = _match_row(
            right, u, v, start, slopes[k, 1], values, gradients, squares, steepness, min_contrast
        )
        if correlation >= min_correlation and abs(disparity - start) < reach_px:
            result[k] = disparity + carry
    return result
