"""What the front end keeps of each frame: small, immutable, and all that the back end ever sees."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.errors import Failure
from stereocalib_core.geometry import Extrinsics
from stereocalib_core.results.own_car import OwnCarMemory
from stereocalib_core.results.scan import ScanSample

TO_DEGREES = np.array([1.0, *np.rad2deg([1.0, 1.0])])
"""(3,) factors from height [m], pitch, roll [rad] to metres and degrees, as files have them."""


@dataclass(frozen=True, slots=True)
class Check:
    """One number of one stage against its limit, for whoever asks why a frame failed.

    `low` and `high` are the limits, None = unbounded; `unit` is for display.
    """

    stage: str
    name: str
    value: float
    low: float | None = None
    high: float | None = None
    unit: str = ""

    @property
    def ok(self) -> bool:
        """Whether the value is a number within its limits."""
        above = self.low is None or self.value >= self.low
        below = self.high is None or self.value <= self.high
        return bool(np.isfinite(self.value)) and above and below


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


@dataclass(frozen=True, slots=True)
class RoadEstimate:
    """The road as one stereo pair shows it.

    extrinsics: height, pitch, roll (yaw is 0: one pair cannot show it).
    covariance: (3, 3) of height [m], pitch [rad], roll [rad] over the road that was used.
    inliers: pixels (or v-disparity cells) that agree with the plane.
    free_fraction: free pixels / pixels below the horizon, 0...1.
    range_m: nearest and farthest road distance used.
    bend: height [m] and pitch [rad] by which the lane as a whole differs, where the road bends up or down ahead.
    crossfall_rad: 1 sigma of the roll by which it may differ: one side of a crown, or another road's in a turn.
    along: 1 sigma of height [m] and pitch [rad], together, that the crossfall makes where the car turns.
    alone: 1 sigma of pitch and roll [rad] of not being the road at all: what a pair with nothing before it can't tell.
    """

    extrinsics: Extrinsics
    covariance: NDArray[np.float64]
    inliers: int
    free_fraction: float
    range_m: tuple[float, float]
    bend: tuple[float, float] = (0.0, 0.0)
    crossfall_rad: float = 0.0
    along: tuple[float, float] = (0.0, 0.0)
    alone: tuple[float, float] = (0.0, 0.0)

    @property
    def bend_covariance(self) -> NDArray[np.float64]:
        """(3, 3) what `bend`, crossfall and doubt add to `covariance`: no other look at the same road averages it out.

        Another plane than the road meets it about where the car is, halfway to what is seen of it.
        """
        pitch, roll = self.alone
        bend, along = np.array([*self.bend, 0.0]), np.array([*self.along, 0.0])
        other = np.array([0.25 * sum(self.range_m) * pitch, pitch, 0.0])
        return (
            np.outer(bend, bend)
            + np.outer(along, along)
            + np.outer(other, other)
            + np.diag([0.0, 0.0, self.crossfall_rad**2 + roll**2])
        )

    @property
    def sigma(self) -> NDArray[np.float64]:
        """(3,) standard deviations of height [m], pitch [rad], roll [rad], `bend_covariance` included."""
        return np.sqrt(np.diag(self.covariance + self.bend_covariance))


@dataclass(frozen=True, slots=True)
class RectificationSample:
    """What one pair says of its own rectification, by the rows of left and right matches.

    values: (3,) row offset [px], relative pitch [rad], relative roll [rad] of the right camera.
    covariance: (3, 3). matches: how many left-right matches were used.
    keystone_rad: the part of the row offset that grows with u v, as the relative yaw that it would be.
    """

    values: NDArray[np.float64]
    covariance: NDArray[np.float64]
    matches: int
    keystone_rad: float = 0.0

    def down_px(
        self, focal_px: float, x_right: NDArray[np.float64], y: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """(N,) [px] right row minus left row: a (1 + y^2) + f x (roll + keystone y), x and y in the right picture over
        the focal length."""
        offset, _, roll = self.values
        return np.asarray(offset * (1.0 + y * y) + focal_px * x_right * (roll + self.keystone_rad * y))


@dataclass(frozen=True, slots=True)
class Tracks:
    """Points seen in two consecutive stereo pairs, independent of every correction setting.

    points: (N, 6) float32: u, v, disparity in the previous pair, then u, v, disparity in this one [px];
        disparities are geometric (offset removed), NaN where the left-right match was lost.
    on_road: (N,) bool, True for points of the measured road, False for points above it.
    previous: index of the previous frame of the pair.
    lean: (N, 2) float32 in the previous pair and in this one: by so much a disparity is read too small for every pixel
        that the right picture's row lies lower than the left one's. None = not known, taken for zero.
    """

    points: NDArray[np.float32]
    on_road: NDArray[np.bool_]
    previous: int
    lean: NDArray[np.float32] | None = None

    def __len__(self) -> int:
        return len(self.points)


@dataclass(frozen=True, slots=True)
class RoadResidual:
    """The LiDAR's road minus the stereo road of one frame: what the calibration between the two gets wrong.

    values: (3,) height [m], pitch, roll [rad] that the LiDAR adds to the stereo extrinsics, signs as there:
        the LiDAR stands higher, looks further down, leans further right over the road than calibrated.
    covariance: (3, 3), both sensors together. points: LiDAR points used.
    """

    values: NDArray[np.float64]
    covariance: NDArray[np.float64]
    points: int


@dataclass(frozen=True, slots=True)
class FrameResult:
    """One frame through the front end. `road` is None exactly when `failure` is not.

    disparities: (K, 8) by the LiDAR beside those by the pair, columns as in `front.scan.scan_disparity`.
    """

    frame: int
    timestamp_s: float
    road: RoadEstimate | None
    failure: Failure | None = None
    free_fraction: float | None = None
    inliers: int | None = None
    rectification: RectificationSample | None = None
    tracks: Tracks | None = None
    checks: Sequence[Check] = ()
    timing_ms: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    lidar: RoadResidual | None = None
    scan: ScanSample | None = None
    disparities: NDArray[np.float32] | None = None

    @property
    def ok(self) -> bool:
        """Whether the pair shows the road."""
        return self.road is not None

    @property
    def status(self) -> str:
        """`ok` or `failed`."""
        return "ok" if self.ok else "failed"

    @property
    def reason(self) -> str:
        """The failure's name, or empty."""
        return "" if self.failure is None else str(self.failure.reason)


