"""What a run ends with: what was judged, its sigma, the verdict, causes and remedies, files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from stereocalib_app.words.lidar import lidar_lines
from stereocalib_core.results import Drive, Measured, Pair

MENDED = "calibration_mended.yaml"
FILES = ("extrinsics.csv", "trajectory.txt", "rig.yaml", MENDED, "lidar_mended.yaml", "report.json")
AXES = (
    ("height_m", "height", "m", 1.0, 4),
    ("pitch_rad", "pitch", "deg", float(np.rad2deg(1.0)), 3),
    ("roll_rad", "roll", "deg", float(np.rad2deg(1.0)), 3),
    ("yaw_rad", "yaw", "deg", float(np.rad2deg(1.0)), 3),
)
"""Field of the mount, its name, unit, factor to the unit, digits."""
MOST_CAUSES = 5
"""Stretches of failed frames that are told; report.json has them all."""


def answer(drive: Drive, out: Path) -> list[str]:
    """The last lines of `stereocalib run`."""
    lines = [_mount(drive), *_pair(drive), *_lidar(drive)]
    lines += _causes(drive)
    lines += _remedy(drive, out)
    there = [name for name in FILES if (out / name).is_file()]
    return ["answer:", *(f"  {line}" for line in lines), f"  files in {out}: {', '.join(there)}"]


def _causes(drive: Drive) -> list[str]:
    """Why frames failed: the longest stretches, in the order of the drive."""
    longest = sorted(drive.causes, key=lambda c: (c.first - c.last, c.first))[:MOST_CAUSES]
    lines = []
    for cause in sorted(longest, key=lambda c: c.first):
        one = cause.first == cause.last
        where = f"frame {cause.first}" if one else f"frames {cause.first} to {cause.last}"
        lines.append(f"{where}: {cause.reason}, probably {cause.cause}; remedy: {cause.remedy}")
    rest = len(drive.causes) - len(longest)
    return (
        [*lines, f"{rest} more such stretches, none longer: likely_causes in report.json"] if rest else lines
    )


def _mount(drive: Drive) -> str:
    """The mount and how it is judged."""
    parts = []
    for axis, name, unit, factor, digits in AXES:
        measured: Measured | None = getattr(drive.mount, axis)
        if measured is not None:
            within = drive.within(axis)
            mark = "" if within is None else (" (within tolerance)" if within else " (OUTSIDE its tolerance)")
            value, sigma = factor * measured.value, factor * measured.sigma
            parts.append(f"{name} {value:.{digits}f} +- {sigma:.{digits}f} {unit}{mark}")
    return f"mount: {', '.join(parts)}" if parts else "mount: not measured"


def _pair(drive: Drive) -> list[str]:
    """The pair and, where it was mended, what it was before."""
    if drive.mended is None:
        return _spread("stereo pair", drive.pair)
    before = _spread("stereo pair as it was calibrated", drive.mended.before)
    return [*_spread("stereo pair, mended", drive.pair), *before]


def _lidar(drive: Drive) -> list[str]:
    """How the LiDAR stands against its calibration, where there is one."""
    if drive.lidar is None:
        return []
    return ["LiDAR against its calibration:", *(f"  {line}" for line in lidar_lines(drive.lidar))]


def _spread(name: str, pair: Pair) -> list[str]:
    """The verdict and, one to a line, what it rests on."""
    return [f"{name}: {pair.verdict}", *(f"  {part}" for part in pair.why.split("; "))]


def _remedy(drive: Drive, out: Path) -> list[str]:
    if drive.mended is not None:
        return [f"remedy: calibrate this rig with {out / MENDED} from now on; all numbers here are for it"]
    if drive.pair.verdict in ("suspect", "bad") and _can_be_mended(drive.pair):
        return [f"remedy: run again with --self-calibrate, or with --calibration {out / MENDED}"]
    return []


def _can_be_mended(pair: Pair) -> bool:
    return pair.correction is not None and not pair.correction.nothing
