"""The tolerance file: how a camera should be mounted.

It gives (YAML or JSON) for any of `height_m pitch_deg roll_deg yaw_deg` the `nominal` value and the `tolerance`
about it, in metres and degrees.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from stereocalib_core.errors import ConfigError
from stereocalib_core.files.io import MOUNT_KEYS
from stereocalib_core.results import Tolerance
from stereocalib_core.system.yaml_file import read_mapping


def read_tolerances(path: Path) -> dict[str, Tolerance]:
    """A tolerance file as the limits of a `Drive`; raises ConfigError."""
    limits: dict[str, Tolerance] = {}
    for axis, given in read_mapping(path, "tolerance file").items():
        if axis not in MOUNT_KEYS:
            raise ConfigError(f"unknown axis {axis}", path, f"known are {' '.join(MOUNT_KEYS)}")
        values = given if isinstance(given, dict) else {}
        nominal, tolerance = (_number(values.get(key)) for key in ("nominal", "tolerance"))
        if nominal is None or tolerance is None or tolerance < 0:
            raise ConfigError(
                f"bad tolerance of {axis}", path, "write `{nominal: NUMBER, tolerance: NUMBER}`"
            )
        field, unit = MOUNT_KEYS[axis]
        limits[field] = Tolerance(nominal * unit, tolerance * unit)
    return limits


def _number(value: Any) -> float | None:
    usable = isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) < 1e6
    return float(value) if usable else None
