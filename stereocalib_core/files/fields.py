"""The fields of a JSON object, each with the type that is expected or refused in one line."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from stereocalib_core.errors import SourceError
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.results import Measured

REMEDY = "it was written by another version or by hand; run the drive again"


@dataclass(frozen=True)
class Fields:
    """One object of the file at `path`. What is missing or null is None; raises SourceError for a wrong type.

    within: the name of the object, ending in a dot, for messages.
    """

    values: Mapping[str, Any]
    path: Path
    within: str = ""

    def _is(self, key: str, kind: type | tuple[type, ...], what: str) -> Any:
        value = self.values.get(key)
        if value is None:
            return None
        if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
            raise self._wrong(key, what)
        return value

    def _wrong(self, key: str, what: str) -> SourceError:
        return SourceError(f"{self.within}{key} is no {what}", self.path, REMEDY)

    def number(self, key: str) -> float | None:
        """A finite number."""
        value = self._is(key, (int, float), "number")
        if value is not None and not math.isfinite(value):
            raise self._wrong(key, "finite number")
        return value if value is None else float(value)

    def need(self, key: str) -> float:
        """A number that must be there."""
        value = self.number(key)
        if value is None:
            raise self._wrong(key, "number")
        return value

    def text(self, key: str) -> str | None:
        """A string."""
        return self._is(key, str, "text")  # type: ignore[no-any-return]

    def flag(self, key: str, otherwise: bool) -> bool:
        """Yes or no; `otherwise` where it is not told."""
        value = self._is(key, bool, "yes or no")
        return otherwise if value is None else bool(value)

    def choice(self, key: str, known: tuple[str, ...], needed: bool = False) -> Any:
        """One of a few strings."""
        value = self.text(key)
        if value not in known and (needed or value is not None):
            raise self._wrong(key, f"one of {' '.join(known)}")
        return value

    def block(self, key: str) -> Fields:
        """An object; an empty one where there is none."""
        return Fields(self._is(key, dict, "object") or {}, self.path, f"{self.within}{key}.")

    def numbers(self) -> dict[str, float]:
        """All of it, an object of numbers."""
        return {key: self.need(key) for key in self.values}

    def _list(self, key: str) -> list[Any]:
        return self._is(key, list, "list") or []

    def blocks(self, key: str) -> list[Fields]:
        """A list of objects."""
        entries = self._list(key)
        if not all(isinstance(entry, dict) for entry in entries):
            raise self._wrong(key, "list of objects")
        return [Fields(entry, self.path, f"{self.within}{key}[{i}].") for i, entry in enumerate(entries)]

    def texts(self, key: str) -> tuple[str, ...]:
        """A list of strings."""
        entries = self._list(key)
        if not all(isinstance(entry, str) for entry in entries):
            raise self._wrong(key, "list of texts")
        return tuple(entries)

    def list_of_numbers(self, key: str) -> tuple[float, ...]:
        """A list of finite numbers."""
        entries = self._list(key)
        return tuple(
            Fields({"entry": entry}, self.path, f"{self.within}{key}.").need("entry") for entry in entries
        )

    def matrix(self, key: str, rows: int, columns: int) -> Array:
        """(rows, columns) finite numbers, a list of rows, that must be there."""
        entries = self._list(key)
        found = [
            Fields({"row": entry}, self.path, f"{self.within}{key}.").list_of_numbers("row")
            for entry in entries
        ]
        if [len(row) for row in found] != [columns] * rows:
            raise self._wrong(key, f"matrix of {rows} by {columns}")
        return np.array(found)

    def pairs(self, key: str) -> tuple[tuple[int, int], ...]:
        """A list of pairs of whole numbers."""
        entries = self._list(key)
        for entry in entries:
            whole = isinstance(entry, list) and [type(number) for number in entry] == [int, int]
            if not whole:
                raise self._wrong(key, "list of pairs of frames")
        return tuple((first, last) for first, last in entries)

    def pair(self, key: str) -> tuple[int, int]:
        """A pair of whole numbers that must be there."""
        return Fields({key: [self.values.get(key)]}, self.path, self.within).pairs(key)[0]

    def measured(self, key: str, unit: float = 1.0) -> Measured | None:
        """`{"value", "sigma"}` in a unit; None where there is no value."""
        entry = self.block(key)
        value, sigma = entry.number("value"), entry.number("sigma")
        return None if value is None else Measured(value * unit, (sigma or 0.0) * unit)
