"""`stereocalib compare`: what differs between two runs, per axis and in the path, each difference with its sigma.

Two runs of one drive are also compared frame by frame; runs of different drives only by what they say of
the mount.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.files.io import SavedRun, read_run
from stereocalib_core.files.report import AXES
from stereocalib_core.run import tolerance

SIGNIFICANT_SIGMAS = 3.0


def compare_runs(folder_a: Path, folder_b: Path) -> dict[str, Any]:
    """Everything that differs, as plain values; raises SourceError for a folder that is no run.

    `mount`: per axis a, b, difference (b - a), its sigma, and whether it exceeds three of them.
    `frames`: of frames ok in both runs of the same drive, the paired differences; None for other drives.
    `path`: of both trajectories as they are, both starting at their first left camera, unaligned.
    """
    a, b = read_run(folder_a), read_run(folder_b)
    common = _common_rows(a, b)
    return {
        "a": str(folder_a),
        "b": str(folder_b),
        "source": [a.report.get("source"), b.report.get("source")],
        "frames_ok": [f"{run.report.get('frames_ok')} of {run.report.get('frames')}" for run in (a, b)],
        "mount": {axis: _mount(a.report, b.report, axis) for axis in tolerance.AXES},
        "frames": None if common is None else _frames(a, b, *common),
        "path": None if common is None else _path(a, b, *common),
        "rectification": [(run.report.get("rectification") or {}).get("verdict") for run in (a, b)],
        "shifts": [len(run.report.get("shifts") or []) for run in (a, b)],
    }


def _common_rows(a: SavedRun, b: SavedRun) -> tuple[NDArray[np.int64], NDArray[np.int64]] | None:
    """Rows of both tables that are the same frame at the same time; None when it is another drive."""
    _, rows_a, rows_b = np.intersect1d(a.extrinsics["frame"], b.extrinsics["frame"], return_indices=True)
    times_a, times_b = a.extrinsics["timestamp_s"][rows_a], b.extrinsics["timestamp_s"][rows_b]
    if len(rows_a) == 0 or np.abs(times_a - times_b).max() > 1e-3:
        return None
    return rows_a, rows_b


def _value_and_sigma(report: Mapping[str, Any], axis: str) -> tuple[float, float] | None:
    block = (report.get("mount") or {}).get(axis)
    if not isinstance(block, dict) or block.get("value") is None:
        return None
    return float(block["value"]), float(block.get("sigma") or 0.0)


def _mount(a: Mapping[str, Any], b: Mapping[str, Any], axis: str) -> dict[str, Any] | None:
    first, second = _value_and_sigma(a, axis), _value_and_sigma(b, axis)
    if first is None or second is None:
        return None
    difference, sigma = second[0] - first[0], math.hypot(first[1], second[1])
    return {
        "a": first[0],
        "b": second[0],
        "difference": difference,
        "sigma": sigma,
        "significant": abs(difference) > SIGNIFICANT_SIGMAS * sigma,
    }


def _frames(a: SavedRun, b: SavedRun, rows_a: NDArray[np.int64], rows_b: NDArray[np.int64]) -> dict[str, Any]:
    ok_a = np.array([a.extrinsics["status"][row] == "ok" for row in rows_a])
    ok_b = np.array([b.extrinsics["status"][row] == "ok" for row in rows_b])
    both = ok_a & ok_b
    block: dict[str, Any] = {
        "common": len(rows_a),
        "ok_in_both": int(both.sum()),
        "ok_only_in_a": int((ok_a & ~ok_b).sum()),
        "ok_only_in_b": int((ok_b & ~ok_a).sum()),
    }
    for axis in AXES:
        stem, _, unit = axis.partition("_")
        difference = (b.extrinsics[axis][rows_b] - a.extrinsics[axis][rows_a])[both]
        sigma = np.hypot(
            a.extrinsics[f"{stem}_sigma_{unit}"][rows_a], b.extrinsics[f"{stem}_sigma_{unit}"][rows_b]
        )[both]
        if len(difference) == 0:
            block[axis] = None
            continue
        worst = int(np.argmax(np.abs(difference)))
        block[axis] = {
            "median": float(np.median(difference)),
            "rms": float(np.sqrt(np.mean(difference**2))),
            "rms_in_sigmas": float(np.sqrt(np.mean((difference / np.maximum(sigma, 1e-12)) ** 2))),
            "largest": float(difference[worst]),
            "largest_at_frame": int(a.extrinsics["frame"][rows_a[both][worst]]),
        }
    return block


def _path(
    a: SavedRun, b: SavedRun, rows_a: NDArray[np.int64], rows_b: NDArray[np.int64]
) -> dict[str, Any] | None:
    if a.poses is None or b.poses is None or max(rows_a) >= len(a.poses) or max(rows_b) >= len(b.poses):
        return None
    first, second = a.poses[rows_a], b.poses[rows_b]
    apart = np.linalg.norm(second[:, :3, 3] - first[:, :3, 3], axis=1)
    turned = np.arctan2(second[-1, 0, 2], second[-1, 2, 2]) - np.arctan2(first[-1, 0, 2], first[-1, 2, 2])
    lengths = [float(np.linalg.norm(np.diff(p[:, :3, 3], axis=0), axis=1).sum()) for p in (first, second)]
    return {
        "a_m": lengths[0],
        "b_m": lengths[1],
        "rms_difference_m": float(np.sqrt(np.mean(apart**2))),
        "final_difference_m": float(apart[-1]),
        "final_heading_difference_deg": float(np.rad2deg((turned + np.pi) % (2 * np.pi) - np.pi)),
        "alignment": "none, both start at their first left camera",
    }


def describe(difference: Mapping[str, Any]) -> str:
    """The same for people, a few lines of text."""
    lines = [f"A  {difference['a']}  ({difference['frames_ok'][0]} frames ok)"]
    lines.append(f"B  {difference['b']}  ({difference['frames_ok'][1]} frames ok)")
    lines.append(f"\n{'mount':<11}{'A':>10}{'B':>10}{'B - A':>10}{'sigma':>9}")
    for axis, block in difference["mount"].items():
        if block is None:
            lines.append(f"{axis:<11}{'not known in both':>20}")
            continue
        verdict = "  differs" if block["significant"] else ""
        numbers = f"{block['a']:10.4f}{block['b']:10.4f}{block['difference']:+10.4f}{block['sigma']:9.4f}"
        lines.append(f"{axis:<11}{numbers}{verdict}")
    frames, path = difference["frames"], difference["path"]
    if frames is None:
        lines.append("\ndifferent drives: frames and paths are not compared")
        return "\n".join(lines)
    lines.append(
        f"\nframes: {frames['common']} in common, ok in both {frames['ok_in_both']}, "
        f"only in A {frames['ok_only_in_a']}, only in B {frames['ok_only_in_b']}"
    )
    for axis in AXES:
        block = frames[axis]
        if block is not None:
            lines.append(
                f"{axis:<11}median {block['median']:+.4f}, rms {block['rms']:.4f} "
                f"({block['rms_in_sigmas']:.1f} sigma), "
                f"largest {block['largest']:+.4f} at frame {block['largest_at_frame']}"
            )
    if path is not None:
        lines.append(
            f"\npath: {path['a_m']:.2f} m and {path['b_m']:.2f} m, apart by {path['rms_difference_m']:.3f} m rms and "
            f"{path['final_difference_m']:.3f} m, {path['final_heading_difference_deg']:+.3f} deg at the end "
            f"(alignment: {path['alignment']})"
        )
    return "\n".join(lines)
