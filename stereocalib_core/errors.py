"""What can go wrong, in two kinds.

A *frame* that cannot be used is a value (`Failure`), because a drive goes on without it.
*Input or settings* that cannot be used raise a `StereoCalibError`: one line that says what, where
and what to do.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class StereoCalibError(Exception):
    """Bad input or settings. `str(error)` is `<what>: <where>: <what to do>`, one line."""

    def __init__(self, what: str, where: object, remedy: str) -> None:
        self.what, self.where, self.remedy = what, str(where).strip() or "(empty)", remedy
        super().__init__(" ".join(f"{what}: {self.where}: {remedy}".split()))


class SourceError(StereoCalibError):
    """The recording cannot be opened or is none."""


class ConfigError(StereoCalibError):
    """A settings file or command-line value is wrong."""


class OutputError(StereoCalibError):
    """The output folder cannot be used."""


class FailureReason(StrEnum):
    """Why a frame has no estimate (the `reason` column of extrinsics.csv)."""

    UNREADABLE = "UNREADABLE"
    SIZE_MISMATCH = "SIZE_MISMATCH"
    MISSING_PAIR = "MISSING_PAIR"
    DARK = "DARK"
    SATURATED = "SATURATED"
    FLAT_TEXTURE = "FLAT_TEXTURE"
    FROZEN = "FROZEN"
    SWAPPED = "SWAPPED"
    MISALIGNED = "MISALIGNED"
    NO_DISPARITY = "NO_DISPARITY"
    NO_ROAD = "NO_ROAD"
    NOT_PLANAR = "NOT_PLANAR"
    TOO_UNCERTAIN = "TOO_UNCERTAIN"
    OUT_OF_RANGE = "OUT_OF_RANGE"
    INCONSISTENT = "INCONSISTENT"
    CALIBRATION = "CALIBRATION"
    UNSYNCHRONISED = "UNSYNCHRONISED"


@dataclass(frozen=True)
class Failure:
    """A frame's reason together with the numbers behind it, e.g. `mean grey 3 of at least 12`."""

    reason: FailureReason
    detail: str
