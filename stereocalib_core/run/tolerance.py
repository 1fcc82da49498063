"""Is the camera mounted as it should be? A tolerance file against what a drive measured.

The file (YAML or JSON) gives for any of `height_m pitch_deg roll_deg yaw_deg` the `nominal` value and the
`tolerance` about it, in metres and degrees.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stereocalib_core.errors import ConfigError
from stereocalib_core.system.yaml_file import read_mapping

AXES = ("height_m", "pitch_deg", "roll_deg", "yaw_deg")
_KEYS = ("nominal", "tolerance")


@dataclass(frozen=True)
class Tolerance:
    """Limits of one axis in its own unit (m or deg)."""

    nominal: float
    tolerance: float

    def holds(self, value: float) -> bool:
        """Whether `value` is within the limits."""
        return abs(value - self.nominal) <= self.tolerance


def read_tolerances(path: Path) -> dict[str, Tolerance]:
    """A tolerance file; raises ConfigError."""
    limits: dict[str, Tolerance] = {}
    for axis, given in read_mapping(path, "tolerance file").items():
        if axis not in AXES:
            raise ConfigError(f"unknown axis {axis}", path, f"known are {' '.join(AXES)}")
        values = given if isinstance(given, dict) else {}
        nominal, tolerance = (_number(values.get(key)) for key in _KEYS)
        if nominal is None or tolerance is None or tolerance < 0:
            raise ConfigError(
                f"bad tolerance of {axis}", path, "write `{nominal: NUMBER, tolerance: NUMBER}`"
            )
        limits[axis] = Tolerance(nominal, tolerance)
    return limits


def _number(value: Any) -> float | None:
    usable = isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) < 1e6
    return float(value) if usable else None


def within_tolerance(mount: Mapping[str, Any], limits: Mapping[str, Tolerance]) -> bool | None:
    """Whether every limited axis of report.json's `mount` holds; None when one was not measured."""
    if not limits:
        return None
    measured = {axis: mount.get(axis) for axis in limits}
    if any(value is None or value.get("value") is None for value in measured.values()):
        return None
    return all(limit.holds(measured[axis]["value"]) for axis, limit in limits.items())  # type: ignore[index]


def judged(mount: Mapping[str, Any], limits: Mapping[str, Tolerance]) -> dict[str, Any]:
    """report.json's `mount` with `within_tolerance` and, per limited axis, the limits and whether it holds."""

    def within(axis: str, limit: Tolerance) -> bool | None:
        value = (mount.get(axis) or {}).get("value")
        return None if value is None else limit.holds(value)

    return {
        **mount,
        "within_tolerance": within_tolerance(mount, limits),
        "tolerance": {
            axis: {
                "nominal": limit.nominal,
                "tolerance": limit.tolerance,
                "within": within(axis, limit),
            }
            for axis, limit in limits.items()
        },
    }
