"""Spread that outliers cannot move."""

from __future__ import annotations

import numpy as np

from stereocalib_core.numeric.arrays import Array

SIGMA_PER_MAD = 1.4826
"""A normal distribution's standard deviation per median absolute deviation, 1 / Phi^-1(3/4)."""


def mad_sigma(residuals: Array, centre: float | None = 0.0) -> float:
    """Standard deviation of (N,) `residuals` by their median distance from `centre`; None: from their median."""
    about = np.median(residuals) if centre is None else centre
    return SIGMA_PER_MAD * float(np.median(np.abs(residuals - about)))
