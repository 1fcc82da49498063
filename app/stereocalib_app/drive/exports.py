"""What leaves the page: files of a drive as bytes, and the command that reproduces what is on screen."""

from __future__ import annotations

import json
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
from stereocalib_core.config import PipelineConfig, to_dict
from stereocalib_core.errors import OutputError
from stereocalib_core.files import io
from stereocalib_core.run.compare import compare_runs


def _written(name: str, write: Callable[[Path], Any]) -> bytes:
    """The bytes that one of the core's writers makes."""
    with tempfile.TemporaryDirectory(prefix="stereocalib-") as folder:
        path = Path(folder) / name
        write(path)
        return path.read_bytes()


def shown_poses(snapshot: Snapshot, corrections: Corrections) -> NDArray[np.float64]:
    """(N, 4, 4) of the path on show: the live one where corrections are touched."""
    if corrections.touched and snapshot.paths is not None:
        return snapshot.paths.live(corrections).poses
    if snapshot.analysis is not None and snapshot.analysis.poses is not None:
        return snapshot.analysis.poses
    if snapshot.paths is not None:
        return snapshot.paths.live(corrections).poses
    raise OutputError("no trajectory yet", "export", "wait until some frames are computed")


def tum(session: Session, snapshot: Snapshot, settings: Settings) -> bytes:
    """The path in TUM format."""
    poses = shown_poses(snapshot, settings.corrections)
    times = np.asarray(session.source.timestamps_s[: len(poses)])
    return _written("trajectory.tum", lambda path: io.write_tum(path, times, poses))


def kitti(session: Session, snapshot: Snapshot, settings: Settings) -> bytes:
    """The path in KITTI format."""
    poses = shown_poses(snapshot, settings.corrections)
    return _written("trajectory.txt", lambda path: io.write_kitti(path, poses))


def csv(session: Session, snapshot: Snapshot, settings: Settings) -> bytes:
    """extrinsics.csv, with the frame numbers of the whole recording."""
    filtered = None if snapshot.analysis is None else snapshot.analysis.filtered
    results = snapshot.results[: snapshot.analysed] if filtered is not None else snapshot.results
    first = 0 if session.frames is None else session.frames[0]
    rows = [replace(r, frame=r.frame + first) for r in results] if first else results
    return _written("extrinsics.csv", lambda path: io.write_extrinsics_csv(path, rows, filtered))


def report(session: Session, snapshot: Snapshot, settings: Settings) -> bytes:
    """report.json of the frames analysed so far, and the settings of the page."""
    if not snapshot.report:
        raise OutputError("no report yet", "export", "wait until some frames are computed")
    content = {**snapshot.report, "page": {"corrections": vars(settings.corrections)}}
    return (json.dumps(io.plain(content), indent=2) + "\n").encode()


def write_run_folder(session: Session, snapshot: Snapshot, settings: Settings, folder: Path) -> None:
    """The files of a run, as far as the page has them."""
    (folder / "report.json").write_bytes(report(session, snapshot, settings))
    (folder / "extrinsics.csv").write_bytes(csv(session, snapshot, settings))
    (folder / "trajectory.txt").write_bytes(kitti(session, snapshot, settings))


def difference(session: Session, snapshot: Snapshot, settings: Settings, other: Path) -> dict[str, Any]:
    """What differs between the drive on show (A) and an earlier run (B), as `compare_runs` has it."""
    with tempfile.TemporaryDirectory(prefix="stereocalib-") as folder:
        write_run_folder(session, snapshot, settings, Path(folder))
        return compare_runs(Path(folder), other)


def recording(session: Session, snapshot: Snapshot, settings: Settings) -> bytes:
    """A rerun recording of what is computed so far."""
    from stereocalib_core.files.rrd import Recorder

    def write(path: Path) -> None:
        recorder = Recorder(session.source.camera, session.config.disparity, session.source.name, path)
        done = False
        try:
            for result in snapshot.results:
                recorder.frame(session.source[result.frame], result)
            if snapshot.analysis is not None:
                truth = session.source.ground_truth
                poses = None if truth is None else truth.poses
                recorder.drive(snapshot.results[: snapshot.analysed], snapshot.analysis, poses)
            done = True
        finally:
            recorder.close(keep=done)

    return _written("recording.rrd", write)


def config_json(session: Session) -> str:
    """The configuration as `--config` reads it."""
    return json.dumps(to_dict(session.config), indent=2)


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
