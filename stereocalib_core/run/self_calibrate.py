"""A drive run again with its own pair mended, and the calibration that says how.

A yaw is seen once the rows of both pictures meet: a pair that is turned so far that no frame matches is mended by
its rows first, and shows its yaw in the next run.
"""

from __future__ import annotations

from pathlib import Path

from stereocalib_core.frames import FrameSource
from stereocalib_core.results import Drive, Mending, PairCorrection
from stereocalib_core.sources.calibrations import MENDED, write_calibration
from stereocalib_core.sources.mended import mended, mended_calibration


def next_mending(drive: Drive, applied: Mending | None) -> Mending | None:
    """What to run the drive again with; None where it needs no more, or could not be measured.

    applied: what it was run with. After a first mending only a yaw that had been hidden till then is reason for more.
    """
    found = drive.pair.correction
    if found is None or found.nothing:
        return None
    if applied is None:
        return Mending(found, _first(drive), drive.pair)
    if applied.before.relative_yaw_rad is not None or drive.pair.relative_yaw_rad is None:
        return None
    return Mending(applied.correction.then(found), _first(drive), applied.before)


def _first(drive: Drive) -> int:
    """The frame from which on the values of the pair hold."""
    return max((change.frame for change in drive.pair.changes), default=0)


def mended_by(source: FrameSource, mending: Mending) -> FrameSource:
    """The source with that pair mended."""
    return mended(source, mending.correction, mending.from_frame)


def write_mended(source: FrameSource, drive: Drive, folder: Path) -> Path | None:
    """`calibration_mended.yaml` for the source's own pictures; None where the pair could not be measured.

    A drive that was mended already is described by what was applied: that is what its numbers are for.
    """
    correction: PairCorrection | None = drive.pair.correction
    if drive.mended is not None:
        correction = drive.mended.correction
    if correction is None:
        return None
    return write_calibration(mended_calibration(source, correction), "yaml", folder / MENDED)[0]
