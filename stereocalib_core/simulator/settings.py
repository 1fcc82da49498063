"""What a synthetic drive can be told, and the line it is told in: ``synthetic[:NAME][?key=value&...]``."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote

from stereocalib_core.errors import ConfigError
from stereocalib_core.geometry import Extrinsics, StereoCamera
from stereocalib_core.simulator.faults import Fault, parse_fault, spell
from stereocalib_core.system.yaml_file import read_yaml

NAMES = ("town", "curves", "straight", "plane")


@dataclass(frozen=True)
class DriveSettings:
    """Everything that a synthetic drive depends on. Amounts: 0 = off, 1 = default.

    frames: the first N, None = all. path: KITTI poses to drive along. The rest by suffix.
    """

    name: str = "town"
    seed: int = 0
    frames: int | None = None
    path: str | None = None
    mount_height_m: float = 1.65
    mount_pitch_deg: float = 0.8
    mount_roll_deg: float = -0.4
    mount_yaw_deg: float = -0.3
    lever_arm_m: float = 0.95
    traffic: float = 1.0
    camber: float = 1.0
    noise: float = 1.0
    exposure_difference: float = 1.0
    body_motion: float = 1.0
    load: float = 0.0
    vignetting: float = 1.0
    motion_blur: float = 1.0
    rectification_error: float = 0.0
    lidar: int = 0
    lidar_noise: float = 1.0
    width: int = 1226
    height: int = 370
    focal_px: float = 707.0912
    cx_px: float = 601.8873
    cy_px: float = 183.1104
    baseline_m: float = 0.5371506533
    faults: tuple[Fault, ...] = ()

    @property
    def camera(self) -> StereoCamera:
        """KITTI's by default."""
        return StereoCamera(self.width, self.height, self.focal_px, self.cx_px, self.cy_px, self.baseline_m)

    @property
    def mount(self) -> Extrinsics:
        """How the camera stands on a car at rest on a flat road."""
        return Extrinsics.from_degrees(
            self.mount_height_m, self.mount_pitch_deg, self.mount_roll_deg, self.mount_yaw_deg
        )

    def spec(self) -> str:
        """The line that gives these settings."""
        words = []
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if field.name not in ("name", "faults") and value != field.default:
                words.append(f"{field.name}={value}")
        words += [f"fault={spell(fault)}" for fault in self.faults]
        return f"synthetic:{self.name}" + ("?" + "&".join(words) if words else "")


CAMERA_KEYS = ("width", "height", "focal_px", "cx_px", "cy_px", "baseline_m")
"""What `camera=FILE` brings."""
KEYS = tuple(f.name for f in dataclasses.fields(DriveSettings) if f.name not in ("name", "faults"))
_RANGES = {
    "seed": (0, 2**31 - 1),
    "frames": (1, 100_000),
    "mount_height_m": (0.15, 5.0),
    "mount_pitch_deg": (-35.0, 35.0),
    "mount_roll_deg": (-25.0, 25.0),
    "mount_yaw_deg": (-20.0, 20.0),
    "lever_arm_m": (-5.0, 5.0),
    "lidar": (0, 1),
    "width": (32, 8192),
    "height": (32, 8192),
    "focal_px": (20.0, 20000.0),
    "cx_px": (-8192.0, 16384.0),
    "cy_px": (-8192.0, 16384.0),
    "baseline_m": (0.01, 5.0),
}
_AMOUNT = (0.0, 10.0)


def parse_spec(spec: str) -> DriveSettings:
    """`synthetic[:NAME][?key=value&...]` to settings; anything else is a ConfigError of one line."""
    head, _, query = spec.partition("?")
    word, _, name = head.partition(":")
    if word != "synthetic":
        raise ConfigError("not a synthetic drive", spec, "write synthetic[:NAME][?key=value&...]")
    options: dict[str, str] = {}
    faults: list[str] = []
    for pair in filter(None, query.split("&")):
        key, equals, value = pair.partition("=")
        if not equals:
            raise ConfigError("option without a value", f"{pair} in {spec}", "write key=value")
        if key == "fault":
            faults.append(unquote(value))
        elif key in options:
            raise ConfigError("option given twice", f"{key} in {spec}", "give it once")
        else:
            options[key] = unquote(value)
    return from_options(name or "town", options, faults)


def from_options(name: str, options: dict[str, str], faults: list[str]) -> DriveSettings:
    """The same from separate words, as `stereocalib synth` has them."""
    if name not in NAMES:
        raise ConfigError("no such synthetic drive", name, f"use one of {' '.join(NAMES)}")
    values: dict[str, object] = {}
    if "camera" in options:
        values.update(_camera(options["camera"]))
    for key, text in options.items():
        if key == "camera":
            continue
        if key not in KEYS:
            raise ConfigError(
                "no such option of a synthetic drive", key, f"use one of {' '.join(KEYS)} fault"
            )
        values[key] = text if key == "path" else _number(key, text)
    if "path" in values and not Path(str(values["path"])).is_file():
        raise ConfigError(
            "pose file not found", values["path"], "give a file of KITTI poses, 12 numbers a line"
        )
    parsed = tuple(parse_fault(fault) for fault in faults)
    return DriveSettings(name=name, faults=parsed, **values)  # type: ignore[arg-type]


def _camera(file: str) -> dict[str, int | float]:
    """Size, focal length, principal point and baseline of a camera.yaml; single options may change them again."""
    if not Path(file).is_file():
        raise ConfigError(
            "camera file not found", file, "give a camera.yaml with width, height, focal_px, ..."
        )
    read = read_yaml(Path(file))
    if not isinstance(read, dict):
        raise ConfigError("no camera file", file, f"it needs {', '.join(CAMERA_KEYS)}")
    lacking = [key for key in CAMERA_KEYS if key not in read]
    if lacking:
        raise ConfigError("camera file lacks values", file, f"add {', '.join(lacking)}")
    return {key: _number(key, str(read[key])) for key in CAMERA_KEYS}


def _number(key: str, text: str) -> int | float:
    whole = key in ("seed", "frames", "lidar", "width", "height")
    kind = "a whole number" if whole else "a number"
    try:
        value = int(text) if whole else float(text)
    except ValueError:
        raise ConfigError(f"{key} is not {kind}", f"{key}={text}", f"give {kind}") from None
    low, high = _RANGES.get(key, _AMOUNT)
    if not math.isfinite(value) or not low <= value <= high:
        raise ConfigError(f"{key} is out of range", f"{key}={text}", f"stay within {low:g} and {high:g}")
    return value
