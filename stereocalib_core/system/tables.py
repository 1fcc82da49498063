"""Text tables of numbers, with an error that names the line."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.errors import SourceError


def read_table(path: Path, columns: int, what: str, skip: int = 0) -> NDArray[np.float64]:
    """(N, columns) numbers, one row a line after `skip` lines; raises SourceError that names the line."""
    try:
        lines = path.read_text(encoding="ascii", errors="replace").splitlines()
    except OSError as error:
        raise SourceError(f"{what} cannot be read", path, error.strerror or "check the file") from error
    rows = []
    for number, line in enumerate(lines[skip:], start=skip + 1):
        values = parse_numbers(line.replace(",", " ").split())
        if values is None or len(values) != columns:
            if line.strip():
                raise SourceError(f"bad {what}", f"{path}, line {number}", f"expected {columns} numbers")
            continue
        rows.append(values)
    return np.array(rows, dtype=np.float64).reshape(-1, columns)


def parse_numbers(words: Iterable[str]) -> list[float] | None:
    """Words to finite numbers, None where one is none."""
    try:
        values = [float(word) for word in words]
    except ValueError:
        return None
    return values if all(map(math.isfinite, values)) else None
