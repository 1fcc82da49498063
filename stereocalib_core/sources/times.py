"""Lists of times in the forms that recorders write: seconds, milli-, micro- and nanoseconds, dates, with headers,
frame numbers or file names beside them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from fractions import Fraction
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.config.reading import (
    EPOCHS,
    LARGEST_FRAME_NUMBER,
    LONGEST_STEP_S,
    MOST_BYTES_OF_A_LIST,
    MOST_ROWS,
    SHORTEST_STEP_S,
)
from stereocalib_core.errors import SourceError
from stereocalib_core.frames import epoch_of
from stereocalib_core.system.tables import split_words
from stereocalib_core.system.text_file import lines, to_number

_DATE = re.compile(
    r"(\d{4})[-/.](\d\d?)[-/.](\d\d?)[ T_](\d\d?)[:.](\d\d)[:.](\d\d)(?:[.,](\d+))?(Z|[+-]\d\d:?\d\d)?"
)
UNITS = ((1, "s"), (10**3, "ms"), (10**6, "us"), (10**9, "ns"))
Stamp = int | float | Fraction
"""As it was written: whole numbers and long decimals exactly."""


@dataclass(frozen=True)
class Times:
    """seconds: (N,) since epoch_s, one a row, NaN where a row has none. notes: what had to be assumed."""

    seconds: NDArray[np.float64]
    notes: tuple[str, ...] = ()
    epoch_s: float = 0.0


def since_epoch(stamps: Sequence[Stamp | None], per_second: int) -> tuple[NDArray[np.float64], float]:
    """(N,) seconds since the epoch of the first stamp, NaN for None, and that epoch; exact for whole numbers."""
    first = next((stamp for stamp in stamps if stamp is not None), 0)
    epoch_s = epoch_of(float(first) / per_second)
    start = int(epoch_s) * per_second
    parts = (np.nan if stamp is None else float(stamp - start) / per_second for stamp in stamps)
    return np.array(list(parts), dtype=np.float64), epoch_s


def read_times(path: Path) -> Times | None:
    """The times of a list, one a row; None where there is no such file or nothing in it.

    Raises SourceError in one line for a file that is no list of times.
    """
    if not path.is_file():
        return None
    rows: list[Stamp | None] = []
    header: list[str] = []
    dated = False
    for number, line in enumerate(lines(path, MOST_BYTES_OF_A_LIST, "times"), start=1):
        text = line.strip()
        if text.startswith(("#", "%", "//")):
            header = header or [word.lower() for word in split_words(text.lstrip("#%/ "))]
            continue
        if not text:
            rows.append(None)
            continue
        if len(rows) >= MOST_ROWS:
            raise SourceError("times too long", path, f"at most {MOST_ROWS} rows are read")
        value, is_date = _value(text, header, number)
        if value is None and not any(row is not None for row in rows):
            header = [word.lower() for word in split_words(text)]
            rows.clear()
            continue
        if value is None:
            raise SourceError("bad time", f"{path}, line {number}", "expected a number or `date time`")
        dated = dated or is_date
        rows.append(value)
    while rows and rows[-1] is None:
        rows.pop()
    if not any(row is not None for row in rows):
        return None
    return _in_seconds(rows, header, dated, path.name)


def _value(text: str, header: list[str], number: int) -> tuple[Stamp | None, bool]:
    """The time of one line, as a whole number where it is one, and whether it was a date."""
    if text.isdecimal() and text.isascii() and len(text) <= 25:
        return int(text), False  # most lists are nothing else, and may be long
    date = _DATE.search(text) if ":" in text or "." in text[8:] or "-" in text[1:] else None
    if date is not None:
        return _nanoseconds(date), True
    words = split_words(text)
    values = [_exact(word) for word in words]
    if header and len(header) == len(words):
        for name in ("timestamp", "time", "stamp", "t", "sec", "secs", "timestamp_s", "time_s"):
            column = next((i for i, key in enumerate(header) if re.split(r"[ \[(]", key)[0] == name), None)
            if column is not None and values[column] is not None:
                return values[column], False
    numbers = [value for value in values[:3] if value is not None]
    if not numbers or values[0] is None:
        return (numbers[0] if numbers and len(words) > 1 else None), False
    if len(numbers) > 1 and all(isinstance(n, int) for n in numbers[:2]):
        seconds, rest = numbers[:2]
        if EPOCHS[1][0] < seconds < EPOCHS[1][1] and 0 <= rest < 10**9:
            return int(seconds) * 10**9 + int(rest), False
    if (
        len(numbers) > 1
        and isinstance(numbers[0], int)
        and numbers[0] < LARGEST_FRAME_NUMBER
        and abs(numbers[0] - number) <= 2
    ):
        return numbers[1], False  # the first column counts the rows
    return numbers[0], False


def _exact(word: str) -> Stamp | None:
    if len(word) <= 25 and re.fullmatch(r"[+-]?\d+", word):
        return int(word)
    if re.fullmatch(r"\d{7,19}\.\d{1,9}", word):
        return Fraction(word)
    return to_number(word)


def _nanoseconds(date: re.Match[str]) -> int | None:
    """Nanoseconds since 1970 of a date and a time of day."""
    *parts, fraction, zone = date.groups()
    try:
        moment = datetime(*map(int, parts)) - datetime(1970, 1, 1)  # type: ignore[arg-type]
    except ValueError:
        return None
    offset = 0
    if zone and zone != "Z":
        offset = (1 if zone[0] == "+" else -1) * (int(zone[1:3]) * 3600 + int(zone[-2:]) * 60)
    return (int(moment.total_seconds()) - offset) * 10**9 + int(f"{fraction or '0':0<9.9}")


def _in_seconds(rows: list[Stamp | None], header: list[str], dated: bool, name: str) -> Times:
    known = [row for row in rows if row is not None]
    if dated:
        # dates count from the first one: their zone is not known
        first = next(row for row in rows if row is not None)
        return Times(np.array([np.nan if row is None else (row - first) / 10**9 for row in rows]))
    per_second, unit = _unit(known, header)
    seconds, epoch_s = since_epoch(rows, per_second)
    notes = () if per_second == 1 else (f"{name} is in {unit}: converted to seconds",)
    return Times(seconds, notes, epoch_s)


def _unit(values: list[Stamp], header: list[str]) -> tuple[int, str]:
    """Parts of a second that a list counts in, from its header, its date or its step."""
    words = " ".join(header)
    for per_second, unit in UNITS[1:]:
        if re.search(rf"[\[(_ ]{unit}\b", words):
            return per_second, unit
    first = abs(float(values[0]))
    for per_second, unit in UNITS:
        low, high = EPOCHS[per_second]
        if low <= first <= high:
            return per_second, unit
    if len(values) < 2:
        return UNITS[0]
    step = float(np.median(np.abs(np.diff(np.array([float(value - values[0]) for value in values])))))
    for per_second, unit in UNITS:
        if SHORTEST_STEP_S <= step / per_second <= LONGEST_STEP_S:
            return per_second, unit
    return UNITS[0]


def times_in_names(stems: list[str]) -> Times | None:
    """The times that file names are: `1403636579763555584`, `1317042734.512`; None where they are numbers only."""
    found: list[Stamp] = []
    for stem in stems:
        match = re.search(r"\d{9,19}(?:[._]\d{1,9})?", stem)
        if match is None:
            return None
        text = match.group(0)
        whole, _, fraction = text.replace("_", ".").partition(".")
        if len(whole) <= 10:
            if not fraction:
                return None
            found.append(int(whole) * 10**9 + int(f"{fraction:0<9}"))
        else:
            found.append(int(whole))
    if not found or any(b <= a for a, b in zip(found, found[1:], strict=False)):
        return None
    for per_second, _unit_name in UNITS[1:]:
        low, high = EPOCHS[per_second]
        if low <= found[0] <= high:
            seconds, epoch_s = since_epoch(found, per_second)
            return Times(seconds, (), epoch_s)
    return None
