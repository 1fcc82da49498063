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
    min_valid_fraction: float = 0.10
    """Fewer valid pixels than this below the middle row: NO_DISPARITY."""


@dataclass(frozen=True, config=_STRICT)
class PipelineConfig:
    """Everything a run is set by."""

    method: Literal["direct", "paper"] = "direct"
    disparity: DisparityConfig = DisparityConfig()


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
