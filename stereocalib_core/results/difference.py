"""What differs between two drives, each difference with its sigma. Metres and radians."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from stereocalib_core.config.verdicts import SIGNIFICANT_SIGMAS
from stereocalib_core.results.drive import Drive
from stereocalib_core.results.frame import Measured


@dataclass(frozen=True)
class MountDifference:
    """One axis of the mount in both drives."""

    a: Measured
    b: Measured

    @property
    def difference(self) -> float:
        """b - a."""
        return self.b.value - self.a.value

    @property
    def sigma(self) -> float:
        """Its standard deviation."""
        return math.hypot(self.a.sigma, self.b.sigma)

    @property
    def significant(self) -> bool:
        """Whether it exceeds three of them."""
        return abs(self.difference) > SIGNIFICANT_SIGMAS * self.sigma


@dataclass(frozen=True)
class AxisDifference:
    """One axis over the frames that are ok in both, b - a. rms_in_sigmas: each in units of its own sigma."""

    median: float
    rms: float
    rms_in_sigmas: float
    largest: float
    largest_at_frame: int


@dataclass(frozen=True)
class FramesDifference:
    """Two drives of the same pictures, frame by frame; an axis is None where no frame is ok in both."""

    common: int
    ok_in_both: int
    ok_only_in_a: int
    ok_only_in_b: int
    axes: Mapping[str, AxisDifference | None]


@dataclass(frozen=True)
class PathDifference:
    """Both paths as they are, each from its first left camera, unaligned."""

    a_m: float
    b_m: float
    rms_difference_m: float
    final_difference_m: float
    final_heading_difference_rad: float
    alignment: str = "none, both start at their first left camera"


@dataclass(frozen=True)
class Difference:
    """mount: by the fields of `Rig`, None where not known in both. frames, path: None for different pictures."""

    a: Drive
    b: Drive
    mount: Mapping[str, MountDifference | None]
    frames: FramesDifference | None
    path: PathDifference | None
