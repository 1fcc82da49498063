"""Robust statistics: what bad values cannot pull far."""

from __future__ import annotations

import numpy as np

from stereocalib_core.numeric.arrays import Array

SIGMA_PER_MAD = 1.4826
"""A normal distribution's standard deviation per median absolute deviation, 1 / Phi^-1(3/4)."""


def mad_sigma(residuals: Array, centre: float | None = 0.0) -> float:
    """Standard deviation of (N,) `residuals` by their median distance from `centre`; None: from their median."""
    about = np.median(residuals) if centre is None else centre
    return SIGMA_PER_MAD * float(np.median(np.abs(residuals - about)))


def cauchy_weights(residuals: Array, sigma: float, width: float = 2.0) -> Array:
    """(N,) weights that fall to one half at `width` sigmas."""
    return np.asarray(1.0 / (1.0 + (residuals / (width * sigma)) ** 2))


def cauchy_mean(values: Array, centre: float, sigma: float, rounds: int = 20) -> float:
    """Mean of (N,) values with `cauchy_weights` of a fixed sigma, from a first `centre`."""
    for _ in range(rounds):
        weight = cauchy_weights(values - centre, sigma)
        centre = float((weight * values).sum() / weight.sum())
    return centre
