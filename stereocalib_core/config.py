"""Settings: one frozen dataclass per stage, their defaults, and how they are read and written.

A settings file is JSON or YAML with any part of the tree that `stereocalib run` writes to `config.json`;
what is left out keeps its default. Unknown keys and values of the wrong type are refused.
"""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any, Literal

import yaml
from pydantic import ConfigDict, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from stereocalib_core.errors import ConfigError

_STRICT = ConfigDict(extra="forbid")


@dataclass(frozen=True, config=_STRICT)
class DisparityConfig:
    """Dense matching. `scale` 2 matches at half resolution, 1 at full."""

    scale: Literal[1, 2] = 2
    max_disparity_px: int = 128
    """Largest disparity searched, in full-resolution pixels."""
    block_size: int = 5
    small_step_penalty: int = 24
    """SGBM's P1. The matcher's downward pass drags each row towards the disparity of the row above, and a road
    grows nearer row by row: the usual 200 costs 0.25 px of disparity (0.06 deg of pitch), 24 costs 0.02 px."""
    large_step_penalty: int = 600
    """SGBM's P2."""
    min_valid_fraction: float = 0.10
    """Fewer valid pixels than this below the middle row: NO_DISPARITY."""


@dataclass(frozen=True, config=_STRICT)
class FreeMapConfig:
    """Obstacles by u-disparity."""

    bin_px: float = 1.0
    """Width of a disparity bin."""
    road_height_m: float = 2.0
    """A camera at most this high over a road: sets how many rows the road itself puts into a bin."""
    road_margin: float = 1.5
    """How much more than the road's own rows makes an obstacle."""
    obstacle_height_m: float = 0.25
    """Lower things are not told from the road."""


@dataclass(frozen=True, config=_STRICT)
class ProfileConfig:
    """Road profile and roll of the paper."""

    min_height_m: float = 0.5
    max_height_m: float = 3.0
    max_pitch_rad: float = 0.19
    min_disparity_px: float = 8.0
    """Farther cells are not used."""
    corridor_half_width_m: float = 2.5
    """Cells farther to the side are not used: roads are cambered."""
    search_slopes: int = 48
    """Heights tried between the smallest and the largest, evenly in their logarithm."""
    search_cells: int = 4000
    """Cells that vote for the first line."""
    search_relative_tolerance: float = 0.06
    """Half width of the band about the first line, as a share of disparity: a rolled road is a wedge."""
    relative_tolerance: float = 0.02
    tolerance_px: float = 1.0
    rounds: int = 6
    min_inliers: int = 300
    roll_min_disparity_px: float = 20.0
    roll_tolerance_px: float = 2.0
    roll_trials: int = 40
    correlated_cells: float = 30.0
    """Neighbouring cells share their error: so many count as one."""
    systematic_px: float = 0.3
    """1 sigma of the profile's intercept that averaging does not remove: the matcher prefers whole disparities."""
    systematic_height_fraction: float = 0.002
    systematic_roll_rad: float = 1e-4


@dataclass(frozen=True, config=_STRICT)
class RectificationConfig:
    """The pair's self-check by the rows of its matches."""

    search_px: float = 128.0
    """Largest disparity searched; 0.4 of it is searched beyond infinity, where only a swapped pair matches."""
    search_rows_px: int = 40
    """Rows searched up and down when few corners match on their own rows."""
    clear_fraction: float = 0.3
    """Fewer of the corners matched than this: search the rows as well."""
    min_matches: int = 12
    """Fewer matches say nothing of a frame."""
    min_frames: int = 3
    """Fewer frames say nothing of a drive."""
    window: int = 15
    """Frames over which a change within the drive is looked for."""
    suspect_pitch_deg: float = 0.045
    suspect_roll_deg: float = 0.06
    bad_pitch_deg: float = 0.15
    bad_roll_deg: float = 0.25


@dataclass(frozen=True, config=_STRICT)
class DirectConfig:
    """Direct alignment of the road plane."""

    near_m: float = 4.0
    far_m: float = 20.0
    lane_half_width_m: float = 1.75
    patch_half_width_px: int = 7
    patch_half_height_px: int = 2
    iterations: int = 4
    robust_rounds: int = 4
    tukey: float = 4.0
    """Residuals beyond so many robust sigmas are rejected."""
    min_scale: float = 0.7
    noise_floor_px: float = 0.01
    initial_unevenness_m: float = 0.004
    uneven_length_m: float = 0.7
    """Road heights closer than this rise and fall together."""
    covariance_factor: float = 1.0
    min_patches: int = 40
    agree_height_m: float = 0.06


@dataclass(frozen=True, config=_STRICT)
class FilterConfig:
    """The filter over height, pitch and roll. Body sizes are standard deviations about the rest pose."""

    natural_hz: float = 1.4
    damping: float = 0.35
    body_height_m: float = 0.006
    body_pitch_deg: float = 0.12
    body_roll_deg: float = 0.10
    rest_height_m: float = 0.004
    """How far the rest pose may wander in a second (braking, curves); it grows with the root of time."""
    rest_angle_deg: float = 0.15
    memory_s: float = 2.0
    """Over which the sizes of body motion and measurement noise are learnt."""
    persistent_share: float = 0.3
    """Of a frame's variance, what it shares with its neighbours: it does not average out."""
    look_ahead: bool = True
    """Use later frames as well, within each unbroken stretch; off = causal."""
    gate: float = 21.0
    """Largest squared Mahalanobis distance of a measurement (3 degrees of freedom)."""
    gate_height_m: float = 0.015
    """What a body may do between two frames besides, 1 sigma."""
    gate_angle_deg: float = 0.15
    recovery_frames: int = 2
    """Gated so often in a row, the filter believes that the mount has moved."""


@dataclass(frozen=True, config=_STRICT)
class PipelineConfig:
    """Everything a run is set by."""

    method: Literal["direct", "paper"] = "direct"
    disparity: DisparityConfig = DisparityConfig()
    free_map: FreeMapConfig = FreeMapConfig()
    profile: ProfileConfig = ProfileConfig()
    direct: DirectConfig = DirectConfig()
    rectification: RectificationConfig = RectificationConfig()
    filter: FilterConfig = FilterConfig()


def to_dict(config: Any) -> dict[str, Any]:
    """A config dataclass as plain values, nested."""
    return dataclasses.asdict(config)


def save(config: PipelineConfig, path: Path) -> None:
    """Write as JSON, stable key order."""
    path.write_text(json.dumps(to_dict(config), indent=2) + "\n", encoding="utf-8")


def load(path: Path) -> PipelineConfig:
    """Read a whole or partial settings file (JSON or YAML)."""
    try:
        values = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError("settings cannot be read", path, error.strerror or "check the path") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ConfigError("settings are neither JSON nor YAML", path, str(error)) from error
    return from_dict({} if values is None else values, path)


def from_dict(values: Any, where: object = "settings") -> PipelineConfig:
    """Plain nested values to a config; what is left out keeps its default."""
    try:
        return TypeAdapter(PipelineConfig).validate_python(values)
    except ValidationError as error:
        first = error.errors()[0]
        field = ".".join(str(part) for part in first["loc"]) or "top level"
        raise ConfigError(f"bad setting {field}", where, first["msg"]) from error
