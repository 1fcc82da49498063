"""Settings: one frozen dataclass per stage, their defaults, and how they are read.

One file a room: `front`, `back`, `lidar`; here they become one tree.

A settings file is JSON or YAML with any part of the tree that `stereocalib run` writes to `config.json`;
what is left out keeps its default. Unknown keys and values of the wrong type are refused, and numbers that are
not positive: every one is a size, a limit or a count.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

from pydantic import TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from stereocalib_core.config.back import (
    FilterConfig,
    RectificationConfig,
    RoadPointsConfig,
    ShiftAlarmConfig,
    YawConfig,
)
from stereocalib_core.config.front import (
    DirectConfig,
    DisparityConfig,
    FreeMapConfig,
    ImageConfig,
    LaneConfig,
    LimitsConfig,
    ProfileConfig,
)
from stereocalib_core.config.lidar import RoadCheckConfig
from stereocalib_core.config.strict import STRICT
from stereocalib_core.errors import ConfigError
from stereocalib_core.system.yaml_file import read_yaml

__all__ = [
    "DirectConfig", "DisparityConfig", "FilterConfig", "FreeMapConfig", "ImageConfig", "LaneConfig", "LimitsConfig",
    "Method", "PipelineConfig", "ProfileConfig", "RectificationConfig", "RoadCheckConfig", "RoadPointsConfig",
    "ShiftAlarmConfig", "YawConfig", "from_dict", "load", "to_dict",
]  # fmt: skip

Method = Literal["direct", "paper"]


@dataclass(frozen=True, config=STRICT)
class PipelineConfig:
    """Everything a run is set by."""

    method: Method = "direct"
    images: ImageConfig = ImageConfig()
    disparity: DisparityConfig = DisparityConfig()
    free_map: FreeMapConfig = FreeMapConfig()
    profile: ProfileConfig = ProfileConfig()
    lane: LaneConfig = LaneConfig()
    direct: DirectConfig = DirectConfig()
    limits: LimitsConfig = LimitsConfig()
    rectification: RectificationConfig = RectificationConfig()
    filter: FilterConfig = FilterConfig()
    yaw: YawConfig = YawConfig()
    shift_alarm: ShiftAlarmConfig = ShiftAlarmConfig()
    road_check: RoadCheckConfig = RoadCheckConfig()


def to_dict(config: Any) -> dict[str, Any]:
    """A config dataclass as plain values, nested."""
    return dataclasses.asdict(config)


def load(path: Path) -> PipelineConfig:
    """Read a whole or partial settings file (JSON or YAML)."""
    values = read_yaml(path)
    return from_dict({} if values is None else values, path)


def from_dict(values: Any, where: object = "settings") -> PipelineConfig:
    """Plain nested values to a config; what is left out keeps its default."""
    try:
        config = TypeAdapter(PipelineConfig).validate_python(values)
    except ValidationError as error:
        first = error.errors()[0]
        field = ".".join(str(part) for part in first["loc"]) or "top level"
        raise ConfigError(f"bad setting {field}", where, first["msg"]) from error
    for field, value in _numbers(to_dict(config)):
        most = math.pi / 2 if field.endswith("_rad") else math.inf
        if not 0 < value < most:
            raise ConfigError(f"bad setting {field}", where, f"{value:g} is not between 0 and {most:.4g}")
    return config


def _numbers(values: dict[str, Any], stage: str = "") -> Iterator[tuple[str, float]]:
    """Every number of nested settings with its dotted name."""
    for name, value in values.items():
        if isinstance(value, dict):
            yield from _numbers(value, f"{stage}{name}.")
        elif not isinstance(value, (str, bool)):
            yield stage + name, value
