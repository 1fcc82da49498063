"""Steps that hide in a stretch too wild to show them: the car goes over a speed hump when the mount is knocked.

There the springs swing by more than any knock, and no single frame can be told to be its onset. But the level
before the stretch and the level after it can be held against each other, and what such a difference is worth is
told by the drive itself: by how much levels differ across calm stretches of the same length.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import median_filter

from stereocalib_core.back.rig.change_points import Step
from stereocalib_core.config.steps import TurmoilConfig
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.robust import SIGMA_PER_MAD, mad_sigma


def wild_stretches(values: Array, config: TurmoilConfig | None = None) -> list[tuple[int, int]]:
    """First and last + 1 of stretches in which any column of (N, K) values swings far beyond its usual."""
    config = config or TurmoilConfig()
    wild = np.zeros(len(values), dtype=bool)
    at = np.arange(len(values))
    for column in values.T:
        known = np.isfinite(column)
        if known.sum() < 3 * config.window:
            continue
        filled = np.interp(at, at[known], column[known])
        off = np.abs(filled - median_filter(filled, size=config.window, mode="nearest"))
        wild |= known & (off > config.wild * SIGMA_PER_MAD * np.median(off[known]))
    frames = np.flatnonzero(wild)
    groups = np.split(frames, np.flatnonzero(np.diff(frames) > config.joined) + 1)
    stretches = [(int(g[0]) - config.lead, int(g[-1]) + 1 + config.settle) for g in groups if len(g) > 1]
    return [(max(first, 0), stop) for first, stop in stretches if stop - first <= config.longest]


def find_hidden_step(
    series: Array,
    stretches: list[tuple[int, int]],
    least: float,
    noise: float,
    witness: Array | None = None,
    config: TurmoilConfig | None = None,
) -> Step | None:
    """The surest lasting step of (N,) values, NaN = unknown, across one of the stretches; None without one.

    least: smallest size of a step seen in the open; noise: least standard deviation of one value. witness: (N,)
    the same measured otherwise, which must show the step as well. The onset is the middle of the stretch.
    """
    config = config or TurmoilConfig()
    calm = series.copy()
    for first, stop in stretches:
        calm[first:stop] = np.nan
    best: Step | None = None
    for first, stop in stretches:
        for count in config.levels:
            sides = _sides(calm, first, stop, count)
            if sides is None:
                continue
            size = _rise(*sides)
            deviation = max(
                _usual_rise(calm, stop - first, count, config.calm_places), config.least_noise * noise
            )
            score = abs(size) / deviation
            if score < config.least_score or abs(size) < config.least_size * least:
                continue
            if not _borne_out(*sides, size, config.each_half):
                continue
            seen = None if witness is None else _sides(witness, first, stop, count)
            if witness is not None and (seen is None or _rise(*seen) / size < config.each_half):
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


def _borne_out(before: Array, after: Array, size: float, share: float) -> bool:
    half = len(before) // 2
    parts = (before[:half], before[half:]), (after[:half], after[half:])
    return min(_rise(b, a) / size for b in parts[0] for a in parts[1]) > share


def _usual_rise(calm: Array, length: int, count: int, least_places: int) -> float:
    """1 sigma of the difference of levels across stretches of this length with nothing in them; inf = unknown."""
    rises = []
    for first in range(count, len(calm) - length - count + 1, 3):
        if np.isfinite(calm[first - count : first + length + count]).all():
            rises.append(_rise(calm[first - count : first], calm[first + length : first + length + count]))
    if len(rises) < least_places:
        return float("inf")
    return mad_sigma(np.array(rises))
