"""The recipe: one stereo pair in, one small immutable result out."""

from __future__ import annotations

import dataclasses
import time
from collections import deque
from collections.abc import Iterable, Sequence
from concurrent.futures import Executor
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.config import PipelineConfig
from stereocalib_core.config.running import PREPARED_AHEAD
from stereocalib_core.errors import Failure, FailureReason
from stereocalib_core.frames import StereoFrame
from stereocalib_core.front import own_car
from stereocalib_core.front.car_way import curvature_of
from stereocalib_core.front.matching import Matcher, find_matcher
from stereocalib_core.front.road.ahead import bend_ahead
from stereocalib_core.front.road.estimate import (
    Hint,
    begin_road,
    estimate_road,
    finish_road,
)
from stereocalib_core.front.road.result import RoadResult
from stereocalib_core.front.roads_behind import RoadsBehind
from stereocalib_core.front.rows.self_check import Examination, examine
from stereocalib_core.front.scan.lidar_road import scan_residual
from stereocalib_core.front.scan.road_surface import RoadSurface
from stereocalib_core.front.scan.scan_disparity import scan_disparities
from stereocalib_core.front.scan.scan_sample import sample_scan
from stereocalib_core.front.scan.view import ScanView
from stereocalib_core.front.tracks.corners import Sharpness
from stereocalib_core.front.tracks.tracks import PairView, TrackerState, advance
from stereocalib_core.geometry import Extrinsics, StereoCamera
from stereocalib_core.numeric.arrays import Grey
from stereocalib_core.results import Check, FrameResult, FrontEndMemory, RoadEstimate, Tracks


def _same(a: Grey | None, b: Grey | None) -> bool:
    return a is not None and b is not None and np.array_equal(a[::8], b[::8]) and np.array_equal(a, b)


def owned(frame: StereoFrame) -> StereoFrame:
    """The frame with pictures that are whole blocks of memory of their own.

    Compiled code is another one for pictures that are a part of others, or that may not be written to, and it rounds
    otherwise: the same pixels are to give the same bits, wherever they come from.
    """
    left, right = (
        image
        if image is None or (image.flags.c_contiguous and image.flags.writeable)
        else np.array(image, order="C")
        for image in (frame.left, frame.right)
    )
    return (
        frame
        if left is frame.left and right is frame.right
        else dataclasses.replace(frame, left=left, right=right)
    )


@dataclasses.dataclass(frozen=True)
class Look:
    """One frame's result, and all that its pair gave on the way, for whoever draws it; None where nobody looked."""

    result: FrameResult
    road: RoadResult | None = None


@dataclasses.dataclass(frozen=True)
class Prepared:
    """What a pair shows by itself: the check of its own rows, its dense disparity, where a road is looked for, and
    where the left picture is sharp.

    None of it needs the pair before, so that pairs may be prepared at the same time.
    """

    examined: Examination
    begun: RoadResult
    sharpness: Sharpness
    rows_ms: float


