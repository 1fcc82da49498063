"""What a page is set to show. Immutable; a change makes a new one."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import MappingProxyType

PRESETS = ("Inspect", "Teach", "Debug")
MODELS = ("full", "planar", "nonholonomic")
EXTRINSICS = ("filtered", "raw")
ERROR_LIMIT_DEG, ERROR_LIMIT_M = 2.0, 0.30
LAYOUTS = ("left image", "disparity", "free map", "u-disparity", "v-disparity", "left − right", "LiDAR")


@dataclass(frozen=True)
class Corrections:
    """How the live trajectory treats the extrinsics: strength 0...1 and injected error per axis [deg, m].

    source: `filtered` or `raw` extrinsics. model: motion model of the odometry.
    """

    yaw_strength: float = 1.0
    pitch_strength: float = 1.0
    roll_strength: float = 1.0
    height_strength: float = 1.0
    yaw_error_deg: float = 0.0
    pitch_error_deg: float = 0.0
    roll_error_deg: float = 0.0
    height_error_m: float = 0.0
    source: str = "filtered"
    model: str = "full"

    @property
    def touched(self) -> bool:
        """Whether anything differs from the plain result."""
        return self != Corrections()


@dataclass(frozen=True)
class Settings:
    """Everything a page can be set to."""

    preset: str = "Inspect"
    layout: str = "left image"
    corrections: Corrections = Corrections()
    follow: bool = True
    cloud: bool = True
    markers: bool = False
    color_by_error: bool = False
    teach_step: int = 0
    broken_stage: str = ""
    paths: MappingProxyType[str, bool] = field(default_factory=lambda: MappingProxyType({}))
