"""What is known of the own car in the picture, and how far the search for it has come."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

OWN_CAR = "own car", "lowest rows that have some of it"
"""Stage and name of a frame's check of how much of the picture it is [px]; where nothing is found there is none."""


@dataclass(frozen=True, slots=True)
class OwnCarMemory:
    """What the search for the own car goes on from.

    tops: (C,) int16 per column of blocks, the highest row of blocks from which all down to the bottom is the own car,
        the number of rows where nothing is. None = no column has any.
    driven_m: since the search began. since_m: since the last picture that was kept.
    T: (4, 4) T_current_kept of that, None = not known.
    kept: frame and `driven_m` of the pictures that the next ones are compared with, the latest first.
    evidence: (2, r, C) int16 of blocks, summed, and in how many looks they were seen; None = not searched now.
    """

    tops: NDArray[np.int16] | None = None
    driven_m: float = 0.0
    since_m: float = 0.0
    T: NDArray[np.float64] | None = None
    kept: tuple[tuple[int, float], ...] = ()
    evidence: NDArray[np.int16] | None = None

    def numbered_from(self, first: int) -> OwnCarMemory:
        """The same of a drive whose frame 0 is this one's `first`."""
        return replace(self, kept=tuple((frame - first, at_m) for frame, at_m in self.kept))


def own_car_columns(memory: OwnCarMemory, put: Any) -> list[Any]:
    """As plain values; put: takes an array aside and gives its place."""
    m = memory
    return [put(m.tops), m.driven_m, m.since_m, put(m.T), [list(k) for k in m.kept], put(m.evidence)]


def own_car_of(stored: list[Any], get: Any) -> OwnCarMemory:
    """The same from what `own_car_columns` gave."""
    tops, driven_m, since_m, T, kept, evidence = stored
    return OwnCarMemory(
        get(tops), driven_m, since_m, get(T), tuple((frame, at_m) for frame, at_m in kept), get(evidence)
    )