class FrontEnd:
    """Looks at the pixels of each frame once, in order. Keeps the previous pair for the tracks.

    Up to `PREPARED_AHEAD` frames may be prepared while one is looked at: for this, how far and how high to
    match is taken from the road as it was known so many frames earlier, whether somebody prepares ahead or not.

    matcher: gives the dense disparity; None = the one that `config` names.
    T_camera_lidar: (4, 4) where frames carry LiDAR scans; without it the scans are left alone.
    """

    def __init__(
        self,
        camera: StereoCamera,
        config: PipelineConfig,
        matcher: Matcher | None = None,
        T_camera_lidar: NDArray[np.float64] | None = None,
    ) -> None:
        self.camera = camera
        self.config = config
        self.matcher = matcher or find_matcher(config.disparity.matcher)
        self.T_camera_lidar = T_camera_lidar
        self._tracker = TrackerState()
        self._behind = RoadsBehind(camera, config)
        self._own_car = own_car.Search()
        self._previous: tuple[Grey | None, Grey | None] = (None, None)
        self._pasts: deque[Extrinsics | None] = deque(
            [None] * (PREPARED_AHEAD + 1), maxlen=PREPARED_AHEAD + 1
        )

    @property
    def pasts(self) -> tuple[Extrinsics | None, ...]:
        """The roads that the next `PREPARED_AHEAD` + 1 frames are to be prepared with, the next one's first."""
        return tuple(self._pasts)

    def prepare(self, frame: StereoFrame, past: Extrinsics | None) -> Prepared | None:
        """What `look` needs of a pair, from any thread and in any order; None where there is nothing to look at."""
        frame = owned(frame)
        left, right = frame.left, frame.right
        if frame.failure is not None or left is None or right is None or not self._is_mine(frame):
            return None
        config = self.config
        whole = config.method == "paper"
        begun = begin_road(left, right, self.camera, config, self.matcher, past, whole)
        began = time.perf_counter()
        examined = examine(self.camera, left, right, config.rectification)
        rows_ms = 1e3 * (time.perf_counter() - began)
        return Prepared(examined, begun, Sharpness.of(left), rows_ms)

    def _is_mine(self, frame: StereoFrame) -> bool:
        return frame.camera is None or frame.camera == self.camera

    def step(self, frame: StereoFrame) -> FrameResult:
        """One pair to its result; never raises for a bad frame."""
        return self.look(frame).result

    def look(
        self, frame: StereoFrame, prepared: Prepared | None = None, aside: Executor | None = None
    ) -> Look:
        """`step` with what it saw on the way. prepared: by `prepare` with the first of `pasts`, where it was. aside:
        takes over what can be done at the same time.

        A pair with a camera of its own, out of a set of single pairs, is looked at by itself: nothing of its
        neighbours is its past, and it is none of theirs.
        """
        look = self._look(owned(frame), prepared, aside)
        self._pasts.append(self._behind.past)
        return look

    def _look(self, frame: StereoFrame, prepared: Prepared | None, aside: Executor | None) -> Look:
        if not self._is_mine(frame):
            assert frame.camera is not None
            own = FrontEnd(frame.camera, self.config, self.matcher)
            return own.look(dataclasses.replace(frame, camera=None))
        left, right = frame.left, frame.right
        if frame.failure is not None or left is None or right is None:
            missing = frame.failure or Failure(FailureReason.UNREADABLE, "no pictures")
            return Look(FrameResult(frame.index, frame.timestamp_s, None, missing))
        failure = self._frozen(left, right)
        if failure is not None:
            return Look(FrameResult(frame.index, frame.timestamp_s, None, failure))
        prepared = prepared or self.prepare(frame, self._pasts[0])
        assert prepared is not None
        examined = prepared.examined
        road = finish_road(prepared.begun, left, right, self.camera, self.config, self._hint(frame.index))
        timing = {"rectification": prepared.rows_ms, **road.timing_ms}
        sample, checks = examined.sample, examined.checks
        if examined.failure is not None:
            failed = FrameResult(
                frame.index, frame.timestamp_s, None, examined.failure, rectification=sample, checks=checks,
                timing_ms=MappingProxyType(timing),
            )  # fmt: skip
            return Look(failed, road)
        began = time.perf_counter()
        tracks = self._track(frame.index, left, right, road, prepared.sharpness, aside)
        timing["tracks"] = 1e3 * (time.perf_counter() - began)
        began = time.perf_counter()
        estimate, ahead = self._bent(road)
        timing["bend"] = 1e3 * (time.perf_counter() - began)
        inliers = None if estimate is None else estimate.inliers
        result = FrameResult(
            frame.index, frame.timestamp_s, estimate, road.failure, road.free_fraction, inliers, sample,
            tracks, checks + road.checks + ahead, MappingProxyType(timing),
        )  # fmt: skip
        return Look(self.with_lidar(frame, result, road), road)

    def _hint(self, index: int) -> Hint:
        """Where the road of frame `index` is likely to be, and where the own car is."""
        return self._behind.hint(index, self._own_car.found(self.camera, self.config.own_car))

    def _bent(self, road: RoadResult) -> tuple[RoadEstimate | None, tuple[Check, ...]]:
        """The estimate with how the road bends up or down along the car's way, which the tracks have just shown."""
        estimate = road.estimate
        if estimate is None:
            return estimate, ()
        way = curvature_of(self._tracker.motion, estimate.extrinsics.height_m, self.config.region)
        bend = bend_ahead(road.disparity, road.free, self.camera, estimate.extrinsics, self.config.lane, way)
        return dataclasses.replace(estimate, bend=bend), (
            Check("lane", "bend ahead, in pitch", float(np.rad2deg(bend[1])), unit="deg"),
        )

    def with_lidar(self, frame: StereoFrame, result: FrameResult, road: RoadResult) -> FrameResult:
        """The same with what the frame's scan says of the road and of depth edges, where there is a scan."""
        T, config = self.T_camera_lidar, self.config
        if frame.lidar is None or T is None:
            return result
        began = time.perf_counter()
        surface = RoadSurface.of(road, self.camera, config.direct)
        residual = scan_residual(frame, result, T, config.road_check, surface)
        sample = seen = None
        left, right = frame.left, frame.right
        if left is not None and right is not None and road.matched is not None:
            view = ScanView.of(frame.lidar, self.camera, T, config.scan_sample)
            over = None if result.road is None else result.road.extrinsics
            sample = sample_scan(
                *(view, left, road.disparity, self.camera, over, config.scan_sample, frame.lidar_sweep)
            )
            if config.scan_disparity.wanted(frame.index):
                seen = scan_disparities(
                    *(self.camera, left, right, road.disparity, view),
                    *(config.scan_disparity, result.rectification),
                )
        timing = {**result.timing_ms, "lidar": 1e3 * (time.perf_counter() - began)}
        return dataclasses.replace(
            result, lidar=residual, scan=sample, disparities=seen, timing_ms=MappingProxyType(timing)
        )

    def _frozen(self, left: Grey, right: Grey) -> Failure | None:
        """One camera repeats its picture while the other goes on; both at once is a pair as good as before."""
        same = (_same(left, self._previous[0]), _same(right, self._previous[1]))
        self._previous = (left, right)
        if same[0] == same[1]:
            return None
        return Failure(
            FailureReason.FROZEN, f"the {'left' if same[0] else 'right'} camera repeats its last picture"
        )

    def _track(
        self,
        index: int,
        left: Grey,
        right: Grey,
        road: RoadResult,
        sharpness: Sharpness,
        aside: Executor | None,
    ) -> Tracks | None:
        if road.matched is None:
            return None
        of_road = None if road.estimate is None else road.estimate.extrinsics
        self._behind.saw(of_road)
        standing = self._behind.standing
        view = PairView(index, left, right, road.disparity, standing, of_road is not None, sharpness)
        self._tracker, tracks = advance(self.camera, self._tracker, view, self.config.tracks, aside)
        motion = self._tracker.motion
        self._own_car = own_car.go_on(
            *(self._own_car, index, (left, right), self._behind.motion_to(index, motion)),
            *(standing, self.camera, self.config.own_car),
        )
        self._behind.went(index, motion, of_road)
        return tracks

    @property
    def memory(self) -> FrontEndMemory:
        """What the next step depends on, small enough to be kept beside every result."""
        view = self._tracker.view
        tracked = None if view is None else view.index
        return FrontEndMemory(tracked, self._tracker.motion, self._own_car.memory)

    def recall(
        self, frames: Iterable[StereoFrame], done: Sequence[tuple[FrameResult, FrontEndMemory]]
    ) -> None:
        """Take up a drive where another front end left it, so that the next step gives the same bits.

        done: the results so far with what was remembered after each. frames: those from the last memory's
        `tracked` (or the last readable one) to the last, and before them those that its `own_car.kept` names.
        """
        memory = done[-1][1]
        seen = {frame.index: owned(frame) for frame in frames}
        left = {index: frame.left for index, frame in seen.items() if frame.left is not None}
        for frame in seen.values():
            if frame.left is not None and frame.right is not None:
                self._previous = (frame.left, frame.right)
        for result, remembered in done:
            past, own = self._pasts[0], self._own_car.found(self.camera, self.config.own_car)
            self._replay(result, remembered)
            if result.frame == memory.tracked == remembered.tracked:
                self._retrack(seen[result.frame], result, past, own)
        self._own_car = own_car.take_up(memory.own_car, left, self.camera, self.config.own_car)
        self._tracker = dataclasses.replace(self._tracker, motion=memory.motion)

    def _replay(self, result: FrameResult, remembered: FrontEndMemory) -> None:
        """What the frames after it keep of a frame."""
        self._own_car = own_car.Search(remembered.own_car)
        if remembered.tracked == result.frame:
            road = None if result.road is None else result.road.extrinsics
            self._behind.saw(road)
            self._behind.went(result.frame, remembered.motion, road)
        self._pasts.append(self._behind.past)

    def _retrack(
        self,
        frame: StereoFrame,
        result: FrameResult,
        past: Extrinsics | None,
        own: own_car.OwnCar | None,
    ) -> None:
        """Start the tracks again at a pair whose road is known. past, own: what it was looked at with."""
        prepared = self.prepare(frame, past)
        assert prepared is not None and frame.left is not None and frame.right is not None
        disparity = prepared.begun.matched
        assert disparity is not None
        disparity = disparity if own is None else own.without(disparity)
        view = PairView(
            *(frame.index, frame.left, frame.right, disparity, self._behind.standing),
            *(result.road is not None, prepared.sharpness),
        )
        self._tracker, _ = advance(self.camera, TrackerState(), view, self.config.tracks)

    def stages(
        self, frame: StereoFrame, before: Sequence[tuple[FrameResult, FrontEndMemory]] = ()
    ) -> RoadResult | None:
        """Every intermediate picture of one pair, for display; None where there is no disparity to show.

        before: the frames before it, as in `recall`: the pair is then seen as the drive saw it.
        """
        frame = owned(frame)
        left, right, config = frame.left, frame.right, self.config
        if left is None or right is None or frame.failure is not None:
            return None
        if not before or not self._is_mine(frame):
            road = estimate_road(left, right, frame.camera or self.camera, config, self.matcher)
            return road if road.drawable else None
        drive = FrontEnd(self.camera, config, self.matcher, self.T_camera_lidar)
        for result, remembered in before:
            drive._replay(result, remembered)
        drive._tracker = TrackerState(motion=before[-1][1].motion)
        prepared = drive.prepare(frame, drive._pasts[0])
        assert prepared is not None
        road = finish_road(
            prepared.begun, left, right, self.camera, config, drive._hint(frame.index), compare=True
        )
        return road if road.drawable else None
