"""What it costs to take a pixel of the left picture for one of the right: Birchfield and Tomasi's measure.

"A pixel dissimilarity measure that is insensitive to image sampling", PAMI 20(4), 1998, on the horizontal gradient and
on a quarter of the grey value.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from stereocalib_core.numeric.lanes import (
    LANES,
    above,
    between,
    least,
    load_bytes,
    load_shorts,
    minus,
    most,
    narrowed,
    plus,
    quarter,
    spread_bytes,
    spread_shorts,
    store_bytes,
    store_shorts,
    widened,
)

Bytes = NDArray[np.uint8]
Shorts = NDArray[np.int16]

STEEPEST = 15
"""Horizontal gradients are cut at this to either side, and counted from it."""
MOST_COST = 2 * STEEPEST + 255 // 4
"""Of one pixel: of its gradient, and a quarter of its grey value."""


@njit(cache=True, nogil=True)
def features(image: Bytes, height: int, width: int, toward: int, planes: NDArray[np.uint8]) -> None:
    """Fill planes (6, H * W): gradient and grey value, each with the least and the most within half a pixel.

    image: (H * W). toward: the way in which the gradient counts as rising, -1 in a picture that was mirrored. Gradients
    are cut at `STEEPEST` and counted from there; the outermost columns show nothing. Rows end with lanes that overlap
    those before.
    """
    most_steep, least_steep = spread_shorts(STEEPEST), spread_shorts(-STEEPEST)
    for i in range(height):
        start, end = i * width, (i + 1) * width - 1
        upper, lower = max(i - 1, 0) * width - start, min(i + 1, height - 1) * width - start
        for j in range(start + 1, end, LANES):
            k = min(j, end - LANES)
            on, back = k + toward, k - toward
            middle = minus(widened(load_bytes(image, on)), widened(load_bytes(image, back)))
            over = minus(widened(load_bytes(image, on + upper)), widened(load_bytes(image, back + upper)))
            under = minus(widened(load_bytes(image, on + lower)), widened(load_bytes(image, back + lower)))
            steep = plus(plus(middle, middle), plus(over, under))
            steep = plus(most(least(steep, most_steep), least_steep), most_steep)
            store_bytes(planes[0], k, narrowed(steep))
            store_bytes(planes[3], k, load_bytes(image, k))
        for c in range(0, 6, 3):
            own, low, high = planes[c], planes[c + 1], planes[c + 2]
            own[start] = own[end] = STEEPEST
            for j in range(start + 1, end, LANES):
                k = min(j, end - LANES)
                value = load_bytes(own, k)
                left, right = between(value, load_bytes(own, k - 1)), between(value, load_bytes(own, k + 1))
                store_bytes(low, k, least(value, least(left, right)))
                store_bytes(high, k, most(value, most(left, right)))
            for j, k in ((start, start + 1), (end, end - 1)):
                middle = (np.int64(own[j]) + np.int64(own[k])) >> 1
                low[j], high[j] = min(own[j], middle), max(own[j], middle)


@njit(cache=True, nogil=True)
def pixel_costs(
    left: Bytes,
    right: Bytes,
    i: int,
    width: int,
    first_x: int,
    last_x: int,
    lowest: int,
    count: int,
    costs: Bytes,
) -> None:
    """Fill costs (columns * count) of picture row i: pixel against pixel at `count` disparities from `lowest` on."""
    g, g0, g1 = left[0], left[1], left[2]
    p, p0, p1 = left[3], left[4], left[5]
    h, h0, h1 = right[0], right[1], right[2]
    q, q0, q1 = right[3], right[4], right[5]
    start = i * width
    k = 0
    for x in range(first_x, last_x):
        a, a0, a1 = spread_bytes(g[start + x]), spread_bytes(g0[start + x]), spread_bytes(g1[start + x])
        b, b0, b1 = spread_bytes(p[start + x]), spread_bytes(p0[start + x]), spread_bytes(p1[start + x])
        at = start + width - 1 - x + lowest
        for d in range(at, at + count, LANES):
            c, c0, c1 = load_bytes(h, d), load_bytes(h0, d), load_bytes(h1, d)
            steep = least(most(above(a, c1), above(c0, a)), most(above(c, a1), above(a0, c)))
            c, c0, c1 = load_bytes(q, d), load_bytes(q0, d), load_bytes(q1, d)
            grey = least(most(above(b, c1), above(c0, b)), most(above(c, b1), above(b0, c)))
            store_bytes(costs, k, plus(steep, quarter(grey)))
            k += LANES


@njit(cache=True, nogil=True)
def sum_along(pixel: Bytes, half: int, columns: int, count: int, sums: Shorts) -> None:
    """Fill sums (columns * count): of pixel costs over 2 half + 1 columns, the outermost standing for those beyond."""
    for d in range(0, count, LANES):
        total = spread_shorts(0)
        for x in range(-half, half + 1):
            total = plus(total, widened(load_bytes(pixel, min(max(x, 0), columns - 1) * count + d)))
        store_shorts(sums, d, total)
    for x in range(1, columns):
        new, old = min(x + half, columns - 1) * count, max(x - half - 1, 0) * count
        at = x * count
        for d in range(0, count, LANES):
            change = minus(widened(load_bytes(pixel, new + d)), widened(load_bytes(pixel, old + d)))
            store_shorts(sums, at + d, plus(load_shorts(sums, at - count + d), change))
