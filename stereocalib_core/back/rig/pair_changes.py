"""Where in a drive one camera of the pair was knocked against the other: steps in what each frame says of it.

A pair of cameras on one bar has no springs: its angles are constant until something moves them. So the model is a
constant with steps, and every frame is one noisy look at it. The best single step of a stretch is found by least
squares, kept if it is larger than what matters and surer than chance, and both sides are searched again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from stereocalib_core.config.steps import PairStepConfig
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.robust import mad_sigma


@dataclass(frozen=True)
class Step:
    """From index `at` on the values are larger by `size`, with its sigma, in the unit of the values."""

    at: int
    size: float
    sigma: float


def steps(
    values: Array, precision: Array, least: float, spans: bool, config: PairStepConfig
) -> tuple[Step, ...]:
    """The steps of a noisy constant, in order.

    values: (N,), NaN = no look. precision: (N,) inverse variances up to a common factor. least: smallest step that
    matters. spans: look i spans frames i - 1 and i, so that the one at a step belongs to neither side.
    """
    known = np.isfinite(values) & np.isfinite(precision) & (precision > 0)
    if np.count_nonzero(known) < 2 * config.least_side:
        return ()
    value, weight = _clipped(values, precision, known, config)
    weight = weight / _together(value, weight, config)
    edges = _search(value, weight, 0, len(values), least, spans, config)
    while True:
        bounds = [0, *edges, len(values)]
        found = []
        for n, at in enumerate(edges):
            before, after = slice(bounds[n], at), slice(at + spans, bounds[n + 2])
            found.append(Step(at, *_difference(value, weight, before, after)))
        kept = [step.at for step in found if abs(step.size) >= max(least, config.sure * step.sigma)]
        if len(kept) == len(edges):
            return tuple(found)
        edges = kept


def _together(value: Array, weight: Array, config: PairStepConfig) -> float:
    """How many times the variance of the mean of neighbouring looks is what it were if each was on its own, >= 1.

    By the differences of the means of groups that follow each other, so that a step counts once.
    """
    at = np.flatnonzero(weight > 0)
    count = len(at) // config.neighbours
    if count < 3:
        return 1.0
    v, w = (a[at][: count * config.neighbours].reshape(count, config.neighbours) for a in (value, weight))
    total = w.sum(axis=1)
    means = (v * w).sum(axis=1) / total
    expected = np.sqrt(1.0 / total[1:] + 1.0 / total[:-1])
    return max(1.0, mad_sigma(np.diff(means) / expected)) ** 2


def _clipped(
    values: Array, precision: Array, known: NDArray[np.bool_], config: PairStepConfig
) -> tuple[Array, Array]:
    """Values with strays bounded, and weights that are inverse variances by what the values themselves scatter."""
    at = np.flatnonzero(known)
    value, weight = np.zeros(len(values)), np.zeros(len(values))
    middle = median_filter(values[at], size=config.neighbours, mode="reflect")
    root = np.sqrt(precision[at])
    normal = (values[at] - middle) * root
    # a look pulls the median of its neighbours towards itself; looks that are all the same scatter by nothing
    scatter = max(mad_sigma(normal) * config.neighbours / (config.neighbours - 1.0), config.least_scatter)
    value[at] = middle + np.clip(normal, -config.clip * scatter, config.clip * scatter) / root
    weight[at] = precision[at] / scatter**2
    return value, weight


def _difference(value: Array, weight: Array, before: slice, after: slice) -> tuple[float, float]:
    """Mean after minus mean before, and its sigma."""
    totals = [weight[part].sum() for part in (before, after)]
    means = [
        (weight[part] * value[part]).sum() / total
        for part, total in zip((before, after), totals, strict=True)
    ]
    return float(means[1] - means[0]), float(np.sqrt(sum(1.0 / total for total in totals)))


def _search(
    value: Array, weight: Array, first: int, last: int, least: float, spans: bool, config: PairStepConfig
) -> list[int]:
    """Indices of the steps within first ... last - 1."""
    w, wv = np.cumsum(weight[first:last]), np.cumsum((weight * value)[first:last])
    looks = np.cumsum(weight[first:last] > 0)
    at = np.arange(1, last - first)
    skipped = at if spans else at - 1
    with np.errstate(divide="ignore", invalid="ignore"):
        left, right = w[at - 1], w[-1] - w[skipped]
        jump = (wv[-1] - wv[skipped]) / right - wv[at - 1] / left
        gain = jump**2 * left * right / (left + right)
    enough = (looks[at - 1] >= config.least_side) & (looks[-1] - looks[skipped] >= config.least_side)
    gain = np.where(enough & np.isfinite(gain), gain, 0.0)
    if not gain.any():
        return []
    best = first + int(at[int(np.argmax(gain))])
    size, sigma = _difference(value, weight, slice(first, best), slice(best + spans, last))
    if abs(size) < least or abs(size) < config.sure * sigma:
        return []
    before = _search(value, weight, first, best, least, spans, config)
    after = _search(value, weight, best + spans, last, least, spans, config)
    return [*before, best, *after]


def stretches(count: int, edges: Sequence[int], near: int = 3) -> list[tuple[int, int]]:
    """First index and the one after the last of every part of 0 ... count - 1; edges closer than `near` are one."""
    kept: list[int] = []
    for edge in sorted(edges):
        if 0 < edge < count and (not kept or edge - kept[-1] > near):
            kept.append(edge)
    bounds = [0, *kept, count]
    return list(zip(bounds[:-1], bounds[1:], strict=True))
