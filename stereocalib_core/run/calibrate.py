"""A drive from its source to what it says, without files: the front end's loop, and the back end after it."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.config import PipelineConfig
from stereocalib_core.errors import ConfigError
from stereocalib_core.files.frame_record import Done
from stereocalib_core.frames import FrameSource, GroundTruth, StereoFrame
from stereocalib_core.results import OWN_CAR, Drive, Rig, Timing
from stereocalib_core.run.side_by_side import looks
from stereocalib_core.sources import open_source

if TYPE_CHECKING:
    from stereocalib_core.front.matching import Matcher
    from stereocalib_core.front.pipeline import FrontEnd, Look

Progress = Callable[[int, int, str], None]
"""Called with frames done, frames in all, and what is being done."""


@dataclass(frozen=True)
class Step:
    """One frame that has just been done. look: what was seen in it. done: what is kept of it."""

    frame: StereoFrame
    look: Look
    done: Done


def follow(
    source: FrameSource,
    config: PipelineConfig,
    start: int = 0,
    stop: int | None = None,
    earlier: Sequence[Done] = (),
    matcher: Matcher | None = None,
) -> Iterator[Step]:
    """Frames start...stop - 1 through the front end, in order; on several cores neighbours are worked on at once.

    earlier: the first of them, done before; the front end goes on where it was after those, to the same bits.
    """
    from stereocalib_core.front.pipeline import FrontEnd

    stop = len(source) if stop is None else stop
    if start + len(earlier) >= stop:
        return
    front_end = FrontEnd(source.camera, config, matcher, source.T_camera_lidar)
    if earlier:
        _recall(front_end, source, earlier)
    start, earlier = start + len(earlier), ()  # they are needed no more, and may be many
    before = time.perf_counter()
    for frame, look in looks(front_end, source, start, stop):
        now = time.perf_counter()
        yield Step(frame, look, Done(look.result, front_end.memory, 1e3 * (now - before)))
        before = time.perf_counter()


def _recall(front_end: FrontEnd, source: FrameSource, earlier: Sequence[Done]) -> None:
    """Bring a new front end to where it was after `earlier`, by looking once more at the last frames of it.

    And at those few before them with which the search for the own car compares.
    """
    last = earlier[-1].result.frame
    memory = earlier[-1].memory
    first = memory.tracked
    again: list[StereoFrame] = []
    for index in range(last, earlier[0].result.frame - 1, -1):
        frame = source[index]
        again.insert(0, frame)
        if index == first or (first is None and frame.failure is None):
            break
    kept = {frame for frame, _ in memory.own_car.kept} - {frame.index for frame in again}
    again = [source[frame] for frame in sorted(kept)] + again
    front_end.recall(again, [(d.result, d.memory) for d in earlier])


def calibrate(
    source: str | FrameSource,
    *,
    config: PipelineConfig | None = None,
    rig: Rig | None = None,
    progress: Progress | None = None,
    frames: tuple[int | None, int | None] = (None, None),
) -> Drive:
    """How a stereo camera stands over the road, in every frame of a drive, and the odometry that follows.

    source: any SOURCE of `stereocalib run`, or one that is open. config: settings, None = the defaults. rig: yaw
    and lever arm that are known of an earlier drive, `load_run(folder).mount`. progress: called with frames done,
    frames in all, and what is being done. frames: zero-based, half open; None = from the first, to the last.
    Raises StereoCalibError for input that cannot be used; a bad frame is a row with its reason.
    """
    from stereocalib_core.back.analyse import analyse
    from stereocalib_core.run.lag import with_lag

    recording = open_source(source) if isinstance(source, str) else source
    config = config or PipelineConfig()
    start, stop = frame_range(frames, len(recording))
    began, done = time.perf_counter(), []
    for step in follow(recording, config, start, stop):
        done.append(step.done)
        if progress:
            progress(len(done), stop - start, "frames")
    elapsed_s = time.perf_counter() - began
    truth = cut_truth(recording.ground_truth, start, start + len(done))
    results = [d.result for d in done]
    drive = analyse(results, recording.camera, config, truth, rig)
    drive = with_lag(drive, results, recording, config)
    return told(drive, source if isinstance(source, str) else recording.name, recording, done, elapsed_s)


def told(drive: Drive, spec: str, source: FrameSource, done: Sequence[Done], elapsed_s: float) -> Drive:
    """The drive with what only its run knows."""
    timing = Timing.of([d.result for d in done], elapsed_s, [d.total_ms for d in done])
    frames = dataclasses.replace(drive.frames, epoch_s=source.epoch_s)
    return dataclasses.replace(
        drive, frames=frames, source=spec, timing=timing, notices=(*source.notices, *_own_car(done))
    )


def _own_car(done: Sequence[Done]) -> tuple[str, ...]:
    """A word about what of the own car was found in the picture, and from where on it is left out."""
    known = [d.memory.own_car.tops for d in done]
    # what is known before a frame is what it is looked at with; of hundreds of thousands of checks few are asked
    new = [i for i in range(1, len(done)) if not _same(known[i - 1], known[i - 2] if i > 1 else None)]
    rows = [row for i in new if (row := next(filter(None, map(_own_rows, done[i:])), None)) is not None]
    if not rows:
        return ()
    first, most = rows[0][0], max(value for _, value in rows)
    what = f"bonnet: the lowest {most:.0f} rows are the car's own" if most else "black borders"
    return (f"{what}, found because they never move; no road is looked for there from frame {first} on",)


def _own_rows(done: Done) -> tuple[int, float] | None:
    """The frame, and how many rows are the own car's; None where none were known, or it was not come to."""
    values = [check.value for check in done.result.checks if (check.stage, check.name) == OWN_CAR]
    return (done.result.frame, values[0]) if values else None


def _same(a: NDArray[np.int16] | None, b: NDArray[np.int16] | None) -> bool:
    return a is b or (a is not None and b is not None and np.array_equal(a, b))


def frame_range(frames: tuple[int | None, int | None], count: int) -> tuple[int, int]:
    """First frame and the one after the last; raises ConfigError when no frame is left."""
    start = 0 if frames[0] is None else frames[0]
    stop = count if frames[1] is None else frames[1]
    if start >= count > 0:
        raise ConfigError("range of frames outside the drive", f"{start}:{stop}", f"it has {count} frames")
    if not 0 <= start < stop:
        raise ConfigError("empty range of frames", f"{start}:{stop}", "write A:B with A < B")
    return start, min(stop, count)


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
