"""What can be broken in a synthetic drive, how it is spelled, and when it is in force.

Spelling: ``KIND[:axis=size]@A[-B]``, frames A to B inclusive; without ``@`` from the first frame on.
Without B, `drop`, `swap` and `freeze` last for the one frame A and everything else lasts to the end. `drift`
grows from A to B (or to the end) and stays.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.config.scene import LARGEST_FAULT
from stereocalib_core.errors import ConfigError

AXES = ("height", "pitch", "roll", "yaw", "x", "z")
ANGLES = ("pitch", "roll", "yaw")
SIZED = {
    "knock": ("pitch", 0.5),
    "drift": ("pitch", 0.5),
    "rectification": ("pitch", 0.05),
    "lidar_knock": ("roll", 0.5),
}
"""Kinds that take an axis, with the axis and size [deg] of the bare word."""
PLAIN = ("dirt", "glare", "drop", "swap", "freeze", "low_texture", "rain", "night", "truck", "ramp")
KINDS = (*SIZED, *PLAIN)
_MOMENTARY = ("drop", "swap", "freeze")
_PATTERN = re.compile(
    r"(?P<kind>[a-z_]+)(?::(?P<axis>[a-z]+)=(?P<size>[^@]+))?(?:@(?P<first>\d+)(?:-(?P<last>\d+))?)?"
)


@dataclass(frozen=True)
class Fault:
    """One fault. size: metres, or degrees where `axis` is an angle; last: inclusive, None = to the end."""

    kind: str
    axis: str | None = None
    size: float = 0.0
    first: int = 0
    last: int | None = None

    def active(self, frame: int) -> bool:
        """Whether it is in force at a frame (for a drift: whether it has begun)."""
        return frame >= self.first and (self.last is None or self.kind == "drift" or frame <= self.last)

    def amount(self, frame: int, frames: int) -> float:
        """How much of it there is at a frame, 0...1, of a drive of `frames` frames."""
        if not self.active(frame):
            return 0.0
        if self.kind != "drift":
            return 1.0
        last = self.last if self.last is not None else frames - 1
        return min(1.0, (frame - self.first) / max(last - self.first, 1))


def parse_fault(text: str) -> Fault:
    """`KIND[:axis=size]@A[-B]` to a `Fault`; ConfigError otherwise."""
    where = f"fault={text}"
    match = _PATTERN.fullmatch(text.strip())
    if match is None:
        raise ConfigError(
            "fault is not spelled right", where, "write KIND[:axis=size]@A[-B], e.g. knock:pitch=0.5@40"
        )
    kind, axis = match["kind"], match["axis"]
    if kind not in KINDS:
        raise ConfigError("no such kind of fault", where, f"use one of {' '.join(KINDS)}")
    first = int(match["first"] or 0)
    last = int(match["last"]) if match["last"] else (first if kind in _MOMENTARY and match["first"] else None)
    if last is not None and last < first:
        raise ConfigError("fault ends before it begins", where, "write @A-B with B at least A")
    if kind in PLAIN:
        if axis is not None:
            raise ConfigError(f"fault {kind} takes no axis", where, f"write {kind}@A[-B]")
        return Fault(kind, None, 0.0, first, last)
    if axis is None:
        axis, size = SIZED[kind]
        return Fault(kind, axis, size, first, last)
    if axis not in AXES:
        raise ConfigError("no such axis", where, f"use one of {' '.join(AXES)}")
    if kind == "rectification" and axis not in ANGLES:
        raise ConfigError("rectification turns the right camera", where, f"use one of {' '.join(ANGLES)}")
    unit = "deg" if axis in ANGLES else "m"
    try:
        size = float(match["size"])
    except ValueError:
        raise ConfigError("fault has a size that is no number", where, f"give it in {unit}") from None
    if not math.isfinite(size) or abs(size) > LARGEST_FAULT[unit]:
        raise ConfigError(
            "fault has an impossible size", where, f"stay within {LARGEST_FAULT[unit]:g} {unit}"
        )
    return Fault(kind, axis, size, first, last)


def spell(fault: Fault) -> str:
    """The inverse of `parse_fault`."""
    axis = f":{fault.axis}={fault.size:g}" if fault.axis else ""
    until = "" if fault.last is None else f"-{fault.last}"
    return f"{fault.kind}{axis}@{fault.first}{until}"


def offsets(faults: tuple[Fault, ...], kinds: tuple[str, ...], frames: int) -> NDArray[np.float64]:
    """(frames, 6) sum of the faults of these kinds over `AXES` [m, rad]."""
    total = np.zeros((frames, len(AXES)))
    for fault in faults:
        if fault.kind in kinds and fault.axis is not None:
            unit = math.radians(fault.size) if fault.axis in ANGLES else fault.size
            amounts = [fault.amount(i, frames) for i in range(frames)]
            total[:, AXES.index(fault.axis)] += unit * np.array(amounts)
    return total


def any_active(faults: tuple[Fault, ...], kind: str, frame: int) -> bool:
    """Whether a fault of this kind is in force at a frame."""
    return any(fault.kind == kind and fault.active(frame) for fault in faults)
