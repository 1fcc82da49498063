"""What the road stage saw, kept only for display: every intermediate picture of one stereo pair."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.errors import Failure
from stereocalib_core.geometry import Extrinsics
from stereocalib_core.results import Check, DisparityMap, RoadEstimate

__all__ = ["DisparityMap", "RoadStages"]


@dataclass(frozen=True)
class RoadStages:
    """Every stage of one pair, in the order of the method.

    u_disparity: (D, w) int32, cells of each column by disparity bin (bin k: [k, k + 1) bin_px).
    obstacles, free, road: (h, w) bool on the disparity grid; road = free cells that agree with the final plane.
    v_disparity: (h, D) int32 of the free map; v_disparity_whole: the same of the whole map.
    profile: slope and intercept of the road profile v = slope Delta + intercept (image px), or None.
    paper: extrinsics by the profile and eq. 12, or None. estimate: the final one (by the method chosen), or None.
    """

    disparity: DisparityMap
    bin_px: float
    u_disparity: NDArray[np.int32]
    v_disparity: NDArray[np.int32]
    v_disparity_whole: NDArray[np.int32]
    obstacles: NDArray[np.bool_]
    free: NDArray[np.bool_]
    road: NDArray[np.bool_]
    profile: tuple[float, float] | None
    paper: Extrinsics | None
    estimate: RoadEstimate | None
    failure: Failure | None
    checks: tuple[Check, ...]
