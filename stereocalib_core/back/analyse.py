"""The back end: from the front end's results of a drive to what its rig is like and where the car went.

Arithmetic over small arrays only; no pixel is touched. The order is a table of contents: filter, yaw and
lever arm, the paths of every variant, the errors against the truth, the mount, the pair's own calibration, the shifts,
the causes of failed frames.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from stereocalib_core.back.causes import calibration_of_others, find_causes
from stereocalib_core.back.evaluation import evaluate
from stereocalib_core.back.lidar.all_six import with_all_six
from stereocalib_core.back.lidar.road_check import check, who_moved
from stereocalib_core.back.odometry.lever_arm import estimate_lever_and_yaw
from stereocalib_core.back.odometry.packing import PackedTracks, pack
from stereocalib_core.back.odometry.trajectory import (
    VARIANTS,
    Model,
    Trajectory,
    TrajectorySettings,
    trajectory,
)
from stereocalib_core.back.rig.body_motion import MotionSeries
from stereocalib_core.back.rig.consistency import consistent, near_smoothed, settled
from stereocalib_core.back.rig.mount import estimate_mount
from stereocalib_core.back.rig.pair import summarise
from stereocalib_core.back.rig.pair_calibration import calibrate_pair
from stereocalib_core.back.rig.shift_alarm import find_shifts
from stereocalib_core.back.rig.smoothing import filter_drive
from stereocalib_core.back.rig.yaw import YawEstimate, estimate_yaw
from stereocalib_core.config import PipelineConfig, VehicleConfig
from stereocalib_core.frames import GroundTruth
from stereocalib_core.geometry import StereoCamera
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.spill import give_back, let_go
from stereocalib_core.results import (
    BEST,
    Drive,
    DrivePath,
    FilteredExtrinsics,
    FrameResult,
    FrameTable,
    LidarCheck,
    Measured,
    Pair,
    Rig,
    Shift,
)

SUFFIXES: Mapping[str, Model] = MappingProxyType(
    {"": "full", "_planar": "planar", "_nonholonomic": "nonholonomic"}
)
"""Of the variants' names in report.json, and the motion model that each stands for."""
STEREO_ONLY = "stereo_only"


@dataclass(frozen=True)
class Workings:
    """What a `Drive` was made from, for whoever draws or varies it.

    extrinsics: (N, 4) height, pitch, roll, yaw that the odometry uses, NaN where nothing is known.
    paths: every variant by name.
    """

    tracks: PackedTracks
    extrinsics: Array
    yaw: YawEstimate
    paths: Mapping[str, Trajectory]


def all_variants(lever_arm_m: float) -> dict[str, TrajectorySettings]:
    """Settings of every variant of report.json: each in every motion model, and the path without a road."""
    variants = {
        name + suffix: dataclasses.replace(s, model=model, lever_arm_m=lever_arm_m)
        for suffix, model in SUFFIXES.items()
        for name, s in VARIANTS.items()
    }
    return variants | {STEREO_ONLY: TrajectorySettings("stereo_only")}


def odometry_extrinsics(smoothed: FilteredExtrinsics, yaw_rad: float) -> Array:
    """(N, 4) height, pitch, roll, yaw per frame, NaN where the filter has nothing."""
    return np.column_stack([smoothed.values, np.full(len(smoothed.values), yaw_rad)])


def analyse(
    results: Sequence[FrameResult],
    camera: StereoCamera,
    config: PipelineConfig,
    ground_truth: GroundTruth | None = None,
    rig: Rig | None = None,
) -> Drive:
    """Everything that the whole drive says. `rig` brings yaw and lever arm of an earlier drive of the same rig."""
    return analyse_openly(results, camera, config, ground_truth, rig)[0]


