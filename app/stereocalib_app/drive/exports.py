"""What leaves the page: files of a drive as bytes, and the command that reproduces what is on screen."""

from __future__ import annotations

import json
import re
import shlex
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereocalib_app.drive.page_words import to_words
from stereocalib_app.drive.session import Session, Snapshot
from stereocalib_app.drive.settings import Corrections, Settings
from stereocalib_core.back.evaluation import evaluate
from stereocalib_core.config import PipelineConfig
from stereocalib_core.errors import OutputError, StereoCalibError
from stereocalib_core.files import io
from stereocalib_core.files.extrinsics import write_extrinsics_csv
from stereocalib_core.files.report import report_of
from stereocalib_core.files.run_folder import without_gaps
from stereocalib_core.frames import GroundTruth
from stereocalib_core.results import BEST, Drive, DrivePath, OdometryErrors
from stereocalib_core.results.difference import Difference
from stereocalib_core.run.compare import compare
from stereocalib_core.system import whole_file


def _written(name: str, write: Callable[[Path], Any]) -> bytes:
    """The bytes that one of the core's writers makes."""
    with tempfile.TemporaryDirectory(prefix="stereocalib-") as folder:
        path = Path(folder) / name
        write(path)
        return path.read_bytes()


def shown_drive(session: Session, snapshot: Snapshot, corrections: Corrections) -> Drive:
    """What is known of the drive, with the path on show (the live one where corrections are touched) and the
    frame numbers of the whole recording."""
    drive = snapshot.drive
    if drive is None:
        raise OutputError("no results yet", "export", "wait until some frames are computed")
    poses = drive.poses
    if snapshot.paths is not None and (corrections.touched or poses is None):
        poses = snapshot.paths.live(corrections).poses
    paths = dict(drive.paths)
    if poses is not None:
        blank = DrivePath(poses, np.full((len(poses), 6, 6), np.nan), evaluate(poses, None))
        paths[BEST] = replace(paths.get(BEST, blank), poses=poses)
        if corrections.touched:
            paths[BEST] = replace(paths[BEST], errors=against(session.source.ground_truth, poses))
    first = 0 if session.frames is None or session.run_folder is not None else session.frames[0]
    return replace(drive, frames=replace(drive.frames, frame=drive.frames.frame + first), paths=paths)


def against(truth: GroundTruth | None, poses: NDArray[np.float64]) -> OdometryErrors:
    """A path against the truth, as far as it is good for that."""
    if truth is None or truth.poses is None:
        return evaluate(poses, None)
    try:
        return evaluate(poses, truth.poses[: len(poses)], truth.heading_reliable)
    except StereoCalibError:
        return evaluate(poses, None)


def shown_poses(session: Session, snapshot: Snapshot, corrections: Corrections) -> NDArray[np.float64]:
    """(N, 4, 4) of the path on show."""
    poses = shown_drive(session, snapshot, corrections).poses
    if poses is None:
        raise OutputError("no trajectory yet", "export", "wait until some frames are computed")
    return poses


def tum(session: Session, snapshot: Snapshot, settings: Settings) -> bytes:
    """The path in TUM format."""
    poses = shown_poses(session, snapshot, settings.corrections)
    if snapshot.drive is not None:
        poses = without_gaps(snapshot.drive, poses)
    times = session.source.epoch_s + np.asarray(session.source.timestamps_s[: len(poses)])
    return _written("trajectory.tum", lambda path: io.write_tum(path, times, poses))


def kitti(session: Session, snapshot: Snapshot, settings: Settings) -> bytes:
    """The path in KITTI format."""
    poses = shown_poses(session, snapshot, settings.corrections)
    return _written("trajectory.txt", lambda path: io.write_kitti(path, poses))


def csv(session: Session, snapshot: Snapshot, settings: Settings) -> bytes:
    """extrinsics.csv of the frames analysed so far."""
    table = shown_drive(session, snapshot, settings.corrections).frames
    return _written("extrinsics.csv", lambda path: write_extrinsics_csv(path, table))


def report(session: Session, snapshot: Snapshot, settings: Settings) -> bytes:
    """report.json of the frames analysed so far, and the settings of the page."""
    drive = shown_drive(session, snapshot, settings.corrections)
    content = {**report_of(drive), "page": {"corrections": vars(settings.corrections)}}
    return (json.dumps(whole_file.plain(content), indent=2) + "\n").encode()


def difference(session: Session, snapshot: Snapshot, settings: Settings, other: Drive) -> Difference:
    """What differs between the drive on show (A) and an earlier run (B)."""
    return compare(shown_drive(session, snapshot, settings.corrections), other)


def recording(
    session: Session,
    snapshot: Snapshot,
    settings: Settings,
    told: Callable[[int, int], None] = lambda done, total: None,
) -> bytes:
    """A rerun recording of what is computed so far. told: hears how many frames of how many are written."""
    from stereocalib_core.files.rrd import Recorder

    def write(path: Path) -> None:
        recorder = Recorder(session.source.camera, session.source.name, path)
        done = False
        try:
            for i, result in enumerate(snapshot.results):
                told(i, len(snapshot.results))
                seen = session.views.stages(result.frame)
                disparity = None if seen.stages is None else seen.stages.disparity
                recorder.frame(seen.frame, result, disparity)
            if snapshot.drive is not None:
                truth = session.source.ground_truth
                recorder.drive(snapshot.drive, None if truth is None else truth.poses)
            done = True
        finally:
            recorder.close(keep=done)

    return _written("recording.rrd", write)


def file_name(session: Session, settings: Settings, name: str) -> str:
    """The name of a file that leaves the page: drive, what differs from the plain result, and what it is."""
    parts = [session.source.name, *(w for w in to_words(Settings(corrections=settings.corrections)))]
    if session.frames is not None:
        parts.append(f"frames {session.frames[0]}-{session.frames[1] - 1}")
    whole = re.sub(r"[^\w.+=-]+", "_", "_".join(parts)).strip("_.")
    return f"{whole[:LONGEST_NAME]}_{name}"


LONGEST_NAME = 120


def page_command(session: Session, settings: Settings, frame: int, tolerance: Path | None = None) -> str:
    """The shell command that opens the page as it is on show."""
    parts = ["stereocalib", "view", session.spec if session.run_folder is None else str(session.run_folder)]
    parts += ["--at", str(frame)]
    for word in to_words(settings):
        parts += ["--set", word]
    if tolerance is not None:
        parts += ["--tolerance", str(tolerance)]
    return shlex.join(parts)


def command(session: Session, tolerance: Path | None = None) -> str:
    """The shell command that computes the drive on show again."""
    parts = ["stereocalib", "run", session.spec, "--out", "out", "--method", session.config.method]
    if session.run_folder is not None and session.config != replace(
        PipelineConfig(), method=session.config.method
    ):
        parts += ["--config", str(session.run_folder / "config.json")]
    if session.rig is not None:
        parts += ["--rig", str(session.rig)]
    if tolerance is not None:
        parts += ["--tolerance", str(tolerance)]
    if session.frames is not None:
        first, last = session.frames
        parts += ["--frames", f"{first}:{last}"]
    return shlex.join(parts)
