"""`stereocalib run`: a whole drive through the front end, then the back end, then the files."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from stereocalib_core import __version__
from stereocalib_core import config as settings
from stereocalib_core.config import PipelineConfig
from stereocalib_core.errors import ConfigError, OutputError, StereoCalibError
from stereocalib_core.files.frames_bin import Checkpoint, Done, read_checkpoint
from stereocalib_core.files.output_folder import OutputFolder
from stereocalib_core.files.run_folder import RESULT_FILES, load_run, write_run
from stereocalib_core.frames import FrameSource, GroundTruth, StereoFrame
from stereocalib_core.results import Drive, FrameResult, Rig, Timing, Tolerance
from stereocalib_core.sources import open_source, prefetch

CHECKPOINT = "checkpoint.bin"
FRAMES = "frames.bin"
"""What a finished run keeps of every frame, tracks included, so that a page can go on from there."""
FILES = (*RESULT_FILES, "recording.rrd", CHECKPOINT, FRAMES, ".*.tmp")
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

    def drive(self, drive: Drive, truth: NDArray[np.float64] | None) -> None:
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
) -> Drive:
    """Process SOURCE `spec` into `out` and return what it says.

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
        finished = _finished(job)
        if finished is not None:
            return finished
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


def _finished(job: Job) -> Drive | None:
    """The result of a run that needs no resuming; raises OutputError when it was another one.

    None where only the recording is lacking: the frames are a checkpoint again, and the run goes on from its end.
    """
    done, _ = read_checkpoint(job.out / FRAMES, job.header())
    if len(done) != job.stop - job.start:
        remedy = f"it has {len(done)} frames; name a new folder, or add --overwrite"
        raise OutputError("finished run of other frames", job.out, remedy)
    if job.record and not (job.out / "recording.rrd").is_file():
        (job.out / FRAMES).replace(job.out / CHECKPOINT)
        return None
    return load_run(job.out)


def frame_range(frames: tuple[int | None, int | None], count: int) -> tuple[int, int]:
    """First frame and the one after the last; raises ConfigError when no frame is left."""
    start = 0 if frames[0] is None else frames[0]
    stop = count if frames[1] is None else frames[1]
    if start >= count > 0:
        raise ConfigError("range of frames outside the drive", f"{start}:{stop}", f"it has {count} frames")
    if not 0 <= start < stop:
        raise ConfigError("empty range of frames", f"{start}:{stop}", "write A:B with A < B")
    return start, min(stop, count)


def _run(job: Job, done: list[Done], keep: int | None, progress: Progress | None) -> Drive:
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
        drive = _told(_analyse(results, job, truth), job, done, elapsed_s)
        for observer in observers:
            observer.drive(drive, None if truth is None else truth.poses)
        whole = True
    except KeyboardInterrupt:
        if done:
            whole = True
            drive = Drive.of_frames([d.result for d in done], job.config)
            write_run(_told(drive, job, done, 1e-3 * sum(d.total_ms for d in done)), job.out)
        raise
    finally:
        checkpoint.close()
        for observer in observers:
            observer.close(whole)
    write_run(drive, job.out)
    (job.out / CHECKPOINT).replace(job.out / FRAMES)
    return drive


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


def _analyse(results: list[FrameResult], job: Job, truth: GroundTruth | None) -> Drive:
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


def _told(drive: Drive, job: Job, done: list[Done], elapsed_s: float) -> Drive:
    """The drive with what only its run knows."""
    return dataclasses.replace(
        drive,
        source=job.spec,
        limits=job.tolerances,
        timing=Timing.of([d.result for d in done], elapsed_s, [d.total_ms for d in done]),
        notices=tuple(job.source.notices),
    )