def analyse_openly(
    results: Sequence[FrameResult],
    camera: StereoCamera,
    config: PipelineConfig,
    ground_truth: GroundTruth | None = None,
    rig: Rig | None = None,
) -> tuple[Drive, Workings]:
    """`analyse` with what it was made from."""
    known = rig or Rig()
    tracks = pack(camera, results, config.odometry)
    results, filtered, smoothed = _one_rig(results, tracks, config)
    give_back()
    frames = FrameTable.of(results, filtered, smoothed)
    tracks = tracks.with_road(frames.ok)
    yaw = estimate_yaw(tracks, smoothed.values, config.yaw, known.lever_arm_m, config.vehicle, smoothed.sigma)
    yaw_measured = _yaw(yaw, known)
    lever = known.lever_arm_m or Measured(yaw.lever_arm_m, yaw.lever_arm_sigma_m)
    odometry_yaw, yaw_reason = yaw_measured, yaw.reason
    if odometry_yaw is None:
        odometry_yaw, yaw_reason = _yaw_of_path(tracks, smoothed, yaw.reason, config.vehicle)
    extrinsics = odometry_extrinsics(smoothed, 0.0 if odometry_yaw is None else odometry_yaw.value)
    paths = {
        name: trajectory(tracks, extrinsics, settings, smoothed.sigma)
        for name, settings in all_variants(lever.value).items()
    }
    best = paths[BEST]
    motion = MotionSeries.from_path(frames.elapsed_s, best, tracks, config.vehicle)
    shifts = find_shifts(results, motion, yaw.pair_yaw_rad, config.shift_alarm)
    mount = estimate_mount(results, motion, yaw_measured, lever, shifts, config)
    height_m = None if mount.height_m is None else mount.height_m.value
    truth = None if ground_truth is None else ground_truth.poses
    rows = summarise(camera, results, config.rectification)
    give_back()
    pair = calibrate_pair(camera, results, tracks, rows, truth, height_m, config)
    lidar = _lidar(camera, results, best.poses, shifts, pair, config)
    if lidar is not None and lidar.shifts:
        # a LiDAR that is not where it was calibrated sees other things than the pixels it is laid over
        pair = calibrate_pair(camera, results, tracks, rows, truth, height_m, config, lidar_stands=False)
    drive = Drive(
        frames=frames,
        method=config.method,
        mount=mount,
        yaw_reason=yaw_reason,
        pair=pair,
        paths=_judged(paths, ground_truth, config.odometry.min_measured),
        gaps=frames.gaps(best.measured),
        shifts=shifts,
        lidar=lidar,
        causes=(
            *calibration_of_others(yaw.value_rad, pair.depth_scale, results, config.yaw, config.causes),
            *find_causes(results, config.causes),
        ),
        config=config,
    )
    return drive, Workings(tracks, extrinsics, yaw, paths)


def _lidar(
    camera: StereoCamera,
    results: Sequence[FrameResult],
    poses: Array,
    shifts: Sequence[Shift],
    pair: Pair,
    config: PipelineConfig,
) -> LidarCheck | None:
    """The LiDAR against the road where there is one, and against edges; None without scans."""
    by_road = check(results, config.road_check)
    if by_road is not None:
        by_road = who_moved(by_road, [(s.frame, s.axis, s.size) for s in shifts], config.road_check)
    return with_all_six(by_road, results, camera, poses, config.lidar_alignment, pair.disparity_offset_px)


def _one_rig(
    results: Sequence[FrameResult], tracks: PackedTracks, config: PipelineConfig
) -> tuple[Sequence[FrameResult], FilteredExtrinsics, FilteredExtrinsics]:
    """The results without frames that contradict the others, doubts settled; the filter over all, the smoother without.

    The filter knows nothing of later frames, and so not which ones will turn out to contradict. Every round leaves out
    at least one frame or is the last: no frame that is ok in the end contradicts the smoothed rig of the end.
    """
    filtered, smoothed = filter_drive(results, tracks.camera, config, tracks)
    results = settled(results, config.consistency, config.region)
    kept: Sequence[FrameResult] = consistent(results, config.consistency)
    while True:
        if sum(r.ok for r in kept) < sum(r.ok for r in results):
            results = kept
            _, smoothed = filter_drive(results, tracks.camera, config, tracks)
        kept = near_smoothed(results, smoothed.values, config.consistency)
        if sum(r.ok for r in kept) == sum(r.ok for r in results):
            return results, filtered, smoothed


def _judged(
    paths: Mapping[str, Trajectory], ground_truth: GroundTruth | None, min_measured: float
) -> dict[str, DrivePath]:
    """Every path with its errors against the truth."""
    truth = None if ground_truth is None else ground_truth.poses
    reliable = ground_truth is None or ground_truth.heading_reliable
    judged = {}
    for name, path in paths.items():
        errors = evaluate(path.poses, truth, reliable, path.measured_share, min_measured)
        judged[name] = DrivePath(path.poses, path.covariance, errors)
        let_go(path.poses)
    return judged


def _yaw(estimate: YawEstimate, known: Rig) -> Measured | None:
    """The rig file's yaw where there is one, else the drive's own."""
    if known.yaw_rad is not None:
        return known.yaw_rad
    if estimate.value_rad is None or estimate.sigma_rad is None:
        return None
    return Measured(estimate.value_rad, estimate.sigma_rad)


def _yaw_of_path(
    tracks: PackedTracks, smoothed: FilteredExtrinsics, reason: str | None, vehicle: VehicleConfig
) -> tuple[Measured | None, str | None]:
    """A yaw for the variants that need one where no straight shows it: that of an axle without side slip.

    It makes the path agree with the model, so it is no measurement of the mount; the reason says what was used.
    """
    free = trajectory(tracks, odometry_extrinsics(smoothed, 0.0), TrajectorySettings(), smoothed.sigma)
    found = estimate_lever_and_yaw(free, vehicle, tracks.config)
    if found is None:
        return None, reason
    value, sigma = np.rad2deg([found.yaw_rad, found.yaw_sigma_rad])
    used = f"the variants without side slip use {value:+.2f} +- {sigma:.2f} deg, at which the path fits them best"
    return Measured(found.yaw_rad, found.yaw_sigma_rad), used if reason is None else f"{reason}; {used}"
