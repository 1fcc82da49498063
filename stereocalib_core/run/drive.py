"""`stereocalib run`: a whole drive through the front end, then the back end, then the files."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from stereocalib_core import __version__
from stereocalib_core import config as settings
from stereocalib_core.config import PipelineConfig
from stereocalib_core.errors import ConfigError, OutputError, StereoCalibError
from stereocalib_core.files import io
from stereocalib_core.files.frames_bin import Checkpoint, Done, read_checkpoint
from stereocalib_core.files.output_folder import OutputFolder
from stereocalib_core.files.report import build_report
from stereocalib_core.frames import FrameSource, GroundTruth, StereoFrame
from stereocalib_core.results import DriveAnalysis, FrameResult, Rig
from stereocalib_core.run.tolerance import Tolerance, judged
from stereocalib_core.sources import open_source, prefetch

CHECKPOINT = "checkpoint.bin"
FRAMES = "frames.bin"
"""What a finished run keeps of every frame, tracks included, so that a page can go on from there."""
FILES = (*io.RESULT_FILES, "recording.rrd", CHECKPOINT, FRAMES, ".*.tmp")
Progress = Callable[[int, int, str], None]
"""Called with frames done, frames in all, and what is being done."""


class Interrupted(KeyboardInterrupt):
    """The user stopped the run; what was done by then is in the output folder."""

    def __init__(self, done: int, total: int) -> None:
        super().__init__(f"after {done} of {total} frames; --resume goes on from there")


class Observer(Protocol):
    """Whoever wants to see a run while it happens. Changes nothing in it."""

    def frame(self, frame: StereoFrame, result: FrameResult) -> None:
        """A frame is done."""

    def drive(
        self, results: Sequence[FrameResult], analysis: DriveAnalysis, truth: NDArray[np.float64] | None
    ) -> None:
        """The whole drive is analysed."""

    def close(self, keep: bool) -> None:
        """Nothing more will come; `keep` is False when the run failed."""


@dataclass(frozen=True)
class Job:
    """One drive to be run, checked and ready."""

    spec: str
    out: Path
    source: FrameSource
    config: PipelineConfig
    start: int
    stop: int
    rig: Rig | None
    tolerances: dict[str, Tolerance]
    record: bool = False
    show: bool = False

    def header(self) -> dict[str, Any]:
        """What must be equal for a stopped run to go on."""
        return {
            "version": __version__,
            "source": self.source.content_key,
            "camera": dataclasses.asdict(self.source.camera),
            "settings": settings.to_dict(self.config),
            "rig": None if self.rig is None else dataclasses.asdict(self.rig),
            "tolerances": {axis: dataclasses.asdict(limit) for axis, limit in self.tolerances.items()},
            "first frame": self.start,
        }


def run_drive(
    spec: str,
    out: Path,
    frames: tuple[int | None, int | None] = (None, None),
    config: PipelineConfig | None = None,
    rig: Rig | None = None,
    tolerances: dict[str, Tolerance] | None = None,
    *,
    rrd: bool = False,
    rerun: bool = False,
    overwrite: bool = False,
    resume: bool = False,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Process SOURCE `spec` into `out` and return the report.

    frames: zero-based, half open; None = from the first, to the last.
    rrd: write recording.rrd too; rerun: show the run in the Rerun viewer.
    resume: go on after the last frame that a stopped or killed run finished in `out`.
    Raises StereoCalibError with nothing left in `out`, Interrupted with valid files there.
    """
    folder = OutputFolder(out, FILES, overwrite, resume)
    source = open_source(spec)
    start, stop = frame_range(frames, len(source))
    job = Job(spec, out, source, config or PipelineConfig(), start, stop, rig, tolerances or {}, rrd, rerun)
    resume = resume and not overwrite
    if resume and (out / "report.json").is_file() and not (out / CHECKPOINT).is_file():
        report = _finished(job)
        if report is not None:
            return report
    done, keep = read_checkpoint(out / CHECKPOINT, job.header()) if _resumable(out, resume) else ([], None)
    if len(done) > stop - start:
        remedy = f"it has {len(done)} frames; give at least as many, or start afresh with --overwrite"
        raise OutputError("stopped run of more frames", out, remedy)
    folder.create()
    try:
        return _run(job, done, keep, progress)
    except StereoCalibError:
        folder.undo()
        raise
    except KeyboardInterrupt:
        if done:
            raise Interrupted(len(done), stop - start) from None
        folder.undo()
        raise


def _resumable(out: Path, resume: bool) -> bool:
    checkpoint = out / CHECKPOINT
    return resume and checkpoint.is_file() and checkpoint.stat().st_size > 0


def _finished(job: Job) -> dict[str, Any] | None:
    """The report of a run that needs no resuming; raises OutputError when it was another one.

    None where only the recording is lacking: the frames are a checkpoint again, and the run goes on from its end.
    """
    done, _ = read_checkpoint(job.out / FRAMES, job.header())
    if len(done) != job.stop - job.start:
        remedy = f"it has {len(done)} frames; name a new folder, or add --overwrite"
        raise OutputError("finished run of other frames", job.out, remedy)
    if job.record and not (job.out / "recording.rrd").is_file():
        (job.out / FRAMES).replace(job.out / CHECKPOINT)
        return None
    return io.read_json(job.out / "report.json")


