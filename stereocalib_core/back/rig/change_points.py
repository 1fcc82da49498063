"""Steps in a noisy series: a generalised likelihood ratio on whitened values.

An autoregression of the series takes out its slow swing, so that what is left jumps where a step begins. Each
index is tried as the onset: least squares for level and step over the values around it give the size and its
standard deviation. What stands out must be a step and nothing else: it comes at once, it stays, and the values
around it are calm beside it (over a speed hump they are not).
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from stereocalib_core.config.steps import StepConfig
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.robust import SIGMA_PER_MAD, mad_sigma


@dataclass(frozen=True)
class Step:
    """A step at index `onset` (the first value after it), sure by index `certain`; size and sigma alike."""

    onset: int
    certain: int
    size: float
    sigma: float
    score: float


@dataclass(frozen=True)
class _White:
    """Innovations (N,) of an autoregression, the level (N,) that they vary about, their weights (N,) = 1 /
    variance, 0 where unknown, and its lags."""

    innovations: Array
    level: Array
    weights: Array
    coefficients: Array

    def signature(self, count: int) -> Array:
        """(count,) what a step of size one adds to the innovations from its onset on."""
        past = np.concatenate([[0.0], np.cumsum(self.coefficients)])
        return np.asarray(1.0 - past[np.minimum(np.arange(count), len(self.coefficients))])

    def without(self, onset: int, size: float) -> _White:
        """The same with a step taken out."""
        innovations = self.innovations.copy()
        innovations[onset:] -= size * self.signature(len(innovations) - onset)
        return dataclasses.replace(self, innovations=innovations)


def _whiten(series: Array, calm: NDArray[np.bool_], noise: float, config: StepConfig) -> _White:
    """Fit an autoregression to the series without its level and give its innovations.

    calm: (N,) values of better quality; the two kinds get a variance each. noise: least standard deviation.
    """
    known, lags = np.isfinite(series), config.lags
    at = np.arange(len(series))
    filled = np.interp(at, at[known], series[known])
    flat = filled - median_filter(filled, size=config.level_window, mode="nearest")
    rows = at[lags:]
    past = np.stack([flat[rows - k] for k in range(1, lags + 1)], axis=1)
    limit = 5.0 * SIGMA_PER_MAD * float(np.median(np.abs(flat))) + 1e-12
    whole = known[rows] & np.all([known[rows - k] for k in range(1, lags + 1)], axis=0)
    clean = whole & (np.abs(past) < limit).all(axis=1) & (np.abs(flat[rows]) < limit)
    coefficients = np.zeros(lags)
    if clean.sum() >= 10 * lags:
        ridge = 1e-3 * float((past[clean] ** 2).sum()) / lags + 1e-18
        normal = past[clean].T @ past[clean] + ridge * np.eye(lags)
        coefficients = np.linalg.solve(normal, past[clean].T @ flat[rows][clean])
    innovations, weights = np.zeros(len(series)), np.zeros(len(series))
    before = np.stack([filled[rows - k] for k in range(1, lags + 1)], axis=1)
    innovations[rows] = filled[rows] - before @ coefficients
    level = (1.0 - coefficients.sum()) * (filled - flat)
    # Where several frames nearby are wild, one more is no news; a step itself is wild in a frame or two only.
    restless = SIGMA_PER_MAD * median_filter(
        np.abs(innovations - level), size=config.restless_window, mode="reflect"
    )
    for kind in (calm, ~calm):
        chosen = np.zeros(len(series), dtype=bool)
        chosen[rows] = whole & kind[rows]
        if chosen.any():
            deviation = mad_sigma((innovations - level)[chosen])
            usual = max(deviation, noise)
            wild = restless > config.restless_factor * usual
            weights[chosen] = 1.0 / np.where(wild, restless, usual)[chosen] ** 2
    return _White(innovations, level, weights, coefficients)


def _likelihood(white: _White, horizon: int, before: int) -> tuple[Array, Array]:
    """(N,) size of a step at each index as `horizon` values after it and `before` before it show it, and its
    standard deviation."""
    n = len(white.innovations)
    constant = 1.0 - float(white.coefficients.sum())
    signature = white.signature(horizon)
    w, we = white.weights, white.weights * white.innovations

    def ahead(x: Array, kernel: Array) -> Array:
        return np.correlate(np.concatenate([x, np.zeros(horizon - 1)]), kernel, "valid")

    def window(x: Array) -> Array:
        total = np.concatenate([[0.0], np.cumsum(x)])
        at = np.arange(n)
        return np.asarray(total[np.minimum(at + horizon, n)] - total[np.maximum(at - before, 0)])

    ss, sc = ahead(w, signature**2), constant * ahead(w, signature)
    se, cc, ce = ahead(we, signature), constant**2 * window(w), constant * window(we)
    cc = np.maximum(cc, 1e-12)
    information = np.maximum(ss - sc**2 / cc, 1e-12)
    return (se - sc * ce / cc) / information, 1.0 / np.sqrt(information)


def find_step(
    series: Array,
    calm: NDArray[np.bool_],
    horizons: tuple[int, ...],
    least: float,
    noise: float,
    threshold: float,
    witness: Array | None = None,
    config: StepConfig | None = None,
) -> Step | None:
    """The surest lasting step of (N,) values, NaN = unknown; None where there is none.

    calm: (N,) values of better quality. horizons: values after a step by which it may be certain, ascending; no
    step is told before the first. least: smallest size. noise: least standard deviation of an innovation.
    threshold: least size in standard deviations. witness: (N,) the same measured otherwise, which must show
    the step as well.
    """
    config = config or StepConfig()
    known = np.isfinite(series)
    at, reach = np.arange(len(series)), horizons[0]
    if known.sum() < 2 * reach:
        return None
    # A short drive has not shown how far its values may stray.
    threshold *= 1.0 + (config.short_drive / float(known.sum())) ** 2
    white = _whiten(series, calm, noise, config)
    first = int(np.argmax(known))
    usable = known & (at >= first + config.skipped) & (at <= len(series) - reach)
    usable &= _seen_around(known, reach, config.known_share)
    if not usable.any():
        return None
    found = [_likelihood(white, horizon, config.before) for horizon in horizons]
    scores = [np.abs(size) / sigma for size, sigma in found]
    size, score = found[-1][0], scores[-1]
    candidates = np.flatnonzero(usable & (score > threshold) & (np.abs(size) > least))
    by_witness = size
    if witness is not None:
        by_witness = _likelihood(_whiten(witness, calm, noise, config), horizons[-1], config.before)[0]
    for k in candidates[np.argsort(-score[candidates])][: config.candidates].tolist():
        seen = by_witness[k] * np.sign(size[k]) > config.stays * abs(size[k])
        without = white.without(k, float(size[k]))
        alone = _alone(without, k, float(size[k]), config)
        if not (seen and alone and _stays(series, k, float(size[k]), config)):
            continue
        # Where the series is no autoregression the scores scatter more than they should.
        others, deviations = _likelihood(without, reach, config.before)
        scatter = max(SIGMA_PER_MAD * float(np.median((np.abs(others) / deviations)[usable])), 1.0)
        if score[k] > threshold * scatter:
            ready = [h for h, s in zip(horizons, scores, strict=True) if s[k] > threshold * scatter]
            certain = min(k + ready[0], len(series)) - 1
            short = _likelihood(white, config.shortest, config.before)
            estimates = [(a[k], d[k]) for a, d in (short, *found)]
            sharp = [e for e in estimates if e[1] < config.sharp[witness is not None] * abs(size[k])]
            best, deviation = (sharp or estimates[-1:])[0]
            if abs(best) < least:
                continue
            return Step(k, certain, float(best), float(deviation), float(score[k]) / scatter)
    return None


def _seen_around(known: NDArray[np.bool_], reach: int, share: float) -> NDArray[np.bool_]:
    """Values all around, or nothing is said: what fails beside a jump is no mount."""
    seen = np.concatenate([[0], np.cumsum(known)])
    at = np.arange(len(known))
    ahead, behind = np.minimum(at + reach, len(known)), np.clip(at - reach, np.argmax(known), at)
    enough = seen[ahead] - seen[at] >= share * (ahead - at)
    return np.asarray(enough & (seen[at] - seen[behind] >= share * (at - behind)))


def _alone(white: _White, onset: int, size: float, config: StepConfig) -> bool:
    """Whether the innovations near a step, its own part taken out, are small beside it."""
    rest = white.innovations - white.level
    near = slice(max(onset - config.near, 0), onset + config.near + 1)
    usual = 1.0 / np.sqrt(np.median(white.weights[white.weights > 0]))
    limit = max(config.calm * abs(size), config.usual * usual)
    return bool(np.abs(rest[near])[white.weights[near] > 0].max(initial=0.0) < limit)


def _stays(series: Array, onset: int, size: float, config: StepConfig) -> bool:
    """Whether the values rise by the step at once and stay there."""
    at = np.arange(len(series))
    known = np.isfinite(series)
    before, after = series[known & (at < onset)], series[known & (at >= onset)]
    if min(len(before), len(after)) < 8:
        return False

    def rise(count: int) -> float:
        return float(np.sign(size) * (np.median(after[:count]) - np.median(before[-count:])) / abs(size))

    return max(map(rise, config.at_once)) > config.stays and max(map(rise, config.later)) > config.stays