@dataclass(frozen=True, slots=True)
class FrontEndMemory:
    """What the next frame depends on, small enough to be kept beside every result.

    tracked: index of the pair that the next tracks start from. motion: (6,) into it per frame, or None.
    own_car: what is known of the own car in the picture.
    """

    tracked: int | None
    motion: NDArray[np.float64] | None
    own_car: OwnCarMemory = OwnCarMemory()


def estimates(results: Sequence[FrameResult]) -> NDArray[np.float64]:
    """(N, 3) height [m], pitch, roll [rad] of each pair by itself, NaN where the frame failed."""
    rows = [
        (r.road.extrinsics.height_m, r.road.extrinsics.pitch_rad, r.road.extrinsics.roll_rad)
        if r.road is not None
        else (np.nan,) * 3
        for r in results
    ]
    return np.array(rows, dtype=np.float64).reshape(-1, 3)


@dataclass(frozen=True)
class FilteredExtrinsics:
    """Height, pitch and roll of a drive after the filter.

    values: (N, 3) height [m], pitch, roll [rad], NaN where there is none. covariance: (N, 3, 3).
    state: per frame `updated`, `predicted` (no measurement in this frame), or `none`.
    """

    values: NDArray[np.float64]
    covariance: NDArray[np.float64]
    state: tuple[str, ...]

    @property
    def sigma(self) -> NDArray[np.float64]:
        """(N, 3) standard deviations of height [m], pitch, roll [rad]."""
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))


@dataclass(frozen=True, slots=True)
class Measured:
    """A number with its standard deviation, in the same unit."""

    value: float
    sigma: float
