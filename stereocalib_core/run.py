"""`stereocalib run`: a whole drive through the front end, then the back end, then the files."""

from __future__ import annotations

import dataclasses
import importlib.util
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from stereocalib_core import config as settings
from stereocalib_core import io
from stereocalib_core.config import PipelineConfig
from stereocalib_core.errors import ConfigError, StereoCalibError
from stereocalib_core.frames import FrameSource, GroundTruth
from stereocalib_core.output_folder import OutputFolder
from stereocalib_core.report import build_report
from stereocalib_core.results import DriveAnalysis, FrameResult, Rig
from stereocalib_core.sources import open_source, prefetch
from stereocalib_core.tolerance import Tolerance, within_tolerance

FILES = (
    "config.json",
    "rig.yaml",
    "extrinsics.csv",
    "trajectory.txt",
    "trajectory.tum",
    "report.json",
    "recording.rrd",
)
Progress = Callable[[int, int, str], None]
"""Called with frames done, frames in all, and what is being done."""


class Interrupted(KeyboardInterrupt):
    """The user stopped the run; what was done by then is in the output folder."""

    def __init__(self, done: int, total: int) -> None:
        super().__init__(f"stopped after {done} of {total} frames")


def run_drive(
    spec: str,
    out: Path,
    frames: tuple[int | None, int | None] = (None, None),
    config: PipelineConfig | None = None,
    rig: Rig | None = None,
    tolerances: dict[str, Tolerance] | None = None,
    *,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Process SOURCE `spec` into `out` and return the report.

    frames: zero-based, half open; None = from the first, to the last.
    Raises StereoCalibError with nothing left in `out`, Interrupted with valid files there.
    """
    config = config or PipelineConfig()
    folder = OutputFolder(out, FILES, overwrite)
    source = open_source(spec)
    start, stop = frame_range(frames, len(source))
    folder.create()
    results: list[FrameResult] = []
    total_ms: list[float] = []
    began = time.perf_counter()
    try:
        _front_end(source, config, start, stop, results, total_ms, progress)
        elapsed_s = time.perf_counter() - began
        if progress:
            progress(len(results), stop - start, "analysing the drive")
        analysis = _analyse(results, source, config, start, stop, rig)
        return _write(
            out, spec, source.notices, config, results, analysis, elapsed_s, total_ms, tolerances or {}
        )
    except KeyboardInterrupt:
        if not results:
            folder.undo()
            raise
        _write(out, spec, source.notices, config, results, None, time.perf_counter() - began, total_ms, {})
        raise Interrupted(len(results), stop - start) from None
    except StereoCalibError:
        folder.undo()
        raise


def frame_range(frames: tuple[int | None, int | None], count: int) -> tuple[int, int]:
    """First frame and the one after the last; raises ConfigError when no frame is left."""
    start = 0 if frames[0] is None else frames[0]
    stop = count if frames[1] is None else frames[1]
    if not 0 <= start < stop:
        raise ConfigError("empty range of frames", f"{start}:{stop}", "write A:B with A < B")
    if start >= count:
        raise ConfigError("range of frames outside the drive", f"{start}:{stop}", f"it has {count} frames")
    return start, min(stop, count)


def _front_end(
    source: FrameSource,
    config: PipelineConfig,
    start: int,
    stop: int,
    results: list[FrameResult],
    total_ms: list[float],
    progress: Progress | None,
) -> None:
    from stereocalib_core.pipeline import FrontEnd

    front_end = FrontEnd(source.camera, config)
    before = time.perf_counter()
    for frame in prefetch(source, start, stop):
        results.append(front_end.step(frame))
        now = time.perf_counter()
        total_ms.append(1e3 * (now - before))
        before = now
        if progress:
            progress(len(results), stop - start, "frames")


def _analyse(
    results: list[FrameResult],
    source: FrameSource,
    config: PipelineConfig,
    start: int,
    stop: int,
    rig: Rig | None,
) -> DriveAnalysis | None:
    if importlib.util.find_spec("stereocalib_core.drive") is None:
        return None
    drive = importlib.import_module("stereocalib_core.drive")
    truth = cut_truth(source.ground_truth, start, stop)
    analysis: DriveAnalysis = drive.analyse(results, source.camera, config, truth, rig)
    return analysis


def cut_truth(truth: GroundTruth | None, start: int, stop: int) -> GroundTruth | None:
    """The truth of frames start...stop - 1, poses seen from the first of them."""
    if truth is None:
        return None
    from stereocalib_core.sources.lists import from_first

    return dataclasses.replace(
        truth,
        poses=None if truth.poses is None else from_first(truth.poses[start:stop]),
        extrinsics=None if truth.extrinsics is None else truth.extrinsics[start:stop],
    )


def _write(
    out: Path,
    spec: str,
    notices: tuple[str, ...],
    config: PipelineConfig,
    results: list[FrameResult],
    analysis: DriveAnalysis | None,
    elapsed_s: float,
    total_ms: list[float],
    tolerances: dict[str, Tolerance],
) -> dict[str, Any]:
    """All files of a run; report.json last, so that its presence means that the others are there."""
    report = build_report(spec, config.method, results, analysis, elapsed_s, total_ms)
    report["notices"] = list(notices)
    report["mount"]["within_tolerance"] = within_tolerance(report["mount"], tolerances)
    io.write_json(out / "config.json", settings.to_dict(config))
    io.write_extrinsics_csv(out / "extrinsics.csv", results, None if analysis is None else analysis.filtered)
    if analysis is not None:
        io.write_rig(out / "rig.yaml", analysis.rig or Rig())
        if analysis.poses is not None:
            times_s = io.timestamps(results)
            io.write_kitti(out / "trajectory.txt", analysis.poses)
            io.write_tum(out / "trajectory.tum", times_s, analysis.poses)
    io.write_json(out / "report.json", report)
    return report
