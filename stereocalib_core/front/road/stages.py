"""What the road stage saw, kept only for display: every intermediate picture of one stereo pair."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.errors import Failure
from stereocalib_core.geometry import Extrinsics
from stereocalib_core.results import Check, RoadEstimate


@dataclass(frozen=True)
class DisparityMap:
    """Dense disparity on a grid that may be coarser than the image.

    values: (h, w) float32, geometric disparity in full-resolution pixels, NaN = invalid.
    step_px: image pixels per grid cell; cell (column j, row i) is centred on image point
        u = (j + 0.5) step - 0.5, v = (i + 0.5) step - 0.5.
    """

    values: NDArray[np.float32]
    step_px: int

    def columns_u(self) -> NDArray[np.float64]:
        """(w,) image u [px] of the cell centres."""
        return (np.arange(self.values.shape[1], dtype=np.float64) + 0.5) * float(self.step_px) - 0.5

    def rows_v(self) -> NDArray[np.float64]:
        """(h,) image v [px] of the cell centres."""
        return (np.arange(self.values.shape[0], dtype=np.float64) + 0.5) * float(self.step_px) - 0.5


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
