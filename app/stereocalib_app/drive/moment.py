"""What a page shows at one tick, gathered once so that every view speaks of the same frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stereocalib_app.drive.frame_views import FrameView
from stereocalib_app.drive.path_state import PathState
from stereocalib_app.drive.session import Session, Snapshot
from stereocalib_app.drive.settings import Settings
from stereocalib_app.server.clock import ClockState
from stereocalib_core.geometry import Extrinsics
from stereocalib_core.results import Drive, FrameResult


@dataclass(frozen=True)
class Moment:
    """One frame of one drive under one set of settings.

    compared: another run that is laid beside this one.
    frame_changed, drive_changed, settings_changed: what differs from the last tick of this page.
    """

    session: Session
    snapshot: Snapshot
    clock: ClockState
    settings: Settings
    view: FrameView | None
    paths: PathState
    compared: Drive | None
    frame_changed: bool
    drive_changed: bool
    settings_changed: bool

    @property
    def frame(self) -> int:
        """The frame on show."""
        return self.clock.frame

    @property
    def result(self) -> FrameResult | None:
        """Its result, None while it is not computed."""
        return self.snapshot.result(self.clock.frame)

    @property
    def filtered(self) -> tuple[Extrinsics, np.ndarray, str] | None:
        """Filtered extrinsics of the frame, their sigma (3,), and the filter's state."""
        return filtered_at(self.snapshot, self.clock.frame)

    @property
    def best(self) -> tuple[Extrinsics, str] | None:
        """What the road is drawn with, and where it comes from: this pair, else the filter."""
        result, filtered = self.result, self.filtered
        if result is not None and result.road is not None:
            return result.road.extrinsics, "this pair"
        if filtered is not None:
            return filtered[0], filtered[2]
        return None


def filtered_at(snapshot: Snapshot, frame: int) -> tuple[Extrinsics, np.ndarray, str] | None:
    """Filtered extrinsics, sigma (3,) and state of a frame, None where there are none."""
    table = None if snapshot.drive is None else snapshot.drive.frames
    if table is None or frame >= len(table) or table.filter_state[frame] == "none":
        return None
    values = table.filtered[frame]
    if not np.isfinite(values).all():
        return None
    return Extrinsics(*(float(v) for v in values)), table.filtered_sigma[frame], table.filter_state[frame]
