"""The recipe: one stereo pair in, one small immutable result out."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterable
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.config import PipelineConfig
from stereocalib_core.errors import Failure, FailureReason
from stereocalib_core.frames import StereoFrame
from stereocalib_core.front.matching import Matcher, find_matcher
from stereocalib_core.front.road.ahead import bend_ahead
from stereocalib_core.front.road.estimate import RoadResult, begin_road, estimate_road, finish_road
from stereocalib_core.front.road.stages import RoadStages
from stereocalib_core.front.road.uv_disparity import v_disparity
from stereocalib_core.front.rows.self_check import Examination, examine
from stereocalib_core.front.scan.lidar_road import scan_residual
from stereocalib_core.front.scan.scan_disparity import scan_disparities
from stereocalib_core.front.scan.scan_sample import sample_scan
from stereocalib_core.front.tracks.tracks import PairView, TrackerState, advance
from stereocalib_core.geometry import Extrinsics, StereoCamera
from stereocalib_core.numeric.arrays import Grey
from stereocalib_core.numeric.threads import shared_pool
from stereocalib_core.results import Check, FrameResult, FrontEndMemory, RoadEstimate, Tracks

NOMINAL = Extrinsics(1.65, 0.0, 0.0)
"""Where tracks start from until a first pair shows the road."""
LEAST_TRAVEL_M = 0.1
"""Between two pairs: less shows no curvature."""


def _same(a: Grey | None, b: Grey | None) -> bool:
    return a is not None and b is not None and np.array_equal(a[::8], b[::8]) and np.array_equal(a, b)


@dataclasses.dataclass(frozen=True)
class Look:
    """One frame's result, and all that its pair gave on the way, for whoever draws it; None where nobody looked."""

    result: FrameResult
    road: RoadResult | None = None


def curvature_of(motion: NDArray[np.float64] | None) -> float:
    """[1/m] of the car's way, positive to the right; motion: (6,) of T_current_previous. 0 where it hardly moves."""
    if motion is None or -motion[5] < LEAST_TRAVEL_M:
        return 0.0
    return float(motion[1] / motion[5])


def look_at_pair(
    camera: StereoCamera, left: Grey, right: Grey, config: PipelineConfig, matcher: Matcher | None = None
) -> tuple[Examination, RoadResult, dict[str, float]]:
    """The pair's check of its own rows and its road, and the stages' ms.

    Neither needs the other: the rows are checked on the core that is free once the disparity is there.
    """

    def check_rows() -> tuple[Examination, float]:
        began = time.perf_counter()
        return examine(camera, left, right, config.rectification), 1e3 * (time.perf_counter() - began)

    begun = begin_road(left, right, camera, config, matcher)
    rows = shared_pool("row-check", 2).submit(check_rows)
    road = finish_road(begun, left, right, camera, config)
    examined, took = rows.result()
    return examined, road, {"rectification": took, **road.timing_ms}


