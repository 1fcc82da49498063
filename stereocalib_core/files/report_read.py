"""report.json to a `Drive`: every field of the right type, or one line that says which is not."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.errors import SourceError
from stereocalib_core.files.fields import Fields
from stereocalib_core.files.io import MOUNT_KEYS
from stereocalib_core.files.report import DEGREE, LIDAR_AXES, UNIT
from stereocalib_core.results import (
    BEST,
    BendEffects,
    Cause,
    DepthScale,
    Drive,
    DrivePath,
    FrameTable,
    LidarCheck,
    LidarPose,
    LidarShift,
    Measured,
    Mending,
    OdometryErrors,
    Pair,
    PairChange,
    PairCorrection,
    Residual,
    Rig,
    Shift,
    Timing,
    Tolerance,
)
from stereocalib_core.results.pair import Verdict


def drive_of(
    report: Mapping[str, Any], path: Path, frames: FrameTable, poses: NDArray[np.float64] | None
) -> Drive:
    """The drive that `report` tells of, with its frames and its best path; raises SourceError for a wrong type.

    path: where the report is from. What a report leaves out or has as null is not known.
    """
    root = Fields(report, path)
    mount = root.block("mount")
    limits = mount.block("tolerance")
    rig: dict[str, Any] = {field: mount.measured(key, unit) for key, (field, unit) in MOUNT_KEYS.items()}
    lever_arm_m = mount.number("lever_arm_m")
    return Drive(
        frames=frames,
        source=root.text("source") or "",
        method=root.text("method") or "",
        mount=Rig(
            **rig,
            lever_arm_m=None if lever_arm_m is None else Measured(lever_arm_m, np.nan),
            note=mount.text("note"),
        ),
        yaw_reason=root.text("yaw_reason"),
        limits={
            field: Tolerance(block.need("nominal") * unit, block.need("tolerance") * unit)
            for key, (field, unit) in MOUNT_KEYS.items()
            if (block := limits.block(key)).values
        },
        pair=_read_pair(root.block("rectification"), root.block("pair")),
        mended=_read_mending(root.block("self_calibration")),
        paths=_read_paths(root.block("odometry"), len(frames), poses),
        gaps=root.pairs("gaps"),
        shifts=tuple(_read_shift(block) for block in root.blocks("shifts")),
        lidar=_read_lidar(root.block("lidar_check")),
        causes=tuple(_read_cause(block) for block in root.blocks("likely_causes")),
        timing=Timing(root.block("timing_ms").numbers(), root.number("frames_per_second")),
        notices=root.texts("notices"),
    )


def _read_pair(rows: Fields, block: Fields) -> Pair:
    """The pair; of a report without the block `pair`, its rows."""
    known = ("good", "suspect", "bad", "not measured")
    rows_verdict: Verdict = rows.choice("verdict", known) or "suspect"
    verdict: Verdict = block.choice("verdict", known) or rows_verdict
    rows_why = rows.text("why") or ""
    scale, effects, halves = (block.block(name) for name in ("depth_scale", "effects", "lidar_halves"))
    source, value = scale.choice("from", ("lidar", "truth", "none")), scale.number("value")
    of_pair = block if block.values else rows
    return Pair(
        verdict,
        block.text("why") or rows_why,
        of_pair.measured("row_offset_px"),
        of_pair.measured("relative_pitch_deg", DEGREE),
        of_pair.measured("relative_roll_deg", DEGREE),
        block.measured("relative_yaw_deg", DEGREE),
        block.measured("disparity_offset_px"),
        None if value is None or source is None else DepthScale(value, scale.number("sigma") or 0.0, source),
        rows_verdict=rows_verdict,
        rows_why=rows_why,
        pairs=int(block.number("pairs") or 0),
        yaw_halves=tuple(value * DEGREE for value in block.list_of_numbers("yaw_halves_deg")),
        yaw_thirds=tuple(value * DEGREE for value in block.list_of_numbers("yaw_thirds_deg")),
        changes=tuple(
            PairChange(
                int(change.need("frame")),
                change.choice("axis", ("pitch", "roll", "yaw"), needed=True),
                change.need("size_deg") * DEGREE,
                change.need("sigma_deg") * DEGREE,
            )
            for change in block.blocks("changes")
        ),
        by_lidar_px=block.measured("lidar_offset_px"),
        lidar_halves=tuple(
            zip(
                halves.list_of_numbers("disparity_offset_px"),
                halves.list_of_numbers("depth_scale"),
                strict=False,
            )
        ),
        effects=_read_effects(effects) if effects.values else None,
        yaw_reason=block.text("yaw_reason"),
        yaw_mends=block.flag("yaw_mends", otherwise=True),
    )


def _read_mending(block: Fields) -> Mending | None:
    if not block.values:
        return None
    applied = block.block("applied")
    pitch, roll, yaw = (applied.need(f"relative_{axis}_deg") * DEGREE for axis in ("pitch", "roll", "yaw"))
    correction = PairCorrection(pitch, roll, yaw, applied.need("depth_scale"))
    before = block.block("before")
    return Mending(correction, int(applied.need("from_frame")), _read_pair(before, before))


def _read_effects(block: Fields) -> BendEffects:
    keys = ("depth_at_30_m_percent", "pitch_deg", "height_percent", "path_percent")
    depth, pitch, height, path = (np.nan if (v := block.number(key)) is None else v for key in keys)
    return BendEffects(depth / 100.0, pitch * DEGREE, height / 100.0, path / 100.0)


def _read_paths(block: Fields, count: int, poses: NDArray[np.float64] | None) -> dict[str, DrivePath]:
    if poses is not None and len(poses) != count:
        raise SourceError(f"{len(poses)} poses of {count} frames", block.path, "run the drive again")
    unknown = np.full((count, 4, 4), np.nan), np.full((count, 6, 6), np.nan)
    names = [field.name for field in dataclasses.fields(OdometryErrors)][1:]
    paths = {}
    for name in block.values:
        entry = block.block(name)
        errors = OdometryErrors(entry.number("path_m"), *(entry.number(key) for key in names))
        paths[name] = DrivePath(unknown[0], unknown[1], errors)
    if poses is not None:
        errors = paths[BEST].errors if BEST in paths else OdometryErrors(np.nan)
        paths[BEST] = DrivePath(poses, unknown[1], errors)
    return paths


def _read_shift(block: Fields) -> Shift:
    axis = block.choice("axis", ("height", "pitch", "roll", "yaw"), needed=True)
    unit = 1.0 if axis == "height" else DEGREE
    sigma, frame = block.number("sigma"), int(block.need("frame"))
    return Shift(
        frame,
        axis,
        block.need("size") * unit,
        np.nan if sigma is None else sigma * unit,
        block.choice("kind", ("step", "drift"), needed=True),
        int(block.number("detected_at") or frame),
    )


def _read_lidar(block: Fields) -> LidarCheck | None:
    if not block.values:
        return None

    def residual(key: str) -> Residual | None:
        unit = DEGREE if key.endswith("_deg") else 1.0
        entry = block.block(key)
        if not entry.values:
            return None
        return Residual(*(entry.need(field.name) * unit for field in dataclasses.fields(Residual)))

    def shift(entry: Fields) -> LidarShift:
        axis = entry.choice("axis", ("height", "pitch", "roll", "yaw", "x", "z"), needed=True)
        unit = 1.0 if UNIT[axis] == "m" else DEGREE
        return LidarShift(
            int(entry.need("frame")),
            axis,
            entry.need("size") * unit,
            entry.need("sigma") * unit,
            entry.choice("kind", ("step", "offset"), needed=True),
            int(entry.need("detected_at")),
            entry.choice("moved", ("lidar", "camera")),
        )

    return LidarCheck(
        residual("height_m"),
        residual("pitch_deg"),
        residual("roll_deg"),
        tuple(shift(entry) for entry in block.blocks("shifts")),
        int(block.need("frames")),
        block.text("unseen") or "",
        yaw_rad=residual("yaw_deg"),
        x_m=residual("x_m"),
        z_m=residual("z_m"),
        why=block.text("why"),
        pose=_read_lidar_pose(block.block("T_camera_lidar")),
    )


def _read_lidar_pose(block: Fields) -> LidarPose | None:
    if not block.values:
        return None
    difference = block.block("difference")
    found = [difference.measured(key, DEGREE if key.endswith("_deg") else 1.0) for key in LIDAR_AXES]
    first, last = block.pair("frames")
    return LidarPose(
        block.matrix("calibrated", 4, 4),
        block.matrix("found", 4, 4),
        np.array([np.nan if one is None else one.value for one in found]),
        np.array([np.nan if one is None else one.sigma for one in found]),
        first,
        last,
    )


def _read_cause(block: Fields) -> Cause:
    first, last = block.pair("frames")
    return Cause(first, last, *(block.text(key) or "" for key in ("reason", "cause", "remedy")))
