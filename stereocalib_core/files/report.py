"""What report.json says of the frames themselves; the back end adds what needs the whole drive."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.geometry import Extrinsics
from stereocalib_core.results import TO_DEGREES, DriveAnalysis, FilteredExtrinsics, FrameResult, Measured, Rig

AXES = ("height_m", "pitch_deg", "roll_deg")
MIN_OK_FRACTION = 0.5


def build_report(
    source: str,
    method: str,
    results: Sequence[FrameResult],
    analysis: DriveAnalysis | None,
    elapsed_s: float,
    total_ms: Sequence[float] = (),
) -> dict[str, Any]:
    """report.json as a dictionary; without an analysis its blocks are there but empty.

    elapsed_s: wall time of all `results`. total_ms: wall time of each frame, its reading included.
    """
    ok = [result for result in results if result.ok]
    report: dict[str, Any] = {
        "source": source,
        "frames": len(results),
        "frames_ok": len(ok),
        "method": method,
        "trustworthy": True,
        "why_not": None,
        "mount": mount_block(Rig()),
        "yaw_deg": None,
        "yaw_sigma_deg": None,
        "yaw_reason": "the drive was not analysed" if analysis is None else None,
        **_statistics(results, None if analysis is None else analysis.filtered),
        "rectification": _unknown_rectification(),
        "odometry": {},
        "gaps": gaps(results),
        "failures": dict(sorted(Counter(result.reason for result in results if not result.ok).items())),
        "shifts": [],
        "lidar_check": None,
    }
    if analysis is not None:
        report.update(analysis.report)
    if len(ok) < MIN_OK_FRACTION * len(results):
        reasons = ", ".join(f"{count} {reason}" for reason, count in report["failures"].items())
        report["trustworthy"] = False
        report["why_not"] = f"only {len(ok)} of {len(results)} frames are ok ({reasons})"
    report["timing_ms"] = _timing(results, total_ms)
    report["frames_per_second"] = len(results) / elapsed_s if elapsed_s > 0 else None
    return report


def gaps(results: Sequence[FrameResult], measured: NDArray[np.bool_] | None = None) -> list[list[int]]:
    """First and last frame of every run of failed frames, and of frames that the path reached without a measurement.

    measured: (N,) whether the motion into a frame was measured on the road. Into the frame after a failed one it
    seldom is: that is the failed frame's gap, and by itself makes it no longer.
    """
    failed = np.array([not result.ok for result in results], dtype=np.bool_)
    missing = failed.copy()
    if measured is not None:
        after = np.concatenate([[False], failed[:-1]]) & np.concatenate([measured[1:], [True]])
        missing |= ~measured & ~after
    edges = np.flatnonzero(np.diff(np.concatenate([[False], missing, [False]]).astype(int))).reshape(-1, 2)
    return [[results[first].frame, results[end - 1].frame] for first, end in edges]


def estimates(results: Sequence[FrameResult]) -> NDArray[np.float64]:
    """(N, 3) height [m], pitch, roll [rad] of each pair by itself, NaN where the frame failed."""
    rows = [
        (r.road.extrinsics.height_m, r.road.extrinsics.pitch_rad, r.road.extrinsics.roll_rad)
        if r.road is not None
        else (np.nan,) * 3
        for r in results
    ]
    return np.array(rows, dtype=np.float64).reshape(-1, 3)


def _statistics(
    results: Sequence[FrameResult], filtered: FilteredExtrinsics | None
) -> dict[str, dict[str, float | None]]:
    """Mean, median, std over ok frames, and the std of the filtered values over the same frames."""
    values = estimates(results) * TO_DEGREES
    ok = np.isfinite(values).all(axis=1)
    smooth = filtered.values[ok] * TO_DEGREES if filtered is not None else np.full((int(ok.sum()), 3), np.nan)
    block: dict[str, dict[str, float | None]] = {}
    for axis, name in enumerate(AXES):
        raw, flat = values[ok, axis], smooth[np.isfinite(smooth[:, axis]), axis]
        block[name] = {
            "mean": float(np.mean(raw)) if len(raw) else None,
            "median": float(np.median(raw)) if len(raw) else None,
            "std": float(np.std(raw)) if len(raw) else None,
            "std_filtered": float(np.std(flat)) if len(flat) else None,
        }
    return block


def _timing(results: Sequence[FrameResult], total_ms: Sequence[float]) -> Mapping[str, float]:
    """Median milliseconds of each stage over the frames that went through it, and of the whole frame."""
    by_stage: dict[str, list[float]] = {}
    for result in results:
        for stage, value in result.timing_ms.items():
            by_stage.setdefault(stage, []).append(value)
    medians = {stage: round(float(np.median(values)), 3) for stage, values in by_stage.items()}
    if len(total_ms):
        medians["total"] = round(float(np.median(total_ms)), 3)
    return medians


def mount_block(rig: Rig) -> dict[str, Any]:
    """The block `mount` of report.json, metres and degrees; what is not known is null."""

    def entry(value: Measured | None, scale: float) -> dict[str, float] | None:
        return None if value is None else {"value": scale * value.value, "sigma": scale * value.sigma}

    degree = float(np.rad2deg(1.0))
    block: dict[str, Any] = {
        "height_m": entry(rig.height_m, 1.0),
        "pitch_deg": entry(rig.pitch_rad, degree),
        "roll_deg": entry(rig.roll_rad, degree),
        "yaw_deg": entry(rig.yaw_rad, degree),
        "lever_arm_m": None if rig.lever_arm_m is None else rig.lever_arm_m.value,
        "T_vehicle_camera": None,
        "within_tolerance": None,
    }
    if rig.height_m is not None and rig.pitch_rad is not None and rig.roll_rad is not None:
        yaw = 0.0 if rig.yaw_rad is None else rig.yaw_rad.value
        pose = Extrinsics(rig.height_m.value, rig.pitch_rad.value, rig.roll_rad.value, yaw)
        block["T_vehicle_camera"] = pose.T_vehicle_camera.tolist()
    return block


def _unknown_rectification() -> dict[str, Any]:
    return {
        "row_offset_px": None,
        "relative_pitch_deg": None,
        "relative_roll_deg": None,
        "verdict": "suspect",
        "why": "not measured",
    }
