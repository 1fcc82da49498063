"""Opens what an earlier `run` wrote: its results as they are, its pictures where the source is still there."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from stereocalib_app.drive.drive_parts import NO_LIMITS, Limits, judged, part_of
from stereocalib_app.drive.session import Kept, Session
from stereocalib_core.config import PipelineConfig
from stereocalib_core.errors import Failure, FailureReason, StereoCalibError
from stereocalib_core.files.frame_record import Done
from stereocalib_core.files.frames_bin import read_frames, read_outline
from stereocalib_core.files.run_folder import CONFIG, load_run
from stereocalib_core.frames import FrameSource, GroundTruth, Recording, StereoFrame
from stereocalib_core.geometry import StereoCamera
from stereocalib_core.results import Drive, FrontEndMemory
from stereocalib_core.run.drive import FRAMES
from stereocalib_core.run.self_calibrate import mended_by
from stereocalib_core.sources import open_source


def open_run(folder: Path, limits: Limits = NO_LIMITS, door: Callable[[str], str] = str) -> Session:
    """An earlier run: its results as they were written, its pictures where the source is still there.

    door: says what a source may be opened as, and raises where it may not.
    """
    drive = load_run(folder)
    first, count = int(drive.frames.frame[0]), len(drive.frames)
    camera = outlined_camera(folder, drive)
    lost = () if camera is not None else lost_frames(folder)
    config, other_settings = saved_config(folder, drive)
    span = None
    try:
        whole = open_source(door(drive.source))
        if drive.mended is not None:
            whole = mended_by(whole, drive.mended)
        stop = min(first + count, len(whole))
        source, count = part_of(whole, first, stop), stop - first
        span = None if (first, stop) == (0, len(whole)) else (first, stop)
    except StereoCalibError as error:
        times = drive.frames.elapsed_s
        source = without_pictures(folder, camera or UNKNOWN_CAMERA, times, str(error))
        lost += ("the pictures are not where they were: only the numbers are shown",)
    shown = judged(drive, limits)
    table = [from_frame(Done(r, NOTHING, 0.0), first) for r in drive.frames.results()[:count]]
    return Session(
        source,
        config,
        spec=drive.source,
        finished=table,
        reading=None if camera is None else partial(kept_frames, folder, len(drive.frames), first, count),
        analyse=lambda _results: shown,
        frames=span,
        run_folder=folder,
        tracks=camera is not None,
        notices=lost + other_settings,
    )


NOTHING = FrontEndMemory(None, None)
"""What a table knows of what the front end remembered."""


def outlined_camera(folder: Path, drive: Drive) -> StereoCamera | None:
    """The camera of frames.bin where it holds as many frames as the run has, else None."""
    with contextlib.suppress(StereoCalibError):
        camera, frames = read_outline(folder / FRAMES)
        return camera if frames == len(drive.frames) else None
    return None


def lost_frames(folder: Path) -> tuple[str, ...]:
    """What cannot be shown without the frames of frames.bin, where they should be there."""
    if not (folder / FRAMES).is_file():
        return ()
    return (f"{FRAMES} is damaged or of another version: nothing to correct, no limits",)


def kept_frames(folder: Path, frames: int, first: int, count: int) -> Kept:
    """Frames first ... first + count - 1 of frames.bin, which has so many frames, numbered from there."""
    with contextlib.suppress(StereoCalibError):
        finished = read_frames(folder / FRAMES)[1]
        if len(finished) == frames:
            return Kept([from_frame(done, first) for done in finished[:count]])
    return Kept((), lost_frames(folder))


def saved_config(folder: Path, drive: Drive) -> tuple[PipelineConfig, tuple[str, ...]]:
    """The settings of a run, or today's where they are gone or of another version, and a word about that."""
    if drive.config is not None:
        return drive.config, ()
    other = ("config.json is of another version: the stages are shown with today's settings",)
    return PipelineConfig(), other if (folder / CONFIG).is_file() else ()


def from_frame(done: Done, first: int) -> Done:
    """A frame of a run that began at frame `first`, numbered from there."""
    if first == 0:
        return done
    result, memory = done.result, done.memory
    memory = replace(memory, own_car=memory.own_car.numbered_from(first))
    if memory.tracked is not None:
        memory = replace(memory, tracked=memory.tracked - first)
    tracks = (
        None if result.tracks is None else replace(result.tracks, previous=result.tracks.previous - first)
    )
    return replace(done, result=replace(result, frame=result.frame - first, tracks=tracks), memory=memory)


UNKNOWN_CAMERA = StereoCamera(1226, 370, 707.09, 601.89, 183.11, 0.537)
"""Gives the page its shape where neither pictures nor the run's own frames tell the camera."""


def without_pictures(folder: Path, camera: StereoCamera, times: np.ndarray, why: str) -> FrameSource:
    """A drive of which only the numbers are left."""
    failure = Failure(FailureReason.MISSING_PAIR, "the pictures of this run are not at hand")

    def load(index: int) -> StereoFrame:
        return StereoFrame(index, float(times[index]), None, None, failure)

    return Recording(folder.name, camera, times, load, GroundTruth(), (f"pictures not found: {why}",))
