"""What one stereo pair gives on the way to its road: every intermediate picture, the estimate, and the reasons."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.errors import Failure
from stereocalib_core.front.road.paper import PaperFit
from stereocalib_core.front.road.plane import DirectFit
from stereocalib_core.front.road.region import Region
from stereocalib_core.front.road.uv_disparity import v_disparity
from stereocalib_core.numeric.arrays import Mask
from stereocalib_core.results import Check, DisparityMap, RoadEstimate


@dataclass(frozen=True)
class RoadResult:
    """Every stage of one pair, in the order of the method; a stage that was not reached is None, or an empty array.

    u_disparity: (D, w) int32, cells of each column by disparity bin (bin k: [k, k + 1) bin_px).
    obstacles, free, road: (h, w) bool on the disparity grid; road = free cells that agree with the final plane.
    paper: the profile and eq. 12, where somebody asked for them. direct: the alignment of grey values.
    estimate: by the method chosen; once a pair is through, it is None exactly when `failure` is not.
    timing_ms names the stages that ran.
    """

    disparity: DisparityMap = DisparityMap(np.zeros((0, 0), np.float32), 1)
    bin_px: float = 1.0
    u_disparity: NDArray[np.int32] = field(default_factory=lambda: np.zeros((0, 0), np.int32))
    obstacles: Mask = field(default_factory=lambda: np.zeros((0, 0), np.bool_))
    free: Mask = field(default_factory=lambda: np.zeros((0, 0), np.bool_))
    road: Mask = field(default_factory=lambda: np.zeros((0, 0), np.bool_))
    region: Region | None = None
    paper: PaperFit | None = None
    direct: DirectFit | None = None
    free_fraction: float | None = None
    estimate: RoadEstimate | None = None
    failure: Failure | None = None
    checks: tuple[Check, ...] = ()
    timing_ms: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))

    @property
    def drawable(self) -> bool:
        """Whether there is a disparity with its free map to show."""
        return self.free.size > 0

    @property
    def matched(self) -> DisparityMap | None:
        """The disparity, None for a pair that was not matched."""
        return self.disparity if self.disparity.values.size else None

    @cached_property
    def v_disparity(self) -> NDArray[np.int32]:
        """(h, D) counts of the free map."""
        return v_disparity(self.disparity.values, self.free, self.bin_px, len(self.u_disparity))

    @cached_property
    def v_disparity_whole(self) -> NDArray[np.int32]:
        """(h, D) counts of the whole map."""
        values = self.disparity.values
        return v_disparity(values, values > 0, self.bin_px, len(self.u_disparity))

    @property
    def profile(self) -> tuple[float, float] | None:
        """Slope and intercept of the road profile v = slope Delta + intercept (image px)."""
        return None if self.paper is None else (self.paper.profile.slope, self.paper.profile.intercept_px)
