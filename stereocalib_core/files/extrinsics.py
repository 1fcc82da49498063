"""extrinsics.csv: one row a frame, in metres and degrees; an empty cell means that there is no value."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.errors import FailureReason, SourceError
from stereocalib_core.frames import epoch_of
from stereocalib_core.results import AXES, TO_DEGREES, FrameTable, column_name
from stereocalib_core.system.whole_file import write_atomic

SERIES = ("values", "sigma", "filtered", "filtered_sigma", "smoothed", "smoothed_sigma")
"""What is written of each axis, in this order."""
NUMBERS = tuple(
    column_name(axis, series).replace("_rad", "_deg") for series in SERIES for axis in AXES
)  # height_m, pitch_deg, roll_deg, height_sigma_m, ...
COLUMNS = (
    *("frame", "timestamp_s", "status", "reason"),
    *NUMBERS,
    *("filter_state", "free_fraction", "inliers"),
)


def format_cell(value: float | None, digits: int = 6) -> str:
    """Fixed decimals, empty for None or a number that is not finite, never `-0`."""
    if value is None or not math.isfinite(value):
        return ""
    text = f"{value:.{digits}f}"
    return text[1:] if text.startswith("-") and not text.strip("-0.") else text


def extrinsics_rows(table: FrameTable) -> Iterator[list[str]]:
    """The cells of extrinsics.csv without its header, one row per frame."""
    numbers, timestamp_s = [getattr(table, series) for series in SERIES], table.timestamp_s
    for i in range(len(table.frame)):
        row = np.concatenate([series[i] * TO_DEGREES for series in numbers])
        yield [
            str(table.frame[i]),
            format_cell(timestamp_s[i]),
            "ok" if table.ok[i] else "failed",
            table.reason[i],
            *map(format_cell, row.tolist()),
            table.filter_state[i],
            format_cell(table.free_fraction[i], 4),
            format_cell(table.inliers[i], 0),
        ]


def write_extrinsics_csv(path: Path, table: FrameTable) -> None:
    """One row per frame, columns as in `COLUMNS`."""
    lines = [",".join(COLUMNS), *(",".join(row) for row in extrinsics_rows(table))]
    write_atomic(path, "\n".join(lines) + "\n")


def read_extrinsics_csv(path: Path) -> FrameTable:
    """The table that a run wrote; raises SourceError."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            header, *rows = list(csv.reader(file)) or [[]]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise SourceError("extrinsics cannot be read", path, "run the drive again") from error
    # runs of before there was a look back lack its columns
    if any(name not in header for name in COLUMNS if "_smoothed_" not in name):
        raise SourceError("no extrinsics table", path, "its first line must name the columns")

    def texts(name: str) -> tuple[str, ...]:
        place = header.index(name)
        try:
            return tuple(row[place] for row in rows)
        except IndexError as error:
            raise SourceError(f"bad column {name}", path, "run the drive again") from error

    def numbers(name: str) -> NDArray[np.float64]:
        try:
            return np.array([float(cell) if cell else np.nan for cell in texts(name)])
        except ValueError as error:
            raise SourceError(f"bad column {name}", path, "run the drive again") from error

    def series(name: str) -> NDArray[np.float64]:
        names = [column_name(axis, name).replace("_rad", "_deg") for axis in AXES]
        if any(column not in header for column in names):
            return np.full((len(rows), 3), np.nan)
        return np.column_stack([numbers(column) for column in names]) / TO_DEGREES

    unknown = set(texts("reason")) - {"", *FailureReason}
    if unknown:
        raise SourceError(f"unknown reason {min(unknown)[:40]}", path, "run the drive again")
    frame = numbers("frame")
    if not np.isfinite(frame).all():
        raise SourceError("bad column frame", path, "run the drive again")
    times = numbers("timestamp_s")
    epoch_s = epoch_of(times[0]) if len(times) and np.isfinite(times[0]) else 0.0
    return FrameTable(
        frame=frame.astype(np.int64),
        elapsed_s=times - epoch_s,
        ok=np.array([status == "ok" for status in texts("status")], dtype=np.bool_),
        reason=texts("reason"),
        values=series("values"),
        sigma=series("sigma"),
        filtered=series("filtered"),
        filtered_sigma=series("filtered_sigma"),
        smoothed=series("smoothed"),
        smoothed_sigma=series("smoothed_sigma"),
        filter_state=texts("filter_state"),
        free_fraction=numbers("free_fraction"),
        inliers=numbers("inliers"),
        epoch_s=epoch_s,
    )
