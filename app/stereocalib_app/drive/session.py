"""One drive, opened: its frames go through the front end once, in the background."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereocalib_app.drive.frame_views import FrameViews
from stereocalib_app.drive.paths import DrivePaths
from stereocalib_app.words.lessons import TURNED, broken_config, turned
from stereocalib_core.config import PipelineConfig
from stereocalib_core.errors import StereoCalibError
from stereocalib_core.files.frame_record import Done
from stereocalib_core.frames import FrameSource, StereoFrame
from stereocalib_core.front.matching import MatchedOnce, find_matcher
from stereocalib_core.front.pipeline import FrontEnd
from stereocalib_core.front.road.result import RoadResult
from stereocalib_core.results import Drive, FrameResult, FrontEndMemory, Timing
from stereocalib_core.run.calibrate import follow

LOG = logging.getLogger(__name__)
FIRST_ANALYSIS_S = 2.0
"""The whole drive is first analysed this long after the start, then so that it takes below a tenth."""
ANALYSIS_SHARE = 0.1
LONGEST_WAIT_S = 8.0
HELD_S = 0.03
"""Between two looks whether it may go on."""
FIRST_FRAMES = 8
"""Fewer frames are not worth an analysis."""

Analyse = Callable[[Sequence[FrameResult]], Drive | None]


@dataclass(frozen=True)
class Kept:
    """What an earlier run kept of its frames. frames: none where they cannot be read. lost: what that means."""

    frames: Sequence[Done]
    lost: tuple[str, ...] = ()


@dataclass(frozen=True)
class Snapshot:
    """What is known of a drive at some moment; `version` grows with every change.

    results: of frames 0, 1, ... as far as computed. drive, paths: what the first `analysed` of them say, or None.
    problem: why the computation stopped early, or empty.
    """

    total: int
    results: tuple[FrameResult, ...] = ()
    drive: Drive | None = None
    paths: DrivePaths | None = None
    analysed: int = 0
    done: bool = False
    problem: str = ""
    frames_per_second: float = 0.0
    version: int = 0

    @property
    def progress(self) -> float:
        """Share of the frames that are computed, 0...1."""
        return len(self.results) / max(1, self.total)

    def failures(self) -> NDArray[np.int64]:
        """Numbers of the failed frames, ascending."""
        return np.array([r.frame for r in self.results if not r.ok], dtype=np.int64)

    def result(self, frame: int) -> FrameResult | None:
        """The result of one frame, None where it is not computed yet."""
        return self.results[frame] if frame < len(self.results) else None


class Session:
    """Owns the worker that computes a drive. Threads read `snapshot`, which is immutable.

    spec: the SOURCE that `run` would be given. run_folder: the earlier run that was opened, or None.
    finished: frames 0, 1, ... that need not be computed again. reading: reads the same frames with all that an earlier
    run kept of them, which takes its time for a long drive: until then the page shows `finished`. tracks: whether there
    are tracks, without which no path can be computed anew. notices: what the page cannot show of it.
    """

    def __init__(
        self,
        source: FrameSource,
        config: PipelineConfig,
        *,
        spec: str = "",
        analyse: Analyse | None = None,
        finished: Sequence[Done] = (),
        reading: Callable[[], Kept] | None = None,
        rig: Path | None = None,
        frames: tuple[int, int] | None = None,
        run_folder: Path | None = None,
        tracks: bool = True,
        notices: tuple[str, ...] = (),
    ) -> None:
        self.source, self.config, self.spec, self.rig = source, config, spec or source.name, rig
        self.frames, self.run_folder, self.tracks, self.notices = frames, run_folder, tracks, notices
        self._analyse, self._reading = analyse, reading
        self._matcher = MatchedOnce(find_matcher(config.disparity.matcher))
        self._views: dict[str, FrameViews] = {}
        self.views = self.views_with("")
        self._snapshot = Snapshot(total=len(source))
        self._done = list(finished)
        self._stop = threading.Event()
        self.held: Callable[[int], bool] = lambda done: False
        """Whether no frame shall be begun for now, after so many."""
        self._thread = threading.Thread(target=self._run, name="front end", daemon=True)

    @property
    def snapshot(self) -> Snapshot:
        """What is known now."""
        return self._snapshot

    @property
    def camera(self) -> Any:
        """The camera of the source."""
        return self.source.camera

    def done_before(self, frame: int) -> list[Done]:
        """The computed frames before `frame`, for another session of the same pictures."""
        return self._done[:frame]

    def _before(self, frame: int) -> list[tuple[FrameResult, FrontEndMemory]]:
        """What the front end remembered when it came to `frame`; nothing where it has not come so far."""
        if self._reading is not None or len(self._done) < frame:
            return []
        return [(d.result, d.memory) for d in self._done[:frame]]

    def views_with(self, broken_stage: str) -> FrameViews:
        """The views of the drive, or of what a broken stage makes of it."""
        if broken_stage not in self._views:
            front_end = FrontEnd(self.source.camera, broken_config(self.config, broken_stage), self._matcher)
            camera, stages = self.source.camera, front_end.stages
            turn = TURNED.get(broken_stage)

            def make(frame: StereoFrame) -> RoadResult | None:
                if broken_stage == "":
                    return stages(frame, self._before(frame.index))
                return stages(frame if turn is None else turned(frame, camera, turn))

            self._views[broken_stage] = FrameViews(self.source, make)
        return self._views[broken_stage]

    def start(self) -> None:
        """Start computing, unless it has begun."""
        if self._thread.ident is None:
            self._thread.start()

    def close(self, timeout_s: float = 10.0) -> None:
        """Stop computing after the frame in work, and wait for that at most `timeout_s`."""
        self._stop.set()
        for views in self._views.values():
            views.close()
        if self._thread.is_alive():
            self._thread.join(timeout=timeout_s)

    def wait(self, timeout_s: float) -> bool:
        """Wait until the drive is computed; whether it is."""
        self._thread.join(timeout=timeout_s)
        return self._snapshot.done

    def _publish(self, **changes: Any) -> None:
        self._snapshot = replace(self._snapshot, version=self._snapshot.version + 1, **changes)

    def _read(self) -> None:
        """What an earlier run kept of its frames; its numbers are on show meanwhile."""
        if self._reading is None:
            return
        results = tuple(done.result for done in self._done)
        drive = None if self._analyse is None else self._analyse(results)
        self._publish(results=results, drive=self._told(drive, results), analysed=len(results))
        while self.held(len(results)) and not self._stop.wait(HELD_S):
            pass
        kept, self._reading = self._reading(), None
        if kept.frames:
            self._done = list(kept.frames)
        else:
            self.tracks, self.notices = False, self.notices + kept.lost

    def _run(self) -> None:
        try:
            self._read()
            started, known = time.monotonic(), len(self._done)
            results = [done.result for done in self._done]
            next_analysis = started + FIRST_ANALYSIS_S
            if 0 < known < len(self.source):
                self._publish(results=tuple(results))
                self._update_analysis(results)
            for step in follow(self.source, self.config, earlier=tuple(self._done), matcher=self._matcher):
                if self._stop.is_set():
                    return
                if step.look.road is not None:
                    road = step.look.road
                    self.views.keep(step.frame, road if road.drawable else None)
                results.append(step.done.result)
                self._done.append(step.done)
                elapsed = max(time.monotonic() - started, 1e-6)
                self._publish(results=tuple(results), frames_per_second=(len(results) - known) / elapsed)
                if time.monotonic() >= next_analysis and len(results) >= FIRST_FRAMES:
                    spent = self._update_analysis(results)
                    pause = min(max(FIRST_ANALYSIS_S, spent / ANALYSIS_SHARE), LONGEST_WAIT_S)
                    next_analysis = time.monotonic() + pause
                while self.held(len(results)) and not self._stop.wait(HELD_S):
                    pass
            self._publish(results=tuple(results))
            self._update_analysis(results)
            self._publish(done=True)
        except StereoCalibError as error:
            LOG.warning("%s", error)
            self._publish(problem=str(error), done=True)
        finally:
            if not self._snapshot.done and not self._stop.is_set():
                # Whatever it was is on the terminal; the page must not wait for ever.
                self._publish(problem="the computation stopped unexpectedly: see the terminal", done=True)

    def _told(self, drive: Drive | None, results: Sequence[FrameResult]) -> Drive:
        """The drive with what only this session knows."""
        if self.run_folder is not None and drive is not None:
            return drive
        rate = self._snapshot.frames_per_second
        timing = Timing.of(results, len(results) / rate if rate > 0 else 0.0)
        return replace(drive or Drive.of_frames(results, self.config), source=self.spec, timing=timing)

    def _update_analysis(self, results: Sequence[FrameResult]) -> float:
        """Recompute what needs the whole drive; returns the seconds spent."""
        begin = time.monotonic()
        if results:
            drive = None if self._analyse is None else self._analyse(tuple(results))
            paths = DrivePaths(self.source.camera, results, drive) if self.tracks else None
            self._publish(drive=self._told(drive, results), paths=paths, analysed=len(results))
        return time.monotonic() - begin
