"""JSON and any other file, written whole or not at all; the same values give the same bytes."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from stereocalib_core.errors import OutputError, SourceError


def write_atomic(path: Path, content: str | bytes) -> None:
    """Write beside `path` and rename, so that a reader sees the old file or the new one, never a part.

    It is on the disk before it has its name, so that a power cut leaves no empty one either.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with temporary.open("wb") as file:
            file.write(content.encode() if isinstance(content, str) else content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except OSError as error:
        raise OutputError("file cannot be written", path, error.strerror or "check the disk") from error
    finally:
        temporary.unlink(missing_ok=True)


def plain(value: Any) -> Any:
    """Nested values as JSON knows them: numpy to numbers and lists, what is not finite to null."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float):
        return value + 0.0 if math.isfinite(value) else None
    return value


def write_json(path: Path, values: Mapping[str, Any] | Sequence[Any]) -> None:
    """Any report, in the order given; what is not finite becomes null."""
    write_atomic(path, json_bytes(values))


def json_bytes(values: Mapping[str, Any] | Sequence[Any]) -> bytes:
    """What `write_json` writes."""
    return (json.dumps(plain(values), indent=2, allow_nan=False) + "\n").encode()


def read_json(path: Path) -> dict[str, Any]:
    """A JSON object; raises SourceError."""
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise SourceError("report cannot be read", path, "run the drive again") from error
    if not isinstance(values, dict):
        raise SourceError("no report", path, "run the drive again")
    return values
