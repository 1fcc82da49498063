"""From the grey of a perfect sensor to the picture of a real one: blur, falloff, exposure, noise, rounding."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numba import njit
from numpy.typing import NDArray

_TABLE_BITS = 20
READ_NOISE, SHOT_NOISE = 1.0, 0.022
"""Variance = READ_NOISE^2 + SHOT_NOISE * grey, in grey levels."""


@lru_cache(maxsize=1)
def noise_table() -> NDArray[np.float32]:
    """(2^20,) normal numbers."""
    return np.random.default_rng(1234567).standard_normal(1 << _TABLE_BITS, dtype=np.float32)


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def _scramble(value):  # type: ignore[no-untyped-def]
    value = np.uint64(value)
    value ^= value >> np.uint64(30)
    value *= np.uint64(0xBF58476D1CE4E5B9)
    value ^= value >> np.uint64(27)
    value *= np.uint64(0x94D049BB133111EB)
    return value ^ (value >> np.uint64(31))


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def expose(grey, gain, vignetting, noise, key, table, blur, picture):  # type: ignore[no-untyped-def]
    """grey (H, W) float32 to picture (H, W) uint8.

    gain: exposure; vignetting: share lost in the far corners; noise: amount, 1 = default; key: names the noise;
    blur: share of light that goes to each neighbour.
    """
    height, width = grey.shape
    mask = table.shape[0] - 1
    cy, cx = 0.5 * (height - 1), 0.5 * (width - 1)
    corner = 1.0 / (cx * cx + cy * cy)
    row = np.empty(width, np.float32)
    for y in range(height):
        above, below = max(y - 1, 0), min(y + 1, height - 1)
        for x in range(width):
            row[x] = (1 - 2 * blur) * grey[y, x] + blur * (grey[above, x] + grey[below, x])
        start = int(_scramble(np.uint64(key) * np.uint64(65537) + np.uint64(y)) & np.uint64(mask))
        dy = (y - cy) * (y - cy)
        for x in range(width):
            value = (1 - 2 * blur) * row[x] + blur * (row[max(x - 1, 0)] + row[min(x + 1, width - 1)])
            value *= gain * (1.0 - vignetting * ((x - cx) * (x - cx) + dy) * corner)
            if noise > 0.0:
                sigma = np.sqrt(READ_NOISE * READ_NOISE + SHOT_NOISE * max(value, 0.0))
                value += noise * sigma * table[(start + x) & mask]
            picture[y, x] = np.uint8(min(max(value + 0.5, 0.0), 255.0))