def frame_range(frames: tuple[int | None, int | None], count: int) -> tuple[int, int]:
    """First frame and the one after the last; raises ConfigError when no frame is left."""
    start = 0 if frames[0] is None else frames[0]
    stop = count if frames[1] is None else frames[1]
    if start >= count > 0:
        raise ConfigError("range of frames outside the drive", f"{start}:{stop}", f"it has {count} frames")
    if not 0 <= start < stop:
        raise ConfigError("empty range of frames", f"{start}:{stop}", "write A:B with A < B")
    return start, min(stop, count)


def _run(job: Job, done: list[Done], keep: int | None, progress: Progress | None) -> dict[str, Any]:
    """All of it. `done`: frames of an earlier run, to which this one's are added as they are finished."""
    earlier = list(done)
    for stale in job.out.glob(".*.tmp"):
        stale.unlink(missing_ok=True)
    checkpoint = Checkpoint(job.out / CHECKPOINT, job.header(), keep)
    observers: list[Observer] = []
    whole = False
    began = time.perf_counter()
    try:
        for observer in _observers(job):
            observers.append(observer)
        for finished in earlier if observers else ():
            _show(observers, job.source[finished.result.frame], finished.result)
        for frame, finished in _front_end(job, earlier):
            done.append(checkpoint.append(finished))
            _show(observers, frame, done[-1].result)
            if progress:
                progress(len(done), job.stop - job.start, "frames")
        elapsed_s = time.perf_counter() - began + 1e-3 * sum(d.total_ms for d in earlier)
        if progress:
            progress(len(done), job.stop - job.start, "analysing the drive")
        results = [d.result for d in done]
        truth = cut_truth(job.source.ground_truth, job.start, job.start + len(done))
        analysis = _analyse(results, job, truth)
        for observer in observers:
            observer.drive(results, analysis, None if truth is None else truth.poses)
        whole = True
    except KeyboardInterrupt:
        if done:
            whole = True
            _write(job, done, None, 1e-3 * sum(d.total_ms for d in done))
        raise
    finally:
        checkpoint.close()
        for observer in observers:
            observer.close(whole)
    report = _write(job, done, analysis, elapsed_s)
    (job.out / CHECKPOINT).replace(job.out / FRAMES)
    return report


def _observers(job: Job) -> Iterator[Observer]:
    if not (job.record or job.show):
        return
    from stereocalib_core.files.rrd import Recorder

    for path in [job.out / "recording.rrd"] * job.record + [None] * job.show:
        yield Recorder(job.source.camera, job.config.disparity, job.source.name, path)


def _show(observers: list[Observer], frame: StereoFrame, result: FrameResult) -> None:
    for observer in observers:
        observer.frame(frame, result)


def _front_end(job: Job, earlier: list[Done]) -> Iterator[tuple[StereoFrame, Done]]:
    """The frames that are still to be done, one by one."""
    from stereocalib_core.front.pipeline import FrontEnd

    front_end = FrontEnd(job.source.camera, job.config, job.source.T_camera_lidar)
    if earlier:
        recall(front_end, job.source, earlier)
    before = time.perf_counter()
    for frame in prefetch(job.source, job.start + len(earlier), job.stop):
        result = front_end.step(frame)
        now = time.perf_counter()
        yield frame, Done(result, front_end.memory, 1e3 * (now - before))
        before = time.perf_counter()


def recall(front_end: Any, source: FrameSource, earlier: list[Done]) -> None:
    """Bring a new front end to where it was after `earlier`, by looking once more at the last frames of it."""
    last = earlier[-1].result.frame
    memory = earlier[-1].memory
    first = memory.tracked
    again: list[StereoFrame] = []
    for index in range(last, earlier[0].result.frame - 1, -1):
        frame = source[index]
        again.insert(0, frame)
        if index == first or (first is None and frame.failure is None):
            break
    before = [d.result.road for d in earlier if d.result.frame < again[0].index and d.result.road is not None]
    front_end.recall(again, before[-1].extrinsics if before else None, memory)


def _analyse(results: list[FrameResult], job: Job, truth: GroundTruth | None) -> DriveAnalysis:
    from stereocalib_core.back.analyse import analyse

    return analyse(results, job.source.camera, job.config, truth, job.rig)


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


def _write(job: Job, done: list[Done], analysis: DriveAnalysis | None, elapsed_s: float) -> dict[str, Any]:
    """All files of a run; report.json last, so that its presence means that the others are there."""
    results, out = [d.result for d in done], job.out
    report = build_report(
        job.spec, job.config.method, results, analysis, elapsed_s, [d.total_ms for d in done]
    )
    report["notices"] = list(job.source.notices)
    report["mount"] = judged(report["mount"], job.tolerances)
    io.write_json(out / "config.json", settings.to_dict(job.config))
    io.write_extrinsics_csv(out / "extrinsics.csv", results, None if analysis is None else analysis.filtered)
    if analysis is not None:
        io.write_rig(out / "rig.yaml", analysis.rig or Rig())
        if analysis.poses is not None:
            io.write_kitti(out / "trajectory.txt", analysis.poses)
            io.write_tum(out / "trajectory.tum", io.timestamps(results), analysis.poses)
    io.write_json(out / "report.json", report)
    return report
