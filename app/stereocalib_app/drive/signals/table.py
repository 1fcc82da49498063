"""Which signals there are, in the order of the list to pick from: a new kind is a file and a line here."""

from __future__ import annotations

from typing import Final

from stereocalib_app.drive.signals.checks import checks
from stereocalib_app.drive.signals.extrinsics import extrinsics
from stereocalib_app.drive.signals.lidar import lidar
from stereocalib_app.drive.signals.motion import motion
from stereocalib_app.drive.signals.pair import pair
from stereocalib_app.drive.signals.path_errors import path_errors
from stereocalib_app.drive.signals.row import Known, Row, Signals

SIGNALS: Final[tuple[Signals, ...]] = (
    extrinsics,
    motion,
    path_errors,
    pair,
    lidar,
    checks,
)


def all_rows(known: Known) -> list[Row]:
    """Every row that a drive can show."""
    return [row for signals in SIGNALS for row in signals(known)]
