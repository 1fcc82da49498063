"""Small patches found again in the next left picture (two unknowns); in the right one: `row_patches`.

Inverse-compositional Gauss-Newton: the template's gradients and their matrix stay fixed, and the other picture's patch
is brought to the template's mean and contrast before it is compared, so exposure and shade do not matter.

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
Floats = NDArray[np.float32]
Room = tuple[NDArray[np.int32], Floats, Floats]

HALF = PatchConfig().half_px
"""Compiled into the loops below, whose speed lives on it."""


@njit(cache=True, nogil=True, fastmath=FAST)
def _template(
    image: Image, u: float, v: float, affine: Array, room: Room, parts: Floats, sums: Array
) -> bool:
    """The patch around (u, v) as it is seen through affine (4,), one step of columns being affine[0], affine[2].

    room: (2, n + 2, n + 2) which pixels, (2, ...) how far past them, and (n + 2, n + 2) what is read there. Fills parts
    (3, n, n): the patch without its mean and its gradients along the columns and the rows; sums (9,): its mean and
    deviation, the sums of either gradient, of their products uu, uv, vv, and of either with the patch. Bilinear; False
    where the patch leaves the image.
    """
    at, within, around = room
    n = 2 * HALF + 1
    h = HALF + 1
    axu, ayu, axv, ayv = affine[0], affine[1], affine[2], affine[3]
    reach_u, reach_v = h * (abs(axu) + abs(ayu)), h * (abs(axv) + abs(ayv))
    # a thousandth of a pixel more than is read: for rounding
    if not (u - reach_u >= 0.001 and v - reach_v >= 0.001):
        return False
    if not (u + reach_u < image.shape[1] - 1.001 and v + reach_v < image.shape[0] - 1.001):
        return False
    # where to read first, several at once, then the reading, which is one by one
    column, row = int(u) - 2 * HALF, int(v) - 2 * HALF
    u_here, v_here = np.float32(u - column), np.float32(v - row)
    step_uu, step_uv = np.float32(axu), np.float32(ayu)
    step_vu, step_vv = np.float32(axv), np.float32(ayv)
    for r in range(n + 2):
        x_row = u_here + np.float32(r - h) * step_uv
        y_row = v_here + np.float32(r - h) * step_vv
        for c in range(n + 2):
            x = x_row + np.float32(c - h) * step_uu
            y = y_row + np.float32(c - h) * step_vu
            i, j = np.int32(np.floor(y)), np.int32(np.floor(x))
            within[0, r, c], within[1, r, c] = x - np.float32(j), y - np.float32(i)
            at[0, r, c], at[1, r, c] = i + np.int32(row), j + np.int32(column)
    one = np.uint64(1)
    for r in range(n + 2):
        for c in range(n + 2):
            # unsigned: no index counts from the end
            p, q = np.uint64(at[0, r, c]), np.uint64(at[1, r, c])
            fx, fy = within[0, r, c], within[1, r, c]
            k00, k01 = np.float32(image[p, q]), np.float32(image[p, q + one])
            k10, k11 = np.float32(image[p + one, q]), np.float32(image[p + one, q + one])
            top = k00 + fx * (k01 - k00)
            low = k10 + fx * (k11 - k10)
            around[r, c] = top + fy * (low - top)
    total = np.float32(0.0)
    for r in range(n):
        for c in range(n):
            total += around[r + 1, c + 1]
    mean = total / np.float32(n * n)
    square = gu = gv = uu = uv = vv = np.float32(0.0)
    half = np.float32(0.5)
    for r in range(n):
        for c in range(n):
            value = around[r + 1, c + 1] - mean
            x_u = half * (around[r + 1, c + 2] - around[r + 1, c])
            x_v = half * (around[r + 2, c + 1] - around[r, c + 1])
            parts[0, r, c], parts[1, r, c], parts[2, r, c] = value, x_u, x_v
            square += value * value
            gu += x_u
            gv += x_v
            uu += x_u * x_u
            uv += x_u * x_v
            vv += x_v * x_v
    sums[0], sums[1] = mean, np.sqrt(square / np.float32(n * n) + np.float32(1e-12))
    sums[2], sums[3], sums[4], sums[5], sums[6] = gu, gv, uu, uv, vv
    pu = pv = np.float32(0.0)
    for r in range(n):
        for c in range(n):
            pu += parts[1, r, c] * parts[0, r, c]
            pv += parts[2, r, c] * parts[0, r, c]
    sums[7], sums[8] = pu, pv
    return True


@njit(cache=True, nogil=True, fastmath=FAST)
def _read(image: Image, u: float, v: float, parts: Floats, mean: float, seen: Array) -> bool:
    """The patch around (u, v), straight, less `mean`, against a template: fills seen (5,) with its sum, the sum of its
    squares, and those of its products with the three `parts`. Bilinear; False where it leaves the image."""
    n = 2 * HALF + 1
    i, j = int(np.floor(v)), int(np.floor(u))
    if i < HALF or j < HALF or i + HALF + 1 >= image.shape[0] or j + HALF + 1 >= image.shape[1]:
        return False
    fy, fx = np.float32(v - i), np.float32(u - j)
    one = np.float32(1.0)
    w00, w01, w10, w11 = (one - fy) * (one - fx), (one - fy) * fx, fy * (one - fx), fy * fx
    off = np.float32(mean)
    total = square = product = bu = bv = np.float32(0.0)
    for r in range(n):
        top = image[i - HALF + r, j - HALF : j + HALF + 2]
        low = image[i - HALF + r + 1, j - HALF : j + HALF + 2]
        for c in range(n):
            upper = w00 * np.float32(top[c]) + w01 * np.float32(top[c + 1])
            value = upper + w10 * np.float32(low[c]) + w11 * np.float32(low[c + 1]) - off
            total += value
            square += value * value
            product += value * parts[0, r, c]
            bu += value * parts[1, r, c]
            bv += value * parts[2, r, c]
    seen[0], seen[1], seen[2], seen[3], seen[4] = total, square, product, bu, bv
    return True


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
    room: Room,
    template: tuple[Floats, Array, Array],
) -> float:
    """Move `guess` (2,) to where the patch around (tu, tv) is seen in `image`; all in pixels of one level.

    affine (4,): d(u, v) / d(u', v'), row by row, of the template's picture by the other. `enough`: step [px] that ends
    the iteration. min_contrast: standard deviation [grey levels] below which a patch shows nothing. The template is
    read through the affine, so that the other picture is read straight.
    Returns the correlation, or -1 where it is lost.
    """
    parts, sums, seen = template
    if not _template(template_image, tu, tv, affine, room, parts, sums):
        return -1.0
    deviation = sums[1]
    if deviation < min_contrast:
        return -1.0
    scale = 1.0 / (deviation * deviation)
    h00, h01, h11 = sums[4] * scale + 1e-9, sums[5] * scale, sums[6] * scale + 1e-9
    determinant = h00 * h11 - h01 * h01
    if determinant < 1e-3 * h00 * h11 or min(h00, h11) < 0.5:
        return -1.0
    count = (2 * HALF + 1) ** 2
    correlation = -1.0
    for _ in range(iterations):
        if not _read(image, guess[0], guess[1], parts, sums[0], seen):
            return -1.0
        mean = seen[0] / count
        other = np.sqrt(max(seen[1] / count - mean * mean, 1e-12))
        if other < 0.4 * min_contrast:
            return -1.0
        both = 1.0 / (deviation * other)
        correlation = seen[2] * both / count
        b0 = (seen[3] - mean * sums[2]) * both - sums[7] * scale
        b1 = (seen[4] - mean * sums[3]) * both - sums[8] * scale
        eu = (h11 * b0 - h01 * b1) / determinant
        ev = (h00 * b1 - h01 * b0) / determinant
        size = np.sqrt(eu * eu + ev * ev)
        if size > 2.0:
            eu, ev = 2.0 * eu / size, 2.0 * ev / size
        guess[0] -= eu
        guess[1] -= ev
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

    before, after: pyramids, full size first. predicted: (N, 2) [px]. affine: (N, 4) d(u', v') / d(u, v), row by row.
    coarsest: first level. Returns (N, 2) [px] and which came back to within `max_return_px` from a start one pixel
    aside.
    """
    n = 2 * HALF + 1
    wide = n + 2
    room = (
        np.empty((2, wide, wide), np.int32), np.empty((2, wide, wide), np.float32), np.empty((wide, wide), np.float32)
    )  # fmt: skip
    template = np.empty((3, n, n), np.float32), np.empty(9), np.empty(5)
    count = len(points)
    found = np.zeros((count, 2))
    ok = np.zeros(count, dtype=np.bool_)
    guess, here, back = np.empty(2), np.empty(2), np.empty(4)
    for k in range(count):
        here[0], here[1] = predicted[k, 0], predicted[k, 1]
        A = affine[k]
        determinant = A[0] * A[3] - A[1] * A[2]
        if not abs(determinant) > 1e-9:
            continue
        back[0], back[1] = A[3] / determinant, -A[1] / determinant
        back[2], back[3] = -A[2] / determinant, A[0] / determinant
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
                    before[2], after[2], tu, tv, guess, back, 6, 0.1, min_contrast, room, template
                )
            elif level == 1:
                correlation = _align(
                    before[1], after[1], tu, tv, guess, back, 6, 0.1, min_contrast, room, template
                )
            else:
                correlation = _align(
                    before[0], after[0], tu, tv, guess, back, 8, 0.01, min_contrast, room, template
                )
            if correlation > 0.3:
                here[0] = (guess[0] + 0.5) / scale - 0.5
                here[1] = (guess[1] + 0.5) / scale - 0.5
        if correlation < min_correlation:
            continue
        guess[0], guess[1] = points[k, 0] + 0.7, points[k, 1] + 0.7
        returned = _align(
            after[0], before[0], here[0], here[1], guess, A, 6, 0.1, min_contrast, room, template
        )
        if returned < min_correlation:
            continue
        if (guess[0] - points[k, 0]) ** 2 + (guess[1] - points[k, 1]) ** 2 < max_return_px**2:
            found[k, 0], found[k, 1] = here[0], here[1]
            ok[k] = True
    return found, ok
