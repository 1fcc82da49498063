"""What differs between two drives, per axis and in the path, each difference with its sigma.

Two runs of one drive are also compared frame by frame; runs of different drives only by what they say of
the mount.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.config.verdicts import SAME_TIME_S
from stereocalib_core.results import AXES, TO_DEGREES, Drive
from stereocalib_core.results.difference import (
    AxisDifference,
    Difference,
    FramesDifference,
    MountDifference,
    PathDifference,
)

MOUNT_AXES = (*AXES, "yaw_rad")
Rows = NDArray[np.int64]


def compare(a: Drive, b: Drive) -> Difference:
    """Everything that differs, b - a."""
    mount = {}
    for axis in MOUNT_AXES:
        first, second = getattr(a.mount, axis), getattr(b.mount, axis)
        mount[axis] = None if first is None or second is None else MountDifference(first, second)
    common = _common_rows(a, b)
    if common is None:
        return Difference(a, b, mount, None, None)
    return Difference(a, b, mount, _frames(a, b, *common), _path(a, b, *common))


def _common_rows(a: Drive, b: Drive) -> tuple[Rows, Rows] | None:
    """Rows of both tables that are the same frame at the same time; None when it is another drive."""
    _, rows_a, rows_b = np.intersect1d(a.frames.frame, b.frames.frame, return_indices=True)
    apart = np.abs(a.frames.timestamp_s[rows_a] - b.frames.timestamp_s[rows_b])
    if len(rows_a) == 0 or not apart.max() <= SAME_TIME_S:
        return None
    return rows_a, rows_b


def _frames(a: Drive, b: Drive, rows_a: Rows, rows_b: Rows) -> FramesDifference:
    ok_a, ok_b = a.frames.ok[rows_a], b.frames.ok[rows_b]
    both = ok_a & ok_b
    difference = (b.frames.values[rows_b] - a.frames.values[rows_a])[both]
    sigma = np.hypot(a.frames.sigma[rows_a], b.frames.sigma[rows_b])[both]
    numbers = a.frames.frame[rows_a][both]
    axes: dict[str, AxisDifference | None] = dict.fromkeys(AXES)
    for k, axis in enumerate(AXES) if both.any() else ():
        d = difference[:, k]
        worst = int(np.argmax(np.abs(d)))
        axes[axis] = AxisDifference(
            median=float(np.median(d)),
            rms=float(np.sqrt(np.mean(d**2))),
            rms_in_sigmas=float(np.sqrt(np.mean((d / np.maximum(sigma[:, k], 1e-12)) ** 2))),
            largest=float(d[worst]),
            largest_at_frame=int(numbers[worst]),
        )
    only = int((ok_a & ~ok_b).sum()), int((ok_b & ~ok_a).sum())
    return FramesDifference(len(rows_a), int(both.sum()), *only, axes)


def _path(a: Drive, b: Drive, rows_a: Rows, rows_b: Rows) -> PathDifference | None:
    if a.poses is None or b.poses is None:
        return None
    first, second = a.poses[rows_a], b.poses[rows_b]
    apart = np.linalg.norm(second[:, :3, 3] - first[:, :3, 3], axis=1)
    turned = np.arctan2(second[-1, 0, 2], second[-1, 2, 2]) - np.arctan2(first[-1, 0, 2], first[-1, 2, 2])
    lengths = [float(np.linalg.norm(np.diff(p[:, :3, 3], axis=0), axis=1).sum()) for p in (first, second)]
    return PathDifference(
        a_m=lengths[0],
        b_m=lengths[1],
        rms_difference_m=float(np.sqrt(np.mean(apart**2))),
        final_difference_m=float(apart[-1]),
        final_heading_difference_rad=float((turned + np.pi) % (2 * np.pi) - np.pi),
    )


def describe(difference: Difference, a: str, b: str) -> str:
    """The same for people, a few lines of text in metres and degrees; `a` and `b` name the drives."""
    lines = [
        f"{letter}  {name}  ({drive.frames_ok} of {len(drive.frames)} frames ok)"
        for letter, name, drive in (("A", a, difference.a), ("B", b, difference.b))
    ]
    lines.append(f"\n{'mount':<11}{'A':>10}{'B':>10}{'B - A':>10}{'sigma':>9}")
    for axis, found in difference.mount.items():
        name, unit = _shown(axis)
        if found is None:
            lines.append(f"{name:<11}{'not known in both':>20}")
            continue
        numbers = [unit * value for value in (found.a.value, found.b.value, found.difference, found.sigma)]
        verdict = "  differs" if found.significant else ""
        lines.append(
            f"{name:<11}{numbers[0]:10.4f}{numbers[1]:10.4f}{numbers[2]:+10.4f}{numbers[3]:9.4f}{verdict}"
        )
    frames, path = difference.frames, difference.path
    if frames is None:
        lines.append("\ndifferent drives: frames and paths are not compared")
        return "\n".join(lines)
    lines.append(
        f"\nframes: {frames.common} in common, ok in both {frames.ok_in_both}, "
        f"only in A {frames.ok_only_in_a}, only in B {frames.ok_only_in_b}"
    )
    for axis, over in frames.axes.items():
        if over is not None:
            name, unit = _shown(axis)
            lines.append(
                f"{name:<11}median {unit * over.median:+.4f}, rms {unit * over.rms:.4f} "
                f"({over.rms_in_sigmas:.1f} sigma), "
                f"largest {unit * over.largest:+.4f} at frame {over.largest_at_frame}"
            )
    if path is not None:
        lines.append(
            f"\npath: {path.a_m:.2f} m and {path.b_m:.2f} m, apart by {path.rms_difference_m:.3f} m rms and "
            f"{path.final_difference_m:.3f} m, {np.rad2deg(path.final_heading_difference_rad):+.3f} deg at the end "
            f"(alignment: {path.alignment})"
        )
    return "\n".join(lines)


def _shown(axis: str) -> tuple[str, float]:
    """An axis as people read it, and the factor to its unit there."""
    return axis.replace("_rad", "_deg"), float(TO_DEGREES[1]) if axis.endswith("_rad") else 1.0
