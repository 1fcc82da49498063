"""Semi-global matching along three paths: down, to the right, to the left. Compiled for the processor at hand.

Hirschmueller, "Stereo processing by semiglobal matching and mutual information", PAMI 30(2), 2008. The rules for
borders, strips, ties and the check against the right picture are those of OpenCV's `STEREO_SGBM_MODE_SGBM_3WAY`: both
give the same map. Ours takes half of the time or less, since OpenCV's is compiled for the oldest processor that it runs
on. Costs are 16-bit integers, so that a map is the same on every machine.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numba import njit

from stereocalib_core.front.semi_global.costs import (
    MOST_COST,
    Bytes,
    Shorts,
    features,
    pixel_costs,
    sum_along,
)
from stereocalib_core.numeric.arrays import Grey
from stereocalib_core.numeric.lanes import (
    LANES,
    after_one,
    before_one,
    chosen,
    counted,
    first_lane,
    halves_changed,
    least,
    load_shorts,
    minus,
    most,
    plus,
    spread_shorts,
    spread_smallest,
    store_shorts,
)

SUBPIXEL = 16
"""A map counts in sixteenths of a cell."""
_STRIPS = 4
_BEYOND = 30000
"""The cost of a disparity that is not searched: more than any sum, and the small penalty may be added."""
_ONE = np.uint64(1)
"""An index without sign does not count from the end, and is not looked at for that."""


def fits(block: int, small: int, large: int) -> bool:
    """Do sums of costs with these settings stay within 16 bits?"""
    return 3 * (MOST_COST * block * block + 2 * large) + small < _BEYOND


@njit(cache=True, nogil=True)
def _step(costs: Shorts, at: int, path: Shorts, old: int, new: int, count: int, step: Any, top: Any) -> Any:
    """One step of a path: path[new...] from path[old...] and the costs at `at`; the least of the new ones, spread.

    step: the small penalty, spread. top: the least of the old ones and the large penalty, which costs hold already.
    """
    beyond = spread_shorts(_BEYOND)
    best, before, here = beyond, beyond, load_shorts(path, old)
    last = count - LANES
    for d in range(0, last, LANES):
        after = load_shorts(path, old + d + LANES)
        aside = plus(least(before_one(before, here), after_one(here, after)), step)
        value = plus(load_shorts(costs, at + d), minus(least(aside, least(here, top)), top))
        best = least(best, value)
        store_shorts(path, new + d, value)
        before, here = here, after
    aside = plus(least(before_one(before, here), after_one(here, beyond)), step)
    value = plus(load_shorts(costs, at + last), minus(least(aside, least(here, top)), top))
    store_shorts(path, new + last, value)
    return spread_smallest(least(best, value))


@njit(cache=True, nogil=True)
def _best(down: Shorts, a: int, along: Shorts, b: int, back: Shorts, c: int, count: int) -> tuple[int, int]:
    """The disparity with the least sum of three paths, and that sum; the sums take the place of `back`'s costs.

    Of equally good ones the last of each residue modulo 8, and of those the first.
    """
    best, where = spread_shorts(_BEYOND), spread_shorts(0)
    here, on = counted(), spread_shorts(LANES)
    for d in range(0, count, LANES):
        whole = plus(load_shorts(back, c + d), plus(load_shorts(down, a + d), load_shorts(along, b + d)))
        store_shorts(back, c + d, whole)
        best = least(best, whole)
        where = chosen(best, whole, here, where)
        here = plus(here, on)
    value = spread_smallest(best)
    where = chosen(best, value, where, spread_shorts(-1))
    where = most(where, halves_changed(where, where))
    # as a number without sign, -1 is the largest
    return first_lane(spread_smallest(where)), first_lane(value)


@njit(cache=True, nogil=True, error_model="numpy")
def _refine(before: Shorts, here: Shorts, after: Shorts, found: Shorts) -> None:
    """Add to disparities in sixteenths where the parabola through three sums has its lowest point, towards 0.

    Where `before` is negative, there are no three.
    """
    for x in range(len(found)):
        whole = np.float32(before[x]) - np.float32(after[x])
        bend = max(
            np.float32(before[x]) + np.float32(after[x]) - np.float32(2.0) * np.float32(here[x]),
            np.float32(1.0),
        )
        part = np.int32((whole * np.float32(SUBPIXEL) + bend) / (bend + bend))
        found[x] += np.int16(part if before[x] >= 0 else 0)


@njit(cache=True, nogil=True)
def _seen_from_right(
    where: Shorts, value: Shorts, first_x: int, lowest: int, other: Shorts, cost: Shorts
) -> None:
    """Fill `other`: the best of the disparities that lead to each column of the right picture."""
    other[:], cost[:] = (lowest - 1) * SUBPIXEL, _BEYOND
    for x in range(len(where) - 1, -1, -1):
        k = np.uint64(x + first_x - lowest - where[x])
        if cost[k] > value[x]:
            cost[k], other[k] = value[x], where[x] + lowest


@njit(cache=True, nogil=True)
def _contradicted(found: Shorts, first_x: int, lowest: int, other: Shorts) -> None:
    """Take out of a row what the right picture's best match, `other`, contradicts by more than one cell."""
    none = np.int16((lowest - 1) * SUBPIXEL)
    for x in range(len(found)):
        low, high = found[x] >> 4, (found[x] + SUBPIXEL - 1) >> 4
        a, b = other[np.uint64(x + first_x - low)], other[np.uint64(x + first_x - high)]
        wrong = (a >= lowest) & (b >= lowest) & (abs(a - low) > 1) & (abs(b - high) > 1)
        found[x] = none if wrong else found[x]


