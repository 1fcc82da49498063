"""u-disparity and v-disparity: how often each disparity occurs in each column or row."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(cache=True, nogil=True)
def u_disparity(values: NDArray[np.float32], bin_px: float, bins: int) -> NDArray[np.int32]:
    """(h, w) disparity [px, NaN = invalid] to (bins, w) counts; bin k holds [k, k + 1) bin_px."""
    height, width = values.shape
    counts = np.zeros((bins, width), np.int32)
    for i in range(height):
        for j in range(width):
            d = values[i, j]
            if d > 0:
                k = int(d / bin_px)
                if k < bins:
                    counts[k, j] += 1
    return counts


@njit(cache=True, nogil=True)
def v_disparity(
    values: NDArray[np.float32], mask: NDArray[np.bool_], bin_px: float, bins: int
) -> NDArray[np.int32]:
    """(h, w) disparity [px] where `mask` to (h, bins) counts; bin k holds [k, k + 1) bin_px."""
    height, width = values.shape
    counts = np.zeros((height, bins), np.int32)
    for i in range(height):
        for j in range(width):
            if mask[i, j]:
                k = int(values[i, j] / bin_px)
                if 0 <= k < bins:
                    counts[i, k] += 1
    return counts
