"""Settings: one frozen dataclass per stage, their defaults, and how they are read.

One file a room: `front` (with `bend`), `tracks`, `back` (with `steps`), `odometry`, `vehicle`, `lidar`; here they
become one tree.

A settings file is JSON or YAML with any part of the tree that `stereocalib run` writes to `config.json`;
what is left out keeps its default. Unknown keys and values of the wrong type are refused, and numbers that are
not positive: every one is a size, a limit or a count. Where zero means something the field's own type says so.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from pydantic import TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from stereocalib_core.config.back import (
    CausesConfig,
    ConsistencyConfig,
    FilterConfig,
    LagConfig,
    MountConfig,
    RectificationConfig,
    RoadPointsConfig,
    RowMatchesConfig,
    ShiftAlarmConfig,
    YawConfig,
)
from stereocalib_core.config.bend import BendConfig
from stereocalib_core.config.front import (
    DirectConfig,
    DisparityConfig,
    FreeMapConfig,
    ImageConfig,
    LaneConfig,
    LimitsConfig,
    ProfileConfig,
    RegionConfig,
    SightConfig,
)
from stereocalib_core.config.lidar import LidarAlignmentConfig, RoadCheckConfig, ScanSampleConfig
from stereocalib_core.config.odometry import OdometryConfig
from stereocalib_core.config.own_car import OwnCarConfig
from stereocalib_core.config.pair import PairConfig, ScanDisparityConfig
from stereocalib_core.config.strict import STRICT
from stereocalib_core.config.tracks import TracksConfig
from stereocalib_core.config.vehicle import VehicleConfig
from stereocalib_core.errors import ConfigError
from stereocalib_core.system.yaml_file import read_yaml

__all__ = [
    "BendConfig", "CausesConfig", "ConsistencyConfig", "DirectConfig", "DisparityConfig", "FilterConfig",
    "FreeMapConfig", "ImageConfig", "LagConfig", "LaneConfig", "LidarAlignmentConfig", "LimitsConfig", "Method",
    "MountConfig", "OdometryConfig", "OwnCarConfig", "PairConfig", "PipelineConfig", "ProfileConfig",
    "RectificationConfig", "RegionConfig", "RoadCheckConfig", "RoadPointsConfig", "RowMatchesConfig",
    "ScanDisparityConfig", "ScanSampleConfig", "ShiftAlarmConfig", "SightConfig", "TracksConfig", "VehicleConfig",
    "YawConfig", "from_dict", "load", "to_dict",
]  # fmt: skip

Method = Literal["direct", "paper"]


@dataclass(frozen=True, config=STRICT)
class PipelineConfig:
    """Everything a run is set by."""

    method: Method = "direct"
    images: ImageConfig = ImageConfig()
    disparity: DisparityConfig = DisparityConfig()
    sight: SightConfig = SightConfig()
    region: RegionConfig = RegionConfig()
    free_map: FreeMapConfig = FreeMapConfig()
    profile: ProfileConfig = ProfileConfig()
    lane: LaneConfig = LaneConfig()
    own_car: OwnCarConfig = OwnCarConfig()
    direct: DirectConfig = DirectConfig()
    limits: LimitsConfig = LimitsConfig()
    tracks: TracksConfig = TracksConfig()
    rectification: RectificationConfig = RectificationConfig()
    lag: LagConfig = LagConfig()
    pair: PairConfig = PairConfig()
    vehicle: VehicleConfig = VehicleConfig()
    consistency: ConsistencyConfig = ConsistencyConfig()
    filter: FilterConfig = FilterConfig()
    odometry: OdometryConfig = OdometryConfig()
    yaw: YawConfig = YawConfig()
    mount: MountConfig = MountConfig()
    shift_alarm: ShiftAlarmConfig = ShiftAlarmConfig()
    road_check: RoadCheckConfig = RoadCheckConfig()
    scan_sample: ScanSampleConfig = ScanSampleConfig()
    scan_disparity: ScanDisparityConfig = ScanDisparityConfig()
    lidar_alignment: LidarAlignmentConfig = LidarAlignmentConfig()
    causes: CausesConfig = CausesConfig()


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
    for field, value in _numbers(config):
        most = math.pi / 2 if field.endswith("_rad") else math.inf
        if not 0 < value < most:
            raise ConfigError(f"bad setting {field}", where, f"{value:g} is not between 0 and {most:.4g}")
    return config


def _numbers(config: Any, stage: str = "") -> Iterator[tuple[str, float]]:
    """Every number of nested settings with its dotted name, but those whose type has a lower bound of its own."""
    hints = get_type_hints(type(config), include_extras=True)
    for field in dataclasses.fields(config):
        name, value = stage + field.name, getattr(config, field.name)
        if dataclasses.is_dataclass(value):
            yield from _numbers(value, f"{name}.")
        elif not _bounded(hints[field.name]):
            for number in value if isinstance(value, tuple) else (value,):
                if isinstance(number, (int, float)) and not isinstance(number, bool):
                    yield name, number


def _bounded(hint: Any) -> bool:
    """Whether a field's type says itself how small its value may be."""
    if get_origin(hint) is not Annotated:
        return False
    marks = [part for extra in get_args(hint)[1:] for part in getattr(extra, "metadata", (extra,))]
    return any(hasattr(part, "ge") or hasattr(part, "gt") for part in marks)
