"""Opens what an earlier `run` wrote: its results as they are, its pictures where the source is still there."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from stereocalib_app.drive.drive_parts import NO_LIMITS, Limits, judged_analysis, part_of
from stereocalib_app.drive.session import Session
from stereocalib_core.config import PipelineConfig
from stereocalib_core.config import load as load_config
from stereocalib_core.errors import ConfigError, Failure, FailureReason, SourceError, StereoCalibError
from stereocalib_core.files.frames_bin import Done, read_frames
from stereocalib_core.files.io import SavedRun, read_run
from stereocalib_core.frames import FrameSource, GroundTruth, Recording, StereoFrame
from stereocalib_core.front.pipeline import FrontEndMemory
from stereocalib_core.geometry import Extrinsics, StereoCamera
from stereocalib_core.results import DriveAnalysis, FilteredExtrinsics, FrameResult, RoadEstimate
from stereocalib_core.run.drive import FRAMES
from stereocalib_core.sources import open_source


def open_run(folder: Path, limits: Limits = NO_LIMITS) -> Session:
    """An earlier run: its results as they were written, its pictures where the source is still there."""
    run = read_run(folder)
    check(run)
    first = int(np.asarray(run.extrinsics["frame"])[0])
    header, finished, lost = whole_frames(run)
    config, other_settings = saved_config(folder)
    finished = [from_frame(done, first) for done in finished]
    spec = str(run.report.get("source", ""))
    span = None
    try:
        whole = open_source(spec)
        stop = min(first + len(finished), len(whole))
        source, finished = part_of(whole, first, stop), finished[: stop - first]
        span = None if (first, stop) == (0, len(whole)) else (first, stop)
    except StereoCalibError as error:
        times = np.array([done.result.timestamp_s for done in finished])
        camera = StereoCamera(**header["camera"]) if header else UNKNOWN_CAMERA
        source = without_pictures(folder, camera, times, str(error))
        lost += ("the pictures are not where they were: only the numbers are shown",)
    analysis = judged_analysis(DriveAnalysis(run.report, saved_filter(run), run.poses, run.rig), limits)
    return Session(
        source,
        config,
        spec=spec,
        finished=finished,
        analyse=lambda _results: analysis,
        frames=span,
        run_folder=folder,
        tracks=bool(header),
        notices=lost + other_settings,
    )


AXES = ("height_m", "pitch_deg", "roll_deg", "yaw_deg")
SHIFT = {"kind": str, "axis": str, "unit": str, "size": int | float, "frame": int}


def check(run: SavedRun) -> None:
    """Raise SourceError where a run was written by a version that this page cannot read, or by hand."""
    if len(run.extrinsics["frame"]) == 0:
        raise SourceError("run without frames", run.folder, "run the drive again")
    mount, shifts = run.report.get("mount") or {}, run.report.get("shifts") or []
    sound = isinstance(mount, dict) and isinstance(shifts, list)
    sound = sound and all(isinstance(mount.get(axis) or {}, dict) for axis in AXES)
    sound = sound and all(isinstance(run.report.get(key) or {}, dict) for key in (*AXES[:3], "rectification"))
    sound = sound and isinstance(run.report.get("failures") or {}, dict)
    for shift in shifts if sound else ():
        sound = sound and isinstance(shift, dict)
        sound = sound and all(isinstance(shift.get(key), kind) for key, kind in SHIFT.items())
    if not sound:
        raise SourceError("report.json of another version", run.folder, "run the drive again")


def whole_frames(run: SavedRun) -> tuple[dict[str, Any], list[Done], tuple[str, ...]]:
    """The header and the frames of frames.bin, where it is there and whole; else no header, the frames of
    extrinsics.csv, and what is lost by that."""
    path = run.folder / FRAMES
    if not path.is_file():
        return {}, csv_results(run), ()
    try:
        header, finished = read_frames(path)
    except StereoCalibError:
        header, finished = {}, []
    if len(finished) == len(run.extrinsics["frame"]):
        return header, finished, ()
    return (
        {},
        csv_results(run),
        (f"{FRAMES} is damaged or of another version: nothing to correct, no limits",),
    )


def saved_config(folder: Path) -> tuple[PipelineConfig, tuple[str, ...]]:
    """The settings of a run, or today's where they are gone or of another version, and a word about that."""
    settings = folder / "config.json"
    try:
        return load_config(settings) if settings.is_file() else PipelineConfig(), ()
    except ConfigError:
        return PipelineConfig(), (
            "config.json is of another version: the stages are shown with today's settings",
        )


def from_frame(done: Done, first: int) -> Done:
    """A frame of a run that began at frame `first`, numbered from there."""
    if first == 0:
        return done
    result, memory = done.result, done.memory
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


def csv_results(run: SavedRun) -> list[Done]:
    """extrinsics.csv back as results, without tracks and checks."""
    columns = run.extrinsics
    results = []
    for i, status in enumerate(columns["status"]):
        numbers = [float(columns[name][i]) for name in ("height_m", "pitch_deg", "roll_deg")]
        names = ("height_sigma_m", "pitch_sigma_deg", "roll_sigma_deg")
        sigma = np.array([float(columns[name][i]) for name in names])
        sigma[1:] = np.deg2rad(sigma[1:])
        free = float(columns["free_fraction"][i])
        inliers = columns["inliers"][i]
        count = int(inliers) if np.isfinite(inliers) else 0
        road = failure = None
        if status == "ok":
            road = RoadEstimate(
                Extrinsics.from_degrees(*numbers),
                np.diag(sigma**2),
                count,
                free,
                (float("nan"), float("nan")),
            )
        else:
            failure = Failure(FailureReason(columns["reason"][i]), "as written by the run")
        result = FrameResult(
            int(columns["frame"][i]), float(columns["timestamp_s"][i]), road, failure, free, count
        )
        results.append(Done(result, FrontEndMemory(None, None), 0.0))
    return results


def saved_filter(run: SavedRun) -> FilteredExtrinsics:
    """The filtered columns of extrinsics.csv."""
    c = run.extrinsics
    angles = [np.deg2rad(c[f"{axis}_filtered_deg"]) for axis in ("pitch", "roll")]
    values = np.stack([c["height_filtered_m"], *angles], axis=1)
    spread = [np.deg2rad(c[f"{axis}_filtered_sigma_deg"]) for axis in ("pitch", "roll")]
    sigma = np.stack([c["height_filtered_sigma_m"], *spread], axis=1)
    return FilteredExtrinsics(values, np.einsum("ni,ij->nij", sigma**2, np.eye(3)), tuple(c["filter_state"]))
