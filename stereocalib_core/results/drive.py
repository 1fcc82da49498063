"""The one typed result of a drive: what the back end makes of it, what files write and read back.

Metres, radians, pixels and seconds; files and pages turn them into degrees.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.config import PipelineConfig
from stereocalib_core.config.verdicts import MIN_OK_FRACTION
from stereocalib_core.errors import FailureReason
from stereocalib_core.geometry import Extrinsics
from stereocalib_core.results.frame import FrameResult, Measured
from stereocalib_core.results.pair import Mending, Pair
from stereocalib_core.results.table import FrameTable

Array = NDArray[np.float64]
Axis = Literal["height", "pitch", "roll", "yaw"]

ANGLES = ("pitch", "roll", "yaw")
"""Axes of which a shift is in radians; of the others, in metres."""
BEST = "autocalibrated"
"""The path that speaks for the drive: every correction, default model."""


@dataclass(frozen=True)
class Rig:
    """What one drive teaches of the rig and the next may start from; None = not known.

    Nominal height and lever arm (rear axle to camera) [m], pitch, roll and yaw [rad]. note: what to mind, if anything.
    """

    height_m: Measured | None = None
    pitch_rad: Measured | None = None
    roll_rad: Measured | None = None
    yaw_rad: Measured | None = None
    lever_arm_m: Measured | None = None
    note: str | None = None

    @property
    def T_vehicle_camera(self) -> Array | None:
        """(4, 4), None where height, pitch or roll is not known; a yaw that is not known is taken as zero."""
        if self.height_m is None or self.pitch_rad is None or self.roll_rad is None:
            return None
        yaw = 0.0 if self.yaw_rad is None else self.yaw_rad.value
        pose = Extrinsics(self.height_m.value, self.pitch_rad.value, self.roll_rad.value, yaw)
        return pose.T_vehicle_camera


@dataclass(frozen=True)
class Tolerance:
    """How one axis of the mount should be [m or rad]."""

    nominal: float
    tolerance: float

    def holds(self, value: float) -> bool:
        """Whether `value` is within the limits."""
        return abs(value - self.nominal) <= self.tolerance


@dataclass(frozen=True)
class Shift:
    """One shift of the mount. size: [m] for height, else [rad]; sigma likewise; frame: where it began.

    detected_at: the frame by which it was certain.
    """

    frame: int
    axis: Axis
    size: float
    sigma: float
    kind: Literal["step", "drift"]
    detected_at: int


@dataclass(frozen=True)
class OdometryErrors:
    """One path against the truth, in the units of the benchmarks; None = no truth to compare with.

    path_m, path_gt_m: lengths of the two paths over the frames that both have. final_translation: in the x-z
    plane of the first camera frame, percent of path_gt_m. final_rotation: heading. t_rel, r_rel: KITTI's.
    measured_percent: of the way, what was measured on the road; where that is less than half the path is a gap, and
    neither its length nor its errors are given.
    """

    path_m: float | None
    path_gt_m: float | None = None
    final_translation_m: float | None = None
    final_translation_percent: float | None = None
    final_rotation_deg: float | None = None
    final_rotation_deg_per_m: float | None = None
    t_rel_percent: float | None = None
    r_rel_deg_per_m: float | None = None
    measured_percent: float | None = None


@dataclass(frozen=True)
class DrivePath:
    """One path of the left camera.

    poses: (N, 4, 4) T_world_camera, world = first left camera, NaN where a file did not keep them.
    covariance: (N, 6, 6) of each pair's motion: rotation [rad], translation [m] in the axes of this frame's camera.
    """

    poses: Array
    covariance: Array
    errors: OdometryErrors


@dataclass(frozen=True)
class LidarShift:
    """One finding: `step` (moved during the drive) or `offset` (the calibration is off from the start).

    frame: the first frame that shows it. detected_at: the frame by which it was certain.
    size, sigma: [m] for height, x, z, else [rad]. moved: which of the two, as far as the camera's own road and path
    tell.
    """

    frame: int
    axis: Literal["height", "pitch", "roll", "yaw", "x", "z"]
    size: float
    sigma: float
    kind: Literal["step", "offset"]
    detected_at: int
    moved: Literal["lidar", "camera"] | None = None


@dataclass(frozen=True)
class Residual:
    """LiDAR minus camera on one axis over a drive [m or rad].

    scatter: 1.4826 times the median distance from the median. rms: about the median. sigma: of one value: of one frame
    for height, pitch and roll, of one stretch for yaw, x and z.
    """

    median: float
    scatter: float
    rms: float
    sigma: float


@dataclass(frozen=True)
class LidarSeries:
    """The residuals frame by frame; M entries, one for each frame with both a scan and a stereo road.

    frames: (M,) frame numbers. values, sigma: (M, 3) height [m], pitch, roll [rad] of each frame by itself.
    filtered, filtered_sigma: (M, 3), with the frames before.
    """

    frames: NDArray[np.int64]
    values: Array
    sigma: Array
    filtered: Array
    filtered_sigma: Array


@dataclass(frozen=True)
class LidarStretches:
    """All six between LiDAR and camera, stretch by stretch; S entries.

    first, last: (S,) frame numbers. values, sigma: (S, 6) height [m], pitch, roll, yaw [rad], x, z [m] by which the
    LiDAR stands otherwise than calibrated, in the camera's axes and with the signs of its extrinsics.
    """

    first: NDArray[np.int64]
    last: NDArray[np.int64]
    values: Array
    sigma: Array


@dataclass(frozen=True)
class LidarPose:
    """Where the LiDAR stands, after the last slip if there was one.

    calibrated, T_camera_lidar: (4, 4) as it was told and as it was found. six, sigma: (6,) of the difference, as in
    `LidarStretches`, NaN where it was not measured and left as told. first, last: the frames that say so.
    """

    calibrated: Array
    T_camera_lidar: Array
    six: Array
    sigma: Array
    first: int
    last: int


@dataclass(frozen=True)
class LidarCheck:
    """Do camera and LiDAR still agree? frames: how many with a road say so. unseen: what they cannot say.

    height_m, pitch_rad, roll_rad: by the road, None where no frame shows one. yaw_rad, x_m, z_m: None where they could
    not be measured; why: what was lacking.
    series, stretches: the residuals behind it, where they are at hand. pose: where the LiDAR is, for a mended
    calibration.
    """

    height_m: Residual | None
    pitch_rad: Residual | None
    roll_rad: Residual | None
    shifts: tuple[LidarShift, ...]
    frames: int
    unseen: str
    series: LidarSeries | None = None
    yaw_rad: Residual | None = None
    x_m: Residual | None = None
    z_m: Residual | None = None
    why: str | None = None
    stretches: LidarStretches | None = None
    pose: LidarPose | None = None


@dataclass(frozen=True)
class Cause:
    """What probably made frames `first` to `last` fail or doubtful, and what to do about it."""

    first: int
    last: int
    reason: str
    cause: str
    remedy: str


@dataclass(frozen=True)
class Timing:
    """Median milliseconds of each stage over the frames that went through it, `total` of a whole frame."""

    stages_ms: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    frames_per_second: float | None = None

    @classmethod
    def of(cls, results: Sequence[FrameResult], elapsed_s: float, total_ms: Sequence[float] = ()) -> Timing:
        """elapsed_s: wall time of all `results`. total_ms: wall time of each frame, its reading included."""
        by_stage: dict[str, list[float]] = {}
        for result in results:
            for stage, value in result.timing_ms.items():
                by_stage.setdefault(stage, []).append(value)
        if len(total_ms):
            by_stage["total"] = list(total_ms)
        medians = {stage: round(float(np.median(values)), 3) for stage, values in by_stage.items()}
        return cls(medians, len(results) / elapsed_s if elapsed_s > 0 else None)


@dataclass(frozen=True)
class Drive:
    """What a whole drive says.

    source: the SOURCE that it came from. mount: the rig as this drive leaves it. yaw_reason: why there is no yaw, or
    what was used instead. limits: what the mount is judged by, by the names of its fields. gaps: first and last
    frame of every stretch without a measurement. paths: by variant. lidar: None without scans. mended: what was applied
    to the pair before anything else, by `--self-calibrate`. notices: what the
    recording lacks. config: the settings, where they are known.
    """

    frames: FrameTable
    source: str = ""
    method: str = ""
    mount: Rig = Rig()
    yaw_reason: str | None = None
    limits: Mapping[str, Tolerance] = field(default_factory=lambda: MappingProxyType({}))
    pair: Pair = Pair()
    mended: Mending | None = None
    paths: Mapping[str, DrivePath] = field(default_factory=lambda: MappingProxyType({}))
    gaps: tuple[tuple[int, int], ...] = ()
    shifts: tuple[Shift, ...] = ()
    lidar: LidarCheck | None = None
    causes: tuple[Cause, ...] = ()
    timing: Timing = Timing()
    notices: tuple[str, ...] = ()
    config: PipelineConfig | None = None

    @classmethod
    def of_frames(cls, results: Sequence[FrameResult], config: PipelineConfig) -> Drive:
        """What the frames by themselves say, for a drive that was stopped on its way."""
        frames, reason = FrameTable.of(results), "the drive was not analysed"
        return cls(frames, method=config.method, yaw_reason=reason, gaps=frames.gaps(), config=config)

    @property
    def poses(self) -> Array | None:
        """(N, 4, 4) T_world_camera of the path that speaks for the drive, None where there is none."""
        best = self.paths.get(BEST)
        return None if best is None or not np.isfinite(best.poses).any() else best.poses

    @property
    def frames_ok(self) -> int:
        """How many frames are ok."""
        return int(self.frames.ok.sum())

    @property
    def why_not(self) -> str | None:
        """Why the result must not be trusted, None when it may be."""
        found = []
        if self.frames_ok < MIN_OK_FRACTION * len(self.frames):
            reasons = ", ".join(f"{count} {reason}" for reason, count in self.frames.failures.items())
            found.append(f"only {self.frames_ok} of {len(self.frames)} frames are ok ({reasons})")
        found.extend(c.cause for c in self.causes if c.reason == FailureReason.CALIBRATION)
        if self.pair.verdict == "bad":
            found.append(f"the stereo pair is bad ({self.pair.why.partition(';')[0]})")
        if self.within_tolerance is False:
            outside = ", ".join(axis.rpartition("_")[0] for axis in self.limits if self.within(axis) is False)
            found.append(f"the mount is outside its tolerance ({outside})")
        best = self.paths.get(BEST)
        if best is not None and best.errors.path_m is None:
            share = best.errors.measured_percent or 0.0
            why = f" ({self.yaw_reason})" if self.yaw_reason is not None and share < 1.0 else ""
            found.append(
                f"the odometry is a gap: only {share:.0f} % of the way was measured on the road{why}"
            )
        return "; ".join(found) or None

    def within(self, axis: str) -> bool | None:
        """Whether a field of `mount` holds its limit; None where it was not measured or has none."""
        measured, limit = getattr(self.mount, axis), self.limits.get(axis)
        return None if measured is None or limit is None else limit.holds(measured.value)

    @property
    def within_tolerance(self) -> bool | None:
        """Whether every limited axis holds; None without limits, or when one was not measured."""
        judged = [self.within(axis) for axis in self.limits]
        return None if not judged or None in judged else all(judged)