class FrontEnd:
    """Looks at the pixels of each frame once, in order. Keeps the previous pair for the tracks.

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
        self._road = NOMINAL
        self._previous: tuple[Grey | None, Grey | None] = (None, None)

    def step(self, frame: StereoFrame) -> FrameResult:
        """One pair to its result; never raises for a bad frame."""
        return self.look(frame).result

    def look(self, frame: StereoFrame) -> Look:
        """`step` with what it saw on the way.

        A pair with a camera of its own, out of a set of single pairs, is looked at by itself: nothing of its
        neighbours is its past, and it is none of theirs.
        """
        if frame.camera is not None and frame.camera != self.camera:
            own = FrontEnd(frame.camera, self.config, self.matcher)
            return own.look(dataclasses.replace(frame, camera=None))
        left, right = frame.left, frame.right
        if frame.failure is not None or left is None or right is None:
            missing = frame.failure or Failure(FailureReason.UNREADABLE, "no pictures")
            return Look(FrameResult(frame.index, frame.timestamp_s, None, missing))
        failure = self._frozen(left, right)
        if failure is not None:
            return Look(FrameResult(frame.index, frame.timestamp_s, None, failure))
        examined, road, timing = look_at_pair(self.camera, left, right, self.config, self.matcher)
        sample, checks = examined.sample, examined.checks
        if examined.failure is not None:
            failed = FrameResult(
                frame.index, frame.timestamp_s, None, examined.failure, rectification=sample, checks=checks,
                timing_ms=MappingProxyType(timing),
            )  # fmt: skip
            return Look(failed, road)
        began = time.perf_counter()
        tracks = self._track(frame.index, left, right, road)
        timing["tracks"] = 1e3 * (time.perf_counter() - began)
        began = time.perf_counter()
        estimate, ahead = self._bent(road)
        timing["bend"] = 1e3 * (time.perf_counter() - began)
        inliers = None if estimate is None else estimate.inliers
        result = FrameResult(
            frame.index, frame.timestamp_s, estimate, road.failure, road.free_fraction, inliers, sample,
            tracks, checks + road.checks + ahead, MappingProxyType(timing),
        )  # fmt: skip
        return Look(self._with_lidar(frame, result, road), road)

    def _bent(self, road: RoadResult) -> tuple[RoadEstimate | None, tuple[Check, ...]]:
        """The estimate with how the road bends up or down along the car's way, which the tracks have just shown."""
        estimate = road.estimate
        if estimate is None or road.disparity is None or road.free is None:
            return estimate, ()
        way = curvature_of(self._tracker.motion)
        bend = bend_ahead(road.disparity, road.free, self.camera, estimate.extrinsics, self.config.lane, way)
        return dataclasses.replace(estimate, bend=bend), (
            Check("lane", "bend ahead, in pitch", float(np.rad2deg(bend[1])), unit="deg"),
        )

    def _with_lidar(self, frame: StereoFrame, result: FrameResult, road: RoadResult) -> FrameResult:
        """The same with what the frame's scan says of the road and of depth edges, where there is a scan."""
        T, config = self.T_camera_lidar, self.config
        if frame.lidar is None or T is None:
            return result
        began = time.perf_counter()
        residual = scan_residual(frame, result, T, config.road_check)
        sample = None
        if frame.left is not None and road.disparity is not None:
            over = None if result.road is None else result.road.extrinsics
            sample = sample_scan(
                *(frame.lidar, frame.left, road.disparity, self.camera, T, over),
                *(config.scan_sample, frame.lidar_sweep),
            )
        seen = None
        if frame.left is not None and frame.right is not None and road.disparity is not None:
            seen = scan_disparities(
                self.camera, frame.left, frame.right, road.disparity, frame.lidar, T,
                config.scan_disparity, result.rectification,
            )  # fmt: skip
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

    def _track(self, index: int, left: Grey, right: Grey, road: RoadResult) -> Tracks | None:
        if road.disparity is None:
            return None
        if road.estimate is not None:
            self._road = road.estimate.extrinsics
        view = PairView(index, left, right, road.disparity, self._road, road.estimate is not None)
        self._tracker, tracks = advance(self.camera, self._tracker, view, self.config.tracks)
        return tracks

    @property
    def memory(self) -> FrontEndMemory:
        """What the next step depends on, small enough to be kept beside every result."""
        view = self._tracker.view
        return FrontEndMemory(None if view is None else view.index, self._tracker.motion)

    def recall(self, frames: Iterable[StereoFrame], road: Extrinsics | None, memory: FrontEndMemory) -> None:
        """Take up a drive where another front end left it, so that the next step gives the same bits.

        frames: again all frames from the remembered pair (or the last readable one) to the last one done.
        road: the last road measured before these; None = none was.
        """
        self._road = NOMINAL if road is None else road
        for frame in frames:
            self.step(frame)
        self._tracker = dataclasses.replace(self._tracker, motion=memory.motion)

    def stages(self, frame: StereoFrame) -> RoadStages | None:
        """Every intermediate picture of one pair, for display; None where there is no disparity to show."""
        if frame.left is None or frame.right is None or frame.failure is not None:
            return None
        road = estimate_road(frame.left, frame.right, self.camera, self.config, self.matcher)
        return road_stages(road, self.config)


def road_stages(road: RoadResult, config: PipelineConfig) -> RoadStages | None:
    """The display form of a `RoadResult`."""
    if road.disparity is None or road.u_counts is None or road.free is None or road.obstacles is None:
        return None
    bin_px = config.free_map.bin_px
    bins = len(road.u_counts)
    values = road.disparity.values
    profile = None if road.paper is None else (road.paper.profile.slope, road.paper.profile.intercept_px)
    return RoadStages(
        disparity=road.disparity,
        bin_px=bin_px,
        u_disparity=road.u_counts,
        v_disparity=v_disparity(values, road.free, bin_px, bins),
        v_disparity_whole=v_disparity(values, values > 0, bin_px, bins),
        obstacles=road.obstacles,
        free=road.free,
        road=np.zeros_like(road.free) if road.road is None else road.road,
        profile=profile,
        paper=None if road.paper is None else road.paper.extrinsics,
        estimate=road.estimate,
        failure=road.failure,
        checks=road.checks,
    )
