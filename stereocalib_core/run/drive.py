"""`stereocalib run`: a whole drive through the front end, then the back end, then the files."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from stereocalib_core import __version__
from stereocalib_core.config import PipelineConfig
from stereocalib_core.config.running import MOST_MENDINGS
from stereocalib_core.errors import OutputError, StereoCalibError
from stereocalib_core.files.frame_record import Done
from stereocalib_core.files.frames_bin import Checkpoint, RunKey, read_checkpoint
from stereocalib_core.files.output_folder import OutputFolder
from stereocalib_core.files.run_folder import REPORT, RESULT_FILES, load_run, write_run
from stereocalib_core.frames import FrameSource, GroundTruth, StereoFrame
from stereocalib_core.results import DisparityMap, Drive, FrameResult, Mending, Rig, Tolerance
from stereocalib_core.run.calibrate import Progress, cut_truth, follow, frame_range, told
from stereocalib_core.run.self_calibrate import mended_by, next_mending, write_mended
from stereocalib_core.sources import open_source
from stereocalib_core.sources.calibrations import MENDED
from stereocalib_core.system.compiled import SCANS, await_compiled, compile_once

CHECKPOINT = "checkpoint.bin"
FRAMES = "frames.bin"
"""What a finished run keeps of every frame, tracks included, so that a page can go on from there."""
UNMENDED = "before_mending_{}.bin"
"""The same of the runs before the pair was mended, by their number."""
FILES = (*RESULT_FILES, MENDED, UNMENDED.format("*"), "recording.rrd", CHECKPOINT, FRAMES, ".*.tmp")


class Interrupted(KeyboardInterrupt):
    """The user stopped the run; what was done by then is in the output folder."""

    def __init__(self, done: int, total: int) -> None:
        super().__init__(f"after {done} of {total} frames; --resume goes on from there")


class Observer(Protocol):
    """Whoever wants to see a run while it happens. Changes nothing in it."""

    def frame(self, frame: StereoFrame, result: FrameResult, disparity: DisparityMap | None) -> None:
        """A frame is done. disparity: as it was matched for the result."""

    def drive(self, drive: Drive, truth: NDArray[np.float64] | None) -> None:
        """The whole drive is analysed."""

    def close(self, keep: bool) -> None:
        """Nothing more will come; `keep` is False when the run failed."""


@dataclass(frozen=True)
class Job:
    """One drive to be run, checked and ready.

    source: as it is recorded; `seen` is what is run, mended where `mending` says so.
    """

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
    mending: Mending | None = None

    @cached_property
    def seen(self) -> FrameSource:
        """The source with its pair mended."""
        return self.source if self.mending is None else mended_by(self.source, self.mending)

    @property
    def doing(self) -> str:
        """What its progress is called."""
        return "frames" if self.mending is None else "frames, the pair mended"

    @property
    def key(self) -> RunKey:
        """What must be equal for a stopped run to go on."""
        return RunKey(
            self.source.content_key,
            self.seen.camera,
            self.config,
            self.rig,
            self.tolerances,
            self.start,
            None if self.mending is None else self.seen.content_key,
            __version__,
        )


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
    self_calibrate: bool = False,
    progress: Progress | None = None,
) -> Drive:
    """Process SOURCE `spec` into `out` and return what it says.

    frames: zero-based, half open; None = from the first, to the last.
    rrd: write recording.rrd too; rerun: show the run in the Rerun viewer.
    resume: go on after the last frame that a stopped or killed run finished in `out`.
    self_calibrate: run it again with what it measured of its own pair; the results are those of that run.
    Raises StereoCalibError with nothing left in `out`, Interrupted with valid files there.
    """
    folder = OutputFolder(out, FILES, overwrite, resume)
    source = open_source(spec)
    if source.T_camera_lidar is not None:
        compile_once(SCANS, lambda line: None, progress)
    start, stop = frame_range(frames, len(source))
    job = Job(spec, out, source, config or PipelineConfig(), start, stop, rig, tolerances or {}, rrd, rerun)
    begun = False
    try:
        with folder.alone():
            for run in range(1 + MOST_MENDINGS):
                drive = _run_alone(job, folder, resume and not overwrite, run, progress)
                begun = True
                mending = next_mending(drive, job.mending) if self_calibrate and run < MOST_MENDINGS else None
                if mending is None:
                    break
                _set_aside(job, run)
                job = dataclasses.replace(job, mending=mending)
            return drive
    except StereoCalibError:
        folder.undo()
        raise
    except Interrupted:
        raise
    except KeyboardInterrupt:
        if begun:
            raise Interrupted(0, stop - start) from None
        folder.undo()
        raise


def _run_alone(job: Job, folder: OutputFolder, resume: bool, run: int, progress: Progress | None) -> Drive:
    """The drive once, while nobody else works in the folder.

    run: how often the pair was mended before; what such a run left is taken from its file.
    """
    out, count = job.out, job.stop - job.start
    before = out / UNMENDED.format(run)
    if resume and before.is_file():
        done, _ = read_checkpoint(before, job.key)
        return _drive(job, done, 1e-3 * sum(d.total_ms for d in done))[0]
    if resume and (out / REPORT).is_file() and not (out / CHECKPOINT).is_file():
        finished = _finished(job)
        if finished is not None:
            return finished
    keep = None
    if _resumable(out, resume):
        done, keep = read_checkpoint(out / CHECKPOINT, job.key)
        if len(done) > count:
            remedy = f"it has {len(done)} frames; give at least as many, or start afresh with --overwrite"
            raise OutputError("stopped run of more frames", out, remedy)
        del done  # of a long drive they are many, and are read again where they are needed
    if run == 0:
        folder.clear()
    return _run(job, keep, progress)


def _set_aside(job: Job, run: int) -> None:
    """Keep the frames of a run that is to be run again mended, so that a stopped one goes on from there."""
    (job.out / REPORT).unlink(missing_ok=True)
    if (job.out / FRAMES).is_file() and not (job.out / UNMENDED.format(run)).is_file():
        (job.out / FRAMES).replace(job.out / UNMENDED.format(run))


def _resumable(out: Path, resume: bool) -> bool:
    checkpoint = out / CHECKPOINT
    return resume and checkpoint.is_file() and checkpoint.stat().st_size > 0


def _finished(job: Job) -> Drive | None:
    """The result of a run that needs no resuming; raises OutputError when it was another one.

    None where only the recording is lacking: the frames are a checkpoint again, and the run goes on from its end.
    """
    done, _ = read_checkpoint(job.out / FRAMES, job.key)
    if len(done) != job.stop - job.start:
        remedy = f"it has {len(done)} frames; name a new folder, or add --overwrite"
        raise OutputError("finished run of other frames", job.out, remedy)
    if job.record and not (job.out / "recording.rrd").is_file():
        (job.out / FRAMES).replace(job.out / CHECKPOINT)
        return None
    return load_run(job.out)


def _run(job: Job, keep: int | None, progress: Progress | None) -> Drive:
    """All of it. keep: bytes of an earlier run's checkpoint, to whose frames this one's are added."""
    for stale in job.out.glob(".*.tmp"):
        stale.unlink(missing_ok=True)
    checkpoint = Checkpoint(job.out / CHECKPOINT, job.key, keep)
    try:
        drive = _through(job, checkpoint, progress)
        write_mended(job.source, drive, job.out)
        write_run(drive, job.out)
    except KeyboardInterrupt:
        if len(checkpoint):
            raise Interrupted(len(checkpoint), job.stop - job.start) from None
        raise
    (job.out / CHECKPOINT).replace(job.out / FRAMES)
    return drive


def _through(job: Job, checkpoint: Checkpoint, progress: Progress | None) -> Drive:
    """The frames that are not in the checkpoint yet, then the whole drive."""
    observers: list[Observer] = []
    earlier, whole, began = checkpoint[:], False, time.perf_counter()
    elapsed_s = 1e-3 * sum(d.total_ms for d in earlier)
    try:
        for observer in _observers(job):
            observers.append(observer)
        for finished in earlier if observers else ():
            frame = job.seen[finished.result.frame]
            _show(observers, frame, finished.result, _matched(job, frame, finished.result))
        steps = follow(job.seen, job.config, job.start, job.stop, earlier)
        del earlier
        for step in steps:
            result, road = checkpoint.append(step.done).result, step.look.road
            _show(observers, step.frame, result, None if road is None else road.matched)
            if progress:
                progress(len(checkpoint), job.stop - job.start, job.doing)
        elapsed_s += time.perf_counter() - began

        def at_the_end(doing: str) -> None:
            if progress:
                progress(len(checkpoint), job.stop - job.start, doing)

        await_compiled(lambda: at_the_end("compiling the rest, once for this machine"))
        at_the_end("analysing the drive")
        drive, truth = _drive(job, checkpoint[:], elapsed_s)
        for observer in observers:
            observer.drive(drive, None if truth is None else truth.poses)
        whole = True
    except KeyboardInterrupt:
        if done := checkpoint[:]:
            whole = True
            drive = Drive.of_frames([d.result for d in done], job.config)
            write_run(_told(drive, job, done, 1e-3 * sum(d.total_ms for d in done)), job.out)
        raise
    finally:
        checkpoint.close()
        for observer in observers:
            observer.close(whole)
    return drive


def _drive(job: Job, done: list[Done], elapsed_s: float) -> tuple[Drive, GroundTruth | None]:
    """What the frames of a whole drive say, and the truth that they are held against."""
    truth = cut_truth(job.source.ground_truth, job.start, job.start + len(done))
    from stereocalib_core.run.lag import with_lag

    results = [d.result for d in done]
    drive = _told(_analyse(results, job, truth), job, done, elapsed_s)
    drive = with_lag(drive, results, job.seen, job.config)
    return dataclasses.replace(drive, mended=job.mending), truth


def _observers(job: Job) -> Iterator[Observer]:
    if not (job.record or job.show):
        return
    from stereocalib_core.files.rrd import Recorder

    for path in [job.out / "recording.rrd"] * job.record + [None] * job.show:
        yield Recorder(job.seen.camera, job.source.name, path)


def _show(
    observers: list[Observer], frame: StereoFrame, result: FrameResult, disparity: DisparityMap | None
) -> None:
    for observer in observers:
        observer.frame(frame, result, disparity)


def _matched(job: Job, frame: StereoFrame, result: FrameResult) -> DisparityMap | None:
    """The disparity of a frame that was done by a run before this one, as far as the road came near in it."""
    from stereocalib_core.front.matching import find_matcher
    from stereocalib_core.front.sight import road_disparity

    if frame.left is None or frame.right is None:
        return None
    config, camera = job.config.disparity, job.seen.camera
    nearest = None
    if result.road is not None and config.max_disparity_px == "auto":
        nearest = config.margin * road_disparity(camera, result.road.extrinsics)
    return find_matcher(config.matcher)(frame.left, frame.right, camera, config, None, nearest)


def _told(drive: Drive, job: Job, done: list[Done], elapsed_s: float) -> Drive:
    """The drive with what only its run knows."""
    return dataclasses.replace(told(drive, job.spec, job.seen, done, elapsed_s), limits=job.tolerances)


def _analyse(results: list[FrameResult], job: Job, truth: GroundTruth | None) -> Drive:
    from stereocalib_core.back.analyse import analyse

    return analyse(results, job.seen.camera, job.config, truth, job.rig)
