"""Steps in a noisy series: a generalised likelihood ratio on whitened values.

An autoregression of the series takes out its slow swing, so that what is left jumps where a step begins. Each
index is tried as the onset: least squares for level and step over the values around it give the size and its
standard deviation.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

Array = NDArray[np.float64]

_LAGS = 4
_REACH, _PART = 60, 8
"""Values on either side over which a step must last, and the parts in which that is looked at."""
_BEFORE = 60
"""Values before a step that its level is compared with."""


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
    """Innovations (N,) of an autoregression, their weights (N,) = 1 / variance, 0 where unknown, and its lags."""

    innovations: Array
    weights: Array
    coefficients: Array


def _whiten(series: Array, calm: NDArray[np.bool_], noise: float) -> _White:
    """Fit an autoregression to the series without its level and give its innovations.

    calm: (N,) values of better quality; the two kinds get a variance each. noise: least standard deviation.
    """
    known = np.isfinite(series)
    at = np.arange(len(series))
    filled = np.interp(at, at[known], series[known])
    flat = filled - median_filter(filled, size=121, mode="nearest")
    rows = at[_LAGS:]
    past = np.stack([flat[rows - k] for k in range(1, _LAGS + 1)], axis=1)
    limit = 5.0 * 1.4826 * float(np.median(np.abs(flat))) + 1e-12
    whole = known[rows] & np.all([known[rows - k] for k in range(1, _LAGS + 1)], axis=0)
    clean = whole & (np.abs(past) < limit).all(axis=1) & (np.abs(flat[rows]) < limit)
    coefficients = np.zeros(_LAGS)
    if clean.sum() >= 10 * _LAGS:
        ridge = 1e-3 * float((past[clean] ** 2).sum()) / _LAGS + 1e-18
        normal = past[clean].T @ past[clean] + ridge * np.eye(_LAGS)
        coefficients = np.linalg.solve(normal, past[clean].T @ flat[rows][clean])
    innovations, weights = np.zeros(len(series)), np.zeros(len(series))
    before = np.stack([filled[rows - k] for k in range(1, _LAGS + 1)], axis=1)
    innovations[rows] = filled[rows] - before @ coefficients
    level = (1.0 - coefficients.sum()) * (filled - flat)
    # Where several frames nearby are wild, one more is no news; a step itself is wild in a frame or two only.
    restless = 1.4826 * median_filter(np.abs(innovations - level), size=21, mode="reflect")
    for kind in (calm, ~calm):
        chosen = np.zeros(len(series), dtype=bool)
        chosen[rows] = whole & kind[rows]
        if chosen.any():
            deviation = 1.4826 * float(np.median(np.abs((innovations - level)[chosen])))
            usual = max(deviation, noise)
            weights[chosen] = 1.0 / np.where(restless > 1.7 * usual, restless, usual)[chosen] ** 2
    return _White(innovations, weights, coefficients)


def _likelihood(white: _White, horizon: int) -> tuple[Array, Array]:
    """(N,) size of a step at each index as `horizon` values after it show it, and its standard deviation."""
    n = len(white.innovations)
    constant = 1.0 - float(white.coefficients.sum())
    signature = np.ones(horizon)
    for k in range(1, horizon):
        signature[k] = 1.0 - float(white.coefficients[: min(k, _LAGS)].sum())
    w, we = white.weights, white.weights * white.innovations

    def ahead(x: Array, kernel: Array) -> Array:
        return np.correlate(np.concatenate([x, np.zeros(horizon - 1)]), kernel, "valid")

    def window(x: Array) -> Array:
        total = np.concatenate([[0.0], np.cumsum(x)])
        at = np.arange(n)
        return np.asarray(total[np.minimum(at + horizon, n)] - total[np.maximum(at - _BEFORE, 0)])

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
) -> Step | None:
    """The surest lasting step of (N,) values, NaN = unknown; None where there is none.

    calm: (N,) values of better quality. horizons: values after a step by which it may be certain. least:
    smallest size. noise: least standard deviation of an innovation. threshold: least size in standard
    deviations.
    """
    known = np.isfinite(series)
    if known.sum() < 2 * horizons[0]:
        return None
    # A short drive has not shown how far its values may stray.
    threshold *= 1.0 + 5.0 / float(known.sum())
    white = _whiten(series, calm, noise)
    # Values all around, or nothing is said: what fails beside a jump is no mount.
    seen = np.concatenate([[0], np.cumsum(known)])
    at, reach = np.arange(len(series)), horizons[0]
    ahead, behind = np.minimum(at + reach, len(series)), np.maximum(at - reach, 0)
    dense = seen[ahead] - seen[at] >= 0.85 * (ahead - at)
    dense &= seen[at] - seen[behind] >= 0.85 * (at - behind)
    best: Step | None = None
    for horizon in horizons:
        size, sigma = _likelihood(white, horizon)
        score = np.abs(size) / sigma
        usable = np.arange(len(series))
        usable = (usable >= 10) & (usable <= len(series) - min(horizon, horizons[0])) & dense
        if horizon == horizons[0]:
            usable &= _mostly(calm, reach)
        if not usable.any():
            continue
        # Where the series is no autoregression the scores scatter more than they should.
        score /= max(1.4826 * float(np.median(score[usable])), 1.0)
        candidates = np.flatnonzero(usable & (score > threshold) & (np.abs(size) > least) & known)
        for k in candidates[np.argsort(-score[candidates])][:40]:
            if lasts(series, calm, int(k), float(size[k])):
                if best is None or score[k] > 1.1 * best.score:
                    certain = min(int(k) + horizon, len(series)) - 1
                    best = Step(int(k), certain, float(size[k]), float(sigma[k]), float(score[k]))
                break
    if best is None:
        return None
    # Once it is known to be there, everything that follows tells its size.
    size, sigma = _likelihood(white, horizons[-1])
    return dataclasses.replace(best, size=float(size[best.onset]), sigma=float(sigma[best.onset]))


def _mostly(calm: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    """Whether four of five values around each index are calm: only there a step may be certain so soon."""
    total = np.concatenate([[0], np.cumsum(calm)])
    at = np.arange(len(calm))
    first, last = np.maximum(at - reach // 2, 0), np.minimum(at + reach, len(calm))
    return np.asarray(total[last] - total[first] >= 0.8 * (last - first))


def lasts(series: Array, calm: NDArray[np.bool_], onset: int, size: float) -> bool:
    """Whether a step is there at once, stays, and shows in calm values as well where there are enough.

    A mount that was knocked stands still again in the next frame: what follows differs from what went before by
    the size, soon and later, and scatters by less. A bump in the road or a bend fails one of these.
    """
    known = np.isfinite(series)
    at = np.arange(len(series))
    before, after = series[known & (at < onset)][-_REACH:], series[known & (at >= onset)][:_REACH]
    if len(before) < _PART or len(after) < _PART:
        return False
    side, size = np.sign(size), abs(size)
    soon = side * (np.median(after[:_PART]) - np.median(before[-_PART:]))
    later = side * (np.median(after[: 3 * _PART]) - np.median(before[-3 * _PART :]))
    if not (0.4 * size < soon < 1.8 * size and later > 0.5 * size):
        return False
    for block in (before[-2 * _PART :], after[: 2 * _PART]):
        if np.median(np.abs(block - np.median(block))) > 0.45 * size:
            return False
    near = 0.5 * (np.median(before[-3 * _PART :]) + np.median(after[: 3 * _PART]))
    for block, sign in ((before[::-1], -side), (after, side)):
        parts = block[: len(block) // _PART * _PART].reshape(-1, _PART)
        crossed = sign * (np.median(parts, axis=1) - near) < -0.25 * size
        # The body's own swing may carry one part in five across, not more.
        if crossed.sum() > len(parts) // 5:
            return False
    calm_before = series[known & calm & (at < onset)][-_REACH:]
    calm_after = series[known & calm & (at >= onset)][:_REACH]
    if len(calm_before) >= _PART and len(calm_after) >= _PART:
        return bool(side * (np.median(calm_after) - np.median(calm_before)) > 0.5 * size)
    return True