@njit(cache=True, nogil=True)
def _strip(
    left: Bytes,
    right: Bytes,
    height: int,
    begin: int,
    first: int,
    end: int,
    lowest: int,
    count: int,
    settings: tuple[int, int, int],
    result: Shorts,
) -> None:
    """Rows first...end - 1 of the map; the path down begins at row `begin`. settings: half block, both penalties."""
    half, small, large = settings
    width = result.shape[1]
    highest = lowest + count
    first_x, last_x = max(highest, 0), width + min(lowest, 0)
    columns = last_x - first_x
    line = columns * count
    ring = 2 * half + 2
    pixel = np.empty(line, np.uint8)
    sums = np.empty((ring, line), np.int16)
    costs = np.full(line, large, np.int16)
    down, down_least = np.zeros(line, np.int16), np.zeros(columns, np.int16)
    along, back = np.zeros(line + count, np.int16), np.zeros(line + count, np.int16)
    where, here = np.empty(columns, np.int16), np.empty(columns, np.int16)
    before, after = np.empty(columns, np.int16), np.empty(columns, np.int16)
    other, other_cost = np.empty(width, np.int16), np.empty(width, np.int16)
    step, leap = spread_shorts(small), spread_shorts(large)
    for y in range(begin, end):
        for k in range(begin if y == begin else y + half, y + half + 1):
            now = sums[min(k, height - 1) % ring]
            if k < height:
                pixel_costs(left, right, k, width, first_x, last_x, lowest, count, pixel)
                sum_along(pixel, half, columns, count, now)
            if y > begin:
                gone = sums[max(y - half - 1, begin) % ring]
                for i in range(0, line, LANES):
                    change = minus(load_shorts(now, i), load_shorts(gone, i))
                    store_shorts(costs, i, plus(load_shorts(costs, i), change))
            else:
                for _ in range(half + 1 if k == begin else 1):
                    for i in range(0, line, LANES):
                        store_shorts(costs, i, plus(load_shorts(costs, i), load_shorts(now, i)))
        if y < first:
            for x in range(columns):
                at = x * count
                top = plus(spread_shorts(down_least[x]), leap)
                down_least[x] = first_lane(_step(costs, at, down, at, at, count, step, top))
            continue
        # both ways along the row at once: each step waits for the one before
        right_top = left_top = leap
        for x in range(columns):
            at, mirrored = x * count, (columns - 1 - x) * count
            right_top = plus(_step(costs, at, along, at, at + count, count, step, right_top), leap)
            left_top = plus(
                _step(costs, mirrored, back, mirrored + count, mirrored, count, step, left_top), leap
            )
            top = plus(spread_shorts(down_least[x]), leap)
            down_least[x] = first_lane(_step(costs, at, down, at, at, count, step, top))
        row = result[y]
        row[:] = (lowest - 1) * SUBPIXEL
        found = row[first_x:last_x]
        for x in range(columns):
            at = x * count
            where[x], here[x] = _best(down, at, along, at + count, back, at, count)
        for x in range(columns):
            d = where[x]
            middle = np.uint64(x * count + min(max(d, 1), count - 2))
            before[x] = back[middle - _ONE] if 0 < d < count - 1 else -1
            after[x] = back[middle + _ONE]
            found[x] = SUBPIXEL * (d + lowest)
        _refine(before, here, after, found)
        _seen_from_right(where, here, first_x, lowest, other, other_cost)
        _contradicted(found, first_x, lowest, other)


@njit(cache=True, nogil=True)
def _strips(
    left: Grey,
    right: Grey,
    lowest: int,
    count: int,
    settings: tuple[int, int, int],
    strips: int,
    overlap: int,
) -> Shorts:
    """(H, W) map of a pair, the right picture mirrored, in strips whose path down begins `overlap` rows above."""
    height, width = left.shape
    planes = np.empty((2, 6, height * width), np.uint8)
    pictures = left.ravel(), right.ravel()
    for k in range(2):
        features(pictures[k], height, width, 1 - 2 * k, planes[k])
    seen, other = planes[0], planes[1]
    result = np.empty((height, width), np.int16)
    rows = (height + strips - 1) // strips
    for k in range(strips):
        first, end = k * rows, min((k + 1) * rows, height)
        if first < end:
            begin = max(first - overlap, 0)
            _strip(seen, other, height, begin, first, end, lowest, count, settings, result)
    return result


def match(left: Grey, right: Grey, lowest: int, count: int, block: int, small: int, large: int) -> Shorts:
    """(H, W) disparity in sixteenths of a cell, 16 (lowest - 1) where there is none.

    left, right: (H, W) uint8. lowest, count: disparities searched, `count` a multiple of 16. block: side of the block
    [cells], odd. small, large: penalty of a step of one disparity, and of more.
    """
    rows = -(-left.shape[0] // _STRIPS)
    overlap = block // 2 + 1 + int(np.ceil(0.1 * rows))
    # blocks of memory of their own: compiled code is another one for pictures that may not be written to
    left, mirrored = np.array(left, order="C"), np.array(right[:, ::-1], order="C")
    found = _strips(left, mirrored, lowest, count, (block // 2, small, large), _STRIPS, overlap)
    return np.asarray(cv2.medianBlur(found, 3), dtype=np.int16)
