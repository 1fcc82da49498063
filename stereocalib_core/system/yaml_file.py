"""Reading small YAML or JSON files that strangers may have written."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path
from typing import Any

import yaml

from stereocalib_core.errors import ConfigError, StereoCalibError
from stereocalib_core.system.text_file import read_text

MAX_BYTES = 256 * 1024


class _PlainLoader(yaml.SafeLoader):
    """Plain values only. Aliases are refused: a few lines of them unfold into billions of values."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            mark = self.peek_event().start_mark
            raise yaml.YAMLError(f"aliases are not allowed (line {mark.line + 1})")
        return super().compose_node(parent, index)


def parse_plain(text: str) -> Any:
    """The plain values in a YAML or JSON text; raises yaml.YAMLError, ValueError or RecursionError."""
    if text.lstrip().startswith("{"):  # JSON is YAML too, but takes a hundredth of the time as what it is
        with contextlib.suppress(ValueError):
            return json.loads(text, parse_constant=_no_number)
    return yaml.load(text, Loader=_PlainLoader)


def _no_number(name: str) -> None:
    """NaN and infinities are no JSON: left to YAML, which reads the bare words as text."""
    raise ValueError(name)


def read_yaml(path: Path, what: str = "settings", error: type[StereoCalibError] = ConfigError) -> Any:
    """The plain values in a YAML or JSON file, None for an empty one.

    Raises `error` in one line when the file is missing, over 256 kB, or neither YAML nor JSON.
    """
    text = read_text(path, MAX_BYTES, what, error)
    try:
        return parse_plain(text)
    except (yaml.YAMLError, ValueError, RecursionError) as reason:
        # ValueError covers broken UTF-8, impossible dates and integers of thousands of digits.
        text = " ".join(str(reason).split())[:200] or "check its syntax"
        raise error(f"{what} neither YAML nor JSON", path, text) from reason


def read_mapping(path: Path, what: str, error: type[StereoCalibError] = ConfigError) -> dict[str, Any]:
    """Like `read_yaml`, for a file that must hold `key: value` pairs at its top level."""
    values = read_yaml(path, what, error)
    if not isinstance(values, dict):
        raise error(f"{what} has no keys", path, "write one `key: value` per line")
    return values
