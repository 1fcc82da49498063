"""Shapes over the square -1...1 by -1...1 that leave its least-squares plane alone: mean zero, no slope."""

from __future__ import annotations

import numpy as np

from stereocalib_core.numeric.arrays import Array

_FURTHER = np.array([1.25, 1.0, 0.6, 0.4])
"""How large the further shapes are against each other: the higher the order the smaller."""


def bends(x: Array, z: Array) -> Array:
    """(N, 3): bent across, twisted, and bent along; of size 1 at x = 1, at z = 1."""
    return np.column_stack([x * x - 1.0 / 3.0, x * z, z * z - 1.0 / 3.0])


def further_bends(x: Array, z: Array) -> Array:
    """(N, 4): bent along, and the next orders, the higher the smaller."""
    xx, zz = x * x - 1.0 / 3.0, z * z - 1.0 / 3.0
    return np.column_stack([zz, x * zz, xx * z, z**3 - 0.6 * z]) * _FURTHER


def unseen_share(x: Array, z: Array) -> float:
    """Share of the square without a point, counted in cells of an eighth of its length and a quarter of its width."""
    inside = np.abs(x) < 1.0
    rows = (4.0 * (z[inside] + 1.0)).astype(int).clip(0, 7)
    columns = (2.0 * (x[inside] + 1.0)).astype(int).clip(0, 3)
    return 1.0 - len(np.unique(rows * 4 + columns)) / 32
