"""Speed and turn rate of the car, from the path that speaks for the drive, and from the truth."""

from __future__ import annotations

import numpy as np

from stereocalib_app.drive.signals.row import Known, Row, Trace, Values
from stereocalib_app.widgets import palette


def speed_and_turn(poses: Values, times_s: Values) -> tuple[Values, Values]:
    """(N,) metres a second and degrees a second between each frame and the one before; NaN where unknown.

    poses: (N, 4, 4) T_world_camera. A turn to the right is positive (about y, which points down).
    """
    count = min(len(poses), len(times_s))
    speed, turn = np.full((2, count), np.nan)
    if count < 2:
        return speed, turn
    step_s = np.diff(times_s[:count])
    good = step_s > 0
    moved = np.linalg.norm(np.diff(poses[:count, :3, 3], axis=0), axis=1)
    forward = poses[:count, :3, 2]
    heading = np.arctan2(forward[:, 0], forward[:, 2])
    turned = np.angle(np.exp(1j * np.diff(heading)))
    speed[1:][good] = moved[good] / step_s[good]
    turn[1:][good] = np.rad2deg(turned[good]) / step_s[good]
    return speed, turn


def motion(known: Known) -> list[Row]:
    """Speed and turn rate."""
    sources = [
        (name, known.paths.poses[key], color, style)
        for name, key, color, style in (
            ("measured", "autocalibrated", palette.VARIANT["autocalibrated"], "line"),
            ("live settings", "live", palette.LIVE, "line"),
            ("truth", "ground_truth", palette.TRUTH, "dashed"),
        )
        if key in known.paths.poses
    ]
    if not sources:
        return []
    found = [(n, speed_and_turn(p, known.times_s), c, s) for n, p, c, s in sources]
    return [
        Row(key, label, unit, "Motion",
            tuple(Trace(n, known.column(values[i]), c, s) for n, values, c, s in found), span)  # type: ignore[arg-type]
        for i, (key, label, unit, span) in enumerate(
            (("speed", "speed", "m/s", 1.0), ("turn", "turn rate", "°/s", 2.0))
        )
    ]  # fmt: skip
