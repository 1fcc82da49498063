"""What the frames before say of the next one's road: how the rig stood over the last ones, those roads themselves
carried along by the odometry, and the way that the car goes."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection

import numpy as np

from stereocalib_core.config import PipelineConfig, RegionConfig
from stereocalib_core.front.car_way import carried_on, heading_of, way_of
from stereocalib_core.front.own_car import OwnCar
from stereocalib_core.front.road.carried import Moved
from stereocalib_core.front.road.estimate import Hint
from stereocalib_core.geometry import Extrinsics, StereoCamera
from stereocalib_core.numeric.arrays import Array


class RoadsBehind:
    """Told of every pair that was tracked, in order; gives the `Hint` for the next.

    Motions are (6,) of T_current_previous per frame, rotation vector [rad] and translation [m]; None = not known.
    """

    def __init__(self, camera: StereoCamera, config: PipelineConfig) -> None:
        self._region: RegionConfig = config.region
        self._guess = Extrinsics(config.sight.guess_per_baseline * camera.baseline_m, 0.0, 0.0)
        self._road: Extrinsics | None = None
        self._past: deque[Extrinsics] = deque(maxlen=self._region.past_frames)
        self._headings: deque[float] = deque(maxlen=self._region.past_frames)
        self._carried: list[Extrinsics | None] = []
        self._at = 0
        self._motion: Array | None = None
        self._since_kept_m = self._driven_m = 0.0
        self._pitching: tuple[float, float] = (0.0, 0.0)

    @property
    def standing(self) -> Extrinsics:
        """The last road measured, or a guess where none was: cameras stand some baselines high."""
        return self._road or self._guess

    @property
    def past(self) -> Extrinsics | None:
        """The median of the last roads as the rig saw them, where there are enough."""
        return self._median(self._past)

    def hint(self, index: int, own: OwnCar | None) -> Hint:
        """Where the road of frame `index` is likely to be. own: what of the picture is the own car."""
        region = self._region
        way = way_of(self._motion, self.standing.height_m, region)
        heading = float(np.median(self._headings)) if len(self._headings) >= region.least_past else 0.0
        # the car goes on as it went between the last two pairs
        motion = self.motion_to(index, self._motion)
        carried = self._carried if motion is None else carried_on(self._carried, motion)
        kept = self._median([road for road in carried if road is not None])
        swing_rad = (self._pitching[1] - self._pitching[0]) * max(index - self._at, 1)
        driven = self._driven_m >= region.least_driven * self.standing.height_m
        return Hint(self.past, kept, way, heading, Moved(_length_m(motion), swing_rad), driven, own)

    def saw(self, road: Extrinsics | None) -> None:
        """The road of a pair that is about to be tracked, None where it shows none."""
        if road is not None:
            self._road = road
            self._past.append(road)

    def went(self, index: int, motion: Array | None, road: Extrinsics | None) -> None:
        """The motion into a pair, and its road: the roads before are seen from it now, or from nowhere.

        A car that stands sees the same bit of road again and again: its own is kept for every step of the way.
        """
        self._pitching = (self._pitching[1], 0.0 if motion is None else float(motion[0]))
        whole = self.motion_to(index, motion)
        self._at, self._motion = index, motion
        self._carried = [] if whole is None else carried_on(self._carried, whole)
        self._since_kept_m += _length_m(whole)
        self._driven_m += _length_m(whole)
        most, step_m = self._region.carried_frames, self._region.carried_step * self.standing.height_m
        if len(self._carried) < most or self._since_kept_m >= step_m:
            self._carried = [*self._carried, road][-most:]
            self._since_kept_m = 0.0
        heading = heading_of(motion, self.standing.height_m, self._region)
        if heading is not None:
            self._headings.append(heading)

    def motion_to(self, index: int, motion: Array | None) -> Array | None:
        """(6,) from the last pair that was tracked to frame `index`, of the motion per frame."""
        return None if motion is None else motion * max(index - self._at, 1)

    def _median(self, roads: Collection[Extrinsics]) -> Extrinsics | None:
        if len(roads) < self._region.least_past:
            return None
        rig = np.median([(e.height_m, e.pitch_rad, e.roll_rad) for e in roads], axis=0)
        return Extrinsics(*(float(x) for x in rig))


def _length_m(motion: Array | None) -> float:
    return 0.0 if motion is None else float(np.linalg.norm(motion[3:]))
