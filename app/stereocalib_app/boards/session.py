"""A folder of chessboard poses being calibrated: one worker detects, then solves; the latest wish wins.

Readers take `snapshot`, which is immutable; nothing here draws.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stereocalib_app.boards.watch import LOOK_EVERY_S, FolderWatch
from stereocalib_core.boards import (
    Answer,
    BoardFolder,
    Calibration,
    Detection,
    Memo,
    detect,
    judge,
    open_folder,
    solve,
)
from stereocalib_core.boards.cloud_files import read_cloud
from stereocalib_core.boards.folder import read_picture
from stereocalib_core.boards.trial import Trial, nudged, try_transform
from stereocalib_core.errors import SourceError, StereoCalibError

LOG = logging.getLogger(__name__)
KEPT_PAIRS = 12
NO_NUDGE = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
COMPARISONS = ("one above the other", "blink", "wipe")
"""How the pictures before and after the refinement are shown."""
AT_REST = ("solving", "ready", "failed")
Nudge = tuple[float, float, float, float, float, float]


@dataclass(frozen=True)
class Wish:
    """What the page wants: the pair on show, names that are ticked out, and the nudge.

    nudge: turns about the camera's x, y, z [deg], then shifts along them [m]. refine: intrinsics too; kappa: weight of
    LiDAR points against corners [px/m], 0 = by their noise.
    """

    pair: int = 0
    excluded: frozenset[str] = frozenset()
    nudge: Nudge = NO_NUDGE
    close_up: bool = False
    before: bool = True
    compare: str = COMPARISONS[0]
    refine: bool = False
    kappa: float = 0.0


@dataclass(frozen=True)
class LidarSnapshot:
    """All there is to show. solved_for: the names ticked out of `result`. solve_s: how long it took."""

    stage: str = "opening"
    done: int = 0
    total: int = 0
    problem: str = ""
    detection: Detection | None = None
    result: Calibration | None = None
    first: Calibration | None = None
    trial: Trial | None = None
    answer: Answer | None = None
    solved_for: frozenset[str] = frozenset()
    solve_s: float = 0.0
    wish: Wish = field(default_factory=Wish)

    @property
    def busy(self) -> bool:
        """Whether boards are being looked for."""
        return self.stage not in AT_REST


@dataclass(frozen=True)
class PairFiles:
    """Picture (H, W) grey and cloud (N, 3) [m] of a pair; either may be None with `problem` saying why."""

    picture: NDArray[np.uint8] | None
    cloud: NDArray[np.float64] | None
    problem: str = ""


class _ClosedError(Exception):
    """The page was closed while boards were being looked for."""


def solved(detection: Detection, wish: Wish) -> Calibration:
    """The pairs that are ticked, solved as wished; raises SourceError."""
    mask = [o.name not in wish.excluded for o in detection.observations]
    return solve(detection, wish.refine, wish.kappa or None, mask)


class LidarSession:
    """Owns the worker. `show(snapshot)` is called by it alone, after every change.

    With `watch` the folder is looked at again and again, and whatever is new in it is taken in.
    """

    def __init__(
        self, path: Path, show: Callable[[LidarSnapshot], None] | None = None, watch: bool = False
    ) -> None:
        self.folder: BoardFolder = open_folder(path)
        self.path = path
        self.watching = FolderWatch(path) if watch else None
        self._memo = Memo()
        self.show: Callable[[LidarSnapshot], None] = show or (lambda _: None)
        self.snapshot = LidarSnapshot(total=len(self.folder.names))
        self._changed = threading.Condition()
        self._wish, self._revision, self._closed = Wish(), 0, False
        self._thread = threading.Thread(target=self._work, name="lidar-camera", daemon=True)
        self.files = lru_cache(maxsize=KEPT_PAIRS)(self._files)

    def start(self) -> None:
        """Begin to look for boards."""
        self._thread.start()

    def close(self) -> None:
        """Stop after what is being computed."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    @property
    def wish(self) -> Wish:
        """The latest wish, which may not be fulfilled yet."""
        return self._wish

    def change(self, **changes: object) -> None:
        """Change what is wanted; only the latest state is ever computed."""
        with self._changed:
            self._wish = replace(self._wish, **changes)  # type: ignore[arg-type]
            self._revision += 1
            self._changed.notify_all()

    def tick(self, name: str, used: bool) -> None:
        """Take a pair in or out."""
        with self._changed:
            out = self._wish.excluded
            self.change(excluded=out - {name} if used else out | {name})

    def step(self, by: int) -> None:
        """Show another pair; stops at the ends."""
        last = len(self.folder.names) - 1
        self.change(pair=min(max(self._wish.pair + by, 0), last))

    # --- the worker

    def _work(self) -> None:
        try:
            self._until_closed()
        except _ClosedError:
            LOG.debug("closed while looking for boards")
        except StereoCalibError as error:
            LOG.warning("%s", error)
            self._publish(problem=f"{error.what}: {error.where}. {error.remedy}", stage="failed")
        finally:
            if not self._closed and self.snapshot.stage != "failed":
                # Whatever it was is on the terminal; the page must not wait for ever.
                self._publish(
                    problem="the computation stopped unexpectedly: see the terminal", stage="failed"
                )

    def _until_closed(self) -> None:
        seen = -1
        detection = detect(self.folder, self._progress, self._memo)
        self._publish(detection=detection, stage="solving")
        patience = None if self.watching is None else LOOK_EVERY_S
        while not self._closed:
            with self._changed:
                woken = self._changed.wait_for(partial(self._news, seen), patience)
                seen, wish = self._revision, self._wish
            if self._closed:
                return
            if not woken:
                grown = self._grown()
                if grown is None:
                    continue
                detection, wish = grown
            self._fulfil(detection, wish)

    def _news(self, seen: int) -> bool:
        return self._closed or self._revision != seen

    def _grown(self) -> tuple[Detection, Wish] | None:
        """What is in the folder now, if that is new and can be read, and the wish that has its newest pair on show."""
        if self.watching is None or not self.watching.settled():
            return None
        try:
            folder = open_folder(self.path)
            detection = detect(folder, self._progress, self._memo)
        except StereoCalibError as error:
            # Half a file, or settings that are being edited: said, and looked at again when they change.
            self._publish(stage="ready", problem=f"{error.what}: {error.where}. {error.remedy}")
            return None
        before = set(self.folder.names)
        new = [i for i, name in enumerate(folder.names) if name not in before]
        on_show = self.folder.names[self._wish.pair]
        pair = new[-1] if new else folder.names.index(on_show) if on_show in folder.names else 0
        self.files.cache_clear()
        with self._changed:
            self.folder = folder
            self.change(pair=pair)
            wish = self._wish
        self._publish(
            detection=detection, result=None, first=None, trial=None, answer=None, problem="", stage="solving",
            total=len(folder.names), wish=wish,
        )  # fmt: skip
        return detection, wish

    def _progress(self, stage: str, done: int, total: int) -> None:
        if self._closed:
            raise _ClosedError
        self._publish(stage=stage, done=done, total=total)

    def _publish(self, **changes: object) -> None:
        self.snapshot = replace(self.snapshot, **changes)  # type: ignore[arg-type]
        self.show(self.snapshot)

    def _fulfil(self, detection: Detection, wish: Wish) -> None:
        """Solve if the ticks changed, try the nudge, show."""
        now = self.snapshot
        result, problem, solve_s = now.result, now.problem, now.solve_s
        answer = now.answer
        asked = (wish.excluded, wish.refine, wish.kappa)
        if now.stage != "ready" or asked != (now.solved_for, now.wish.refine, now.wish.kappa):
            start = time.perf_counter()
            try:
                answer = judge(detection, solved(detection, wish), quick=True, advise=False)
                result, problem = answer.calibration, ""
            except SourceError as error:
                result, answer, problem = None, None, f"{error.what}: {error.where}. {error.remedy}"
            solve_s = time.perf_counter() - start
            LOG.debug("solved in %.0f ms", 1000 * solve_s)
        trial = None
        if result is not None and wish.nudge != NO_NUDGE:
            values = np.array(wish.nudge)
            moved = nudged(result.T_camera_lidar, np.deg2rad(values[:3]), values[3:])
            trial = try_transform(detection.observations, result, moved)
        first = now.first if now.first is not None else result
        self._publish(
            stage="ready", problem=problem, result=result, first=first, trial=trial, answer=answer,
            solved_for=wish.excluded, solve_s=solve_s, wish=wish,
        )  # fmt: skip
        if answer is not None and answer is not now.answer:
            # What takes longer follows when the numbers are on show: the pose to add, and once the slow findings.
            full = judge(detection, answer.calibration, quick=now.answer is not None, advise=True)
            self._publish(answer=replace(full, calibration=answer.calibration))

    def _files(self, name: str) -> PairFiles:
        problems = []
        picture = cloud = None
        image_path, cloud_path = self.folder.images.get(name), self.folder.clouds.get(name)
        try:
            picture = None if image_path is None else read_picture(image_path, self.folder.camera)
        except SourceError as error:
            problems.append(error.what)
        try:
            cloud = None if cloud_path is None else read_cloud(cloud_path)
        except SourceError as error:
            problems.append(error.what)
        if image_path is None or cloud_path is None:
            problems.append(f"no {'picture' if image_path is None else 'cloud'} of this name")
        return PairFiles(picture, cloud, "; ".join(problems))
