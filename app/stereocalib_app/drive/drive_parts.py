"""What every way of opening a drive needs: a part of it, and its mount held against limits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

from stereocalib_core.frames import FrameSource, Recording, StereoFrame
from stereocalib_core.results import Drive, Tolerance
from stereocalib_core.run.calibrate import cut_truth

Limits = Mapping[str, Tolerance]
NO_LIMITS: Limits = MappingProxyType({})


def part_of(source: FrameSource, start: int, stop: int) -> FrameSource:
    """Frames start...stop - 1 of a drive as a drive of its own."""
    if (start, stop) == (0, len(source)):
        return source

    def load(index: int) -> StereoFrame:
        return replace(source[start + index], index=index)

    return Recording(
        source.name,
        source.camera,
        source.timestamps_s[start:stop],
        load,
        cut_truth(source.ground_truth, start, stop),
        source.notices,
        source.T_camera_lidar,
        f"{source.content_key}:{start}:{stop}",
        epoch_s=source.epoch_s,
    )


def judged(drive: Drive, limits: Limits) -> Drive:
    """The drive with its mount held against the limits, where there are any."""
    return replace(drive, limits=limits) if limits else drive
