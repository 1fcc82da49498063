"""What a drive says of its LiDAR against the camera, in rows and lines."""

from __future__ import annotations

import numpy as np

from stereocalib_core.config.verdicts import SURE
from stereocalib_core.results import ANGLES, LidarCheck, LidarShift

AXES = (
    ("height", "higher", "lower"),
    ("pitch", "looks further down", "looks further up"),
    ("roll", "leans right", "leans left"),
    ("yaw", "looks further left", "looks further right"),
    ("x", "further right", "further left"),
    ("z", "further ahead", "further back"),
)
"""Each axis with what a LiDAR does that stands otherwise than calibrated, by its sign."""


def in_units(axis: str, value: float) -> tuple[float, str, int]:
    """A value [m or rad] as people read it, its unit and digits: centimetres and degrees."""
    return (float(np.rad2deg(value)), "deg", 3) if axis in ANGLES else (100.0 * value, "cm", 1)


def axis_words(axis: str, value: float, sigma: float) -> tuple[str, str]:
    """`+0.012 +- 0.040 deg` and what that means."""
    shown, unit, digits = in_units(axis, value)
    spread = in_units(axis, sigma)[0]
    more, less = next((more, less) for name, more, less in AXES if name == axis)
    meaning = (more if value > 0 else less) if abs(value) > SURE * sigma else "as calibrated"
    return f"{shown:+.{digits}f} +- {spread:.{digits}f} {unit}", meaning


def shift_line(shift: LidarShift) -> str:
    """A finding in one line."""
    size, unit, digits = in_units(shift.axis, shift.size)
    sigma = in_units(shift.axis, shift.sigma)[0]
    if shift.kind == "offset":
        return f"calibration off by {size:+.{digits}f} +- {sigma:.{digits}f} {unit} of {shift.axis} from the start"
    who = {"lidar": "the LiDAR", "camera": "the camera", None: "LiDAR or camera"}[shift.moved]
    return (
        f"{who} slipped by {size:+.{digits}f} +- {sigma:.{digits}f} {unit} of {shift.axis} "
        f"at frame {shift.frame}, certain by {shift.detected_at}"
    )


def lidar_lines(check: LidarCheck) -> list[str]:
    """The answer in lines of text: where the LiDAR stands, what slipped, and what could not be seen."""
    lines = []
    if check.pose is not None:
        for (axis, _, _), value, sigma in zip(AXES, check.pose.six, check.pose.sigma, strict=True):
            if np.isfinite(value):
                lines.append("{:<7} {}  {}".format(axis, *axis_words(axis, value, sigma)))
            else:
                lines.append(f"{axis:<7} not measured")
    lines += [shift_line(shift) for shift in check.shifts]
    if check.why:
        unseen = [
            name for name, one in (("yaw", check.yaw_rad), ("x", check.x_m), ("z", check.z_m)) if one is None
        ]
        lines.append(f"not measured: {', '.join(unseen)}: {check.why}")
    return lines
