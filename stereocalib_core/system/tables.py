"""Text tables of numbers, with an error that names the line."""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.errors import SourceError
from stereocalib_core.system.text_file import lines, to_number

MAX_BYTES = 256 << 20
"""A million rows of twelve numbers in full."""


def read_table(path: Path, columns: int, what: str, skip: int = 0) -> NDArray[np.float64]:
    """(N, columns) numbers, one row a line after `skip` lines; raises SourceError that names the line."""
    values = array("d")
    for number, line in enumerate(lines(path, MAX_BYTES, what), start=1):
        if number <= skip:
            continue
        row = parse_numbers(line.replace(",", " ").split())
        if row is None or len(row) != columns:
            if line.strip():
                raise SourceError(f"bad {what}", f"{path}, line {number}", f"expected {columns} numbers")
            continue
        values.extend(row)
    return np.array(values, dtype=np.float64).reshape(-1, columns)


def parse_numbers(words: Iterable[str]) -> list[float] | None:
    """Words to finite numbers, None where one is none."""
    try:
        values = [float(word) for word in words]
    except ValueError:
        return None
    return values if all(map(math.isfinite, values)) else None


def split_words(line: str) -> list[str]:
    """The words of a line of a list: blank, comma or semicolon separated, decimal commas kept together."""
    words = line.replace(";", " ").replace("\t", " ").split()
    if len(words) > 1 and all("," not in word or to_number(word) is not None for word in words):
        return words
    if len(words) == 1 and "." not in line and line.count(",") == 1 and to_number(words[0]) is not None:
        return words
    return line.replace(";", " ").replace(",", " ").split()
