"""Steps that hide in a stretch too wild to show them: the car goes over a speed hump when the mount is knocked.

There the springs swing by more than any knock, and no single frame can be told to be its onset. But the level
before the stretch and the level after it can be held against each other, and what such a difference is worth is
told by the drive itself: by how much levels differ across calm stretches of the same length.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import median_filter

from stereocalib_core.back.rig.change_points import Step
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.robust import SIGMA_PER_MAD, mad_sigma

_LOCAL, _WILD = 21, 6.0
"""Frames of the running median; wild is what lies off it by so many usual deviations. A step alone does not."""
_JOINED, _LEAD, _SETTLE, _LONGEST = 6, 3, 5, 30
"""Wild frames so near make one stretch; margins before and behind it, where springs settle; no longer than this."""
_LEVELS = (30, 45)
"""Frames on either side that make a level; a step is told by the first or, surer, by the second."""
_LEAST_SCORE, _LEAST_SIZE = 4.5, 1.35
"""In deviations of calm stretches, and in least sizes."""
_LEAST_NOISE = 3.0
"""Levels differ by at least so many times the least deviation of one value: a short drive may look calmer."""
_EACH_HALF = 0.6
"""Each half of both levels must bear out so much of the step."""
_CALM_PLACES = 40
"""Fewer calm places say nothing of what a difference is worth."""


def wild_stretches(values: Array) -> list[tuple[int, int]]:
    """First and last + 1 of stretches in which any column of (N, K) values swings far beyond its usual."""
    wild = np.zeros(len(values), dtype=bool)
    at = np.arange(len(values))
    for column in values.T:
        known = np.isfinite(column)
        if known.sum() < 3 * _LOCAL:
            continue
        filled = np.interp(at, at[known], column[known])
        off = np.abs(filled - median_filter(filled, size=_LOCAL, mode="nearest"))
        wild |= known & (off > _WILD * SIGMA_PER_MAD * np.median(off[known]))
    frames = np.flatnonzero(wild)
    groups = np.split(frames, np.flatnonzero(np.diff(frames) > _JOINED) + 1)
    stretches = [(int(g[0]) - _LEAD, int(g[-1]) + 1 + _SETTLE) for g in groups if len(g) > 1]
    return [(max(first, 0), stop) for first, stop in stretches if stop - first <= _LONGEST]


def find_hidden_step(
    series: Array, stretches: list[tuple[int, int]], least: float, noise: float, witness: Array | None = None
) -> Step | None:
    """The surest lasting step of (N,) values, NaN = unknown, across one of the stretches; None without one.

    least: smallest size of a step seen in the open; noise: least standard deviation of one value. witness: (N,)
    the same measured otherwise, which must show the step as well. The onset is the middle of the stretch.
    """
    calm = series.copy()
    for first, stop in stretches:
        calm[first:stop] = np.nan
    best: Step | None = None
    for first, stop in stretches:
        for count in _LEVELS:
            sides = _sides(calm, first, stop, count)
            if sides is None:
                continue
            size = _rise(*sides)
            deviation = max(_usual_rise(calm, stop - first, count), _LEAST_NOISE * noise)
            score = abs(size) / deviation
            if score < _LEAST_SCORE or abs(size) < _LEAST_SIZE * least or not _borne_out(*sides, size):
                continue
            seen = None if witness is None else _sides(witness, first, stop, count)
            if witness is not None and (seen is None or _rise(*seen) / size < _EACH_HALF):
                continue
            if best is None or score > best.score:
                certain = int(np.flatnonzero(np.isfinite(calm[stop:]))[count - 1]) + stop
                best = Step((first + stop) // 2, certain, size, deviation, score)
            break
    return best


def _sides(series: Array, first: int, stop: int, count: int) -> tuple[Array, Array] | None:
    """(count,) known values before a stretch and after it, all near it; None where there are too few."""
    before, after = series[max(first - 2 * count, 0) : first], series[stop : stop + 2 * count]
    before, after = before[np.isfinite(before)][-count:], after[np.isfinite(after)][:count]
    return (before, after) if min(len(before), len(after)) == count else None


def _rise(before: Array, after: Array) -> float:
    return float(np.median(after) - np.median(before))


def _borne_out(before: Array, after: Array, size: float) -> bool:
    half = len(before) // 2
    parts = (before[:half], before[half:]), (after[:half], after[half:])
    return min(_rise(b, a) / size for b in parts[0] for a in parts[1]) > _EACH_HALF


def _usual_rise(calm: Array, length: int, count: int) -> float:
    """1 sigma of the difference of levels across stretches of this length with nothing in them; inf = unknown."""
    rises = []
    for first in range(count, len(calm) - length - count + 1, 3):
        if np.isfinite(calm[first - count : first + length + count]).all():
            rises.append(_rise(calm[first - count : first], calm[first + length : first + length + count]))
    if len(rises) < _CALM_PLACES:
        return float("inf")
    return mad_sigma(np.array(rises))
