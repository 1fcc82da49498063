"""report.json from a `Drive`; `files.report_read` reads it. Nowhere else is a drive a dictionary."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from stereocalib_core.files.io import MOUNT_KEYS
from stereocalib_core.geometry import ros2_static_transform
from stereocalib_core.results import (
    TO_DEGREES,
    Cause,
    Drive,
    LidarCheck,
    LidarPose,
    LidarShift,
    Measured,
    Mending,
    Pair,
    Shift,
)

Block = dict[str, Any]
DEGREE = float(np.deg2rad(1.0))
STATISTICS = {"height_m": "height_m", "pitch_deg": "pitch_rad", "roll_deg": "roll_rad"}
LIDAR_AXES = ("height_m", "pitch_deg", "roll_deg", "yaw_deg", "x_m", "z_m")
UNIT = {"height": "m", "pitch": "deg", "roll": "deg", "yaw": "deg", "x": "m", "z": "m"}


def report_of(drive: Drive) -> Block:
    """report.json as a dictionary, in metres and degrees, each number to what it means."""
    frames, yaw = drive.frames, drive.mount.yaw_rad
    statistics = frames.statistics(TO_DEGREES)
    report = {
        "source": drive.source,
        "frames": len(frames),
        "frames_ok": drive.frames_ok,
        "method": drive.method,
        "trustworthy": drive.why_not is None,
        "why_not": drive.why_not,
        "mount": _mount(drive),
        "yaw_deg": None if yaw is None else float(np.rad2deg(yaw.value)),
        "yaw_sigma_deg": None if yaw is None else float(np.rad2deg(yaw.sigma)),
        "yaw_reason": drive.yaw_reason,
        **{key: dataclasses.asdict(statistics[axis]) for key, axis in STATISTICS.items()},
        "rectification": _rectification(drive.pair),
        "pair": pair_block(drive.pair),
        "self_calibration": None if drive.mended is None else _mending(drive.mended),
        "odometry": {name: dataclasses.asdict(path.errors) for name, path in drive.paths.items()},
        "gaps": [list(gap) for gap in drive.gaps],
        "failures": dict(frames.failures),
        "likely_causes": [_cause(cause) for cause in drive.causes],
        "shifts": [_shift(shift) for shift in drive.shifts],
        "lidar_check": None if drive.lidar is None else _lidar(drive.lidar),
        "timing_ms": dict(drive.timing.stages_ms),
        "frames_per_second": drive.timing.frames_per_second,
        "notices": list(drive.notices),
    }
    return {key: _rounded(value, key) for key, value in report.items()}


DIGITS, OF_WAYS, OF_POSES = 6, 4, 9
"""Decimals: a micrometre and a millionth of a degree, as extrinsics.csv has them; of what grows with the way; and of
matrices that others compute with. What is beyond them is of the processor and its libraries, not of the drive."""


def _rounded(value: Any, key: str, digits: int = DIGITS) -> Any:
    """The same with every number to the decimals of its key."""
    if key.startswith("T_"):
        digits = OF_POSES
    elif key.endswith("_percent") or key in ("path_m", "path_gt_m", "final_translation_m"):
        digits = OF_WAYS
    if isinstance(value, dict):
        return {name: _rounded(entry, name, digits) for name, entry in value.items()}
    if isinstance(value, list):
        return [_rounded(entry, "", digits) for entry in value]
    return round(value, digits) + 0.0 if isinstance(value, float) else value


def _measured(value: Measured | None, degrees: bool = False) -> Block | None:
    if value is None:
        return None
    unit = float(TO_DEGREES[1]) if degrees else 1.0
    return {"value": value.value * unit, "sigma": value.sigma * unit}


def _mount(drive: Drive) -> Block:
    rig = drive.mount
    pose = rig.T_vehicle_camera
    return {
        **{
            key: _measured(getattr(rig, field), key.endswith("_deg"))
            for key, (field, _) in MOUNT_KEYS.items()
        },
        "lever_arm_m": None if rig.lever_arm_m is None else rig.lever_arm_m.value,
        "T_vehicle_camera": None if pose is None else pose.tolist(),
        "note": rig.note,
        "within_tolerance": drive.within_tolerance,
        "tolerance": {
            key: {
                "nominal": limit.nominal / unit,
                "tolerance": limit.tolerance / unit,
                "within": drive.within(field),
            }
            for key, (field, unit) in MOUNT_KEYS.items()
            if (limit := drive.limits.get(field)) is not None
        },
    }


def _rectification(pair: Pair) -> Block:
    return {
        "row_offset_px": _measured(pair.row_offset_px),
        "relative_pitch_deg": _measured(pair.relative_pitch_rad, degrees=True),
        "relative_roll_deg": _measured(pair.relative_roll_rad, degrees=True),
        "verdict": pair.rows_verdict,
        "why": pair.rows_why,
    }


def pair_block(pair: Pair) -> Block:
    """The block `pair`; degrees, pixels, metres, shares as they are."""
    scale, effects = pair.depth_scale, pair.effects
    return {
        "relative_pitch_deg": _measured(pair.relative_pitch_rad, degrees=True),
        "relative_roll_deg": _measured(pair.relative_roll_rad, degrees=True),
        "relative_yaw_deg": _measured(pair.relative_yaw_rad, degrees=True),
        "disparity_offset_px": _measured(pair.disparity_offset_px),
        "row_offset_px": _measured(pair.row_offset_px),
        "depth_scale": {"value": None, "sigma": None, "from": "none"}
        if scale is None
        else {"value": scale.value, "sigma": scale.sigma, "from": scale.source},
        "verdict": pair.verdict,
        "why": pair.why,
        "yaw_reason": pair.yaw_reason,
        "yaw_mends": pair.yaw_mends,
        "pairs": pair.pairs,
        "yaw_halves_deg": [float(value) for value in np.rad2deg(pair.yaw_halves)],
        "yaw_thirds_deg": [float(value) for value in np.rad2deg(pair.yaw_thirds)],
        "lidar_offset_px": _measured(pair.by_lidar_px),
        "lidar_halves": {
            "disparity_offset_px": [offset for offset, _ in pair.lidar_halves],
            "depth_scale": [scale for _, scale in pair.lidar_halves],
        },
        "changes": [
            {
                "frame": change.frame,
                "axis": change.axis,
                "size_deg": float(np.rad2deg(change.size_rad)),
                "sigma_deg": float(np.rad2deg(change.sigma_rad)),
            }
            for change in pair.changes
        ],
        "effects": None
        if effects is None
        else {
            "depth_at_30_m_percent": _finite(100.0 * effects.depth_share),
            "pitch_deg": _finite(float(np.rad2deg(effects.pitch_rad))),
            "height_percent": _finite(100.0 * effects.height_share),
            "path_percent": _finite(100.0 * effects.path_share),
        },
    }


def _mending(mended: Mending) -> Block:
    """What was applied, and the pair before it; all other numbers of the report are for the mended pair."""
    c = mended.correction
    return {
        "applied": {
            "relative_pitch_deg": float(np.rad2deg(c.pitch_rad)),
            "relative_roll_deg": float(np.rad2deg(c.roll_rad)),
            "relative_yaw_deg": float(np.rad2deg(c.yaw_rad)),
            "depth_scale": c.depth_scale,
            "from_frame": mended.from_frame,
        },
        "numbers_are_for": "the mended pair, calibration_mended.yaml; `before` is the pair as it was calibrated",
        "before": pair_block(mended.before),
    }


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _shift(shift: Shift | LidarShift) -> Block:
    unit = UNIT[shift.axis]
    size, sigma = (shift.size, shift.sigma) if unit == "m" else np.rad2deg([shift.size, shift.sigma]).tolist()
    place = {"frame": shift.frame, "axis": shift.axis, "size": size, "unit": unit, "kind": shift.kind}
    return {**place, "sigma": sigma, "detected_at": shift.detected_at}


def _cause(cause: Cause) -> Block:
    frames = [cause.first, cause.last]
    return {"frames": frames, "reason": cause.reason, "cause": cause.cause, "remedy": cause.remedy}


def _lidar(check: LidarCheck) -> Block:
    residuals = (check.height_m, check.pitch_rad, check.roll_rad, check.yaw_rad, check.x_m, check.z_m)
    return {
        **{
            key: None
            if residual is None
            else {
                name: value * (float(TO_DEGREES[1]) if key.endswith("_deg") else 1.0)
                for name, value in dataclasses.asdict(residual).items()
            }
            for key, residual in zip(LIDAR_AXES, residuals, strict=True)
        },
        "shifts": [{**_shift(found), "moved": found.moved} for found in check.shifts],
        "frames": check.frames,
        "unseen": check.unseen,
        "why": check.why,
        "T_camera_lidar": None if check.pose is None else lidar_pose(check.pose),
    }


def lidar_pose(pose: LidarPose) -> Block:
    """Where the LiDAR stands, metres and degrees; null where a difference was not measured and is left as told."""
    units = {name: 1.0 if name.endswith("_m") else float(TO_DEGREES[1]) for name in LIDAR_AXES}
    return {
        "found": pose.T_camera_lidar,
        "calibrated": pose.calibrated,
        "difference": {
            name: _measured(Measured(float(value) * units[name], float(sigma) * units[name]))
            if np.isfinite(value)
            else None
            for name, value, sigma in zip(LIDAR_AXES, pose.six, pose.sigma, strict=True)
        },
        "frames": [pose.first, pose.last],
        "ros2_static_transform": ros2_static_transform(pose.T_camera_lidar, "camera_optical_frame", "lidar"),
    }
