"""Passes over the tens of millions of values of a long drive that need a stretch of them at a time in memory."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.spill import let_go

STRETCH = 1 << 16
"""Points that are looked at together, so that a long drive needs no more memory than a short one."""


def median_of(values: Array, of: NDArray[np.bool_]) -> float:
    """Of the values >= 0 where `of` holds; of what lies on the disk, a stretch at a time.

    First how many share their leading bits, which sort like the numbers; then only those in the middle are sorted.
    """
    counts = np.zeros(1 << 16, dtype=np.int64)
    for part in stretches(len(values)):
        counts += np.bincount(values[part][of[part]].view(np.int64) >> 48, minlength=len(counts))
        let_go(values)
    below = np.cumsum(counts)
    middle = (below[-1] - 1) // 2, below[-1] // 2
    first, last = np.searchsorted(below, middle, side="right")
    kept = []
    for part in stretches(len(values)):
        some = values[part][of[part]]
        bits = some.view(np.int64) >> 48
        kept.append(some[(bits >= first) & (bits <= last)])
        let_go(values)
    inside = np.sort(np.concatenate(kept))
    before = below[first - 1] if first else 0
    return float(np.mean([inside[m - before] for m in middle]))


def stretches(count: int) -> Iterator[slice]:
    """0...count in stretches."""
    for first in range(0, count, STRETCH):
        yield slice(first, min(first + STRETCH, count))
