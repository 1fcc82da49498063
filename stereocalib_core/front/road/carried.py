"""The road of a moment ago: by the rig's own stand, and the road itself carried along by the odometry.

At a junction the pavement beyond may lie as high as the road that the car came along, planar, connected and larger than
what is left to be seen of the road before it. What tells it is the step between them: the road carried along says
where the road was, and a kerb lies as high above it as no body on springs dives.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stereocalib_core.config import RegionConfig
from stereocalib_core.front.sight import road_disparity
from stereocalib_core.geometry import Extrinsics, StereoCamera
from stereocalib_core.numeric.arrays import Array


@dataclass(frozen=True)
class Past:
    """The road of a moment ago. stand: by the rig, as it stood over the last ones. carried: that road itself, as it is
    seen from where the car is now. None = not known. driven: the car has moved since the first pair; one that stands
    sees the same again and again, and is none the wiser.
    """

    stand: Extrinsics | None = None
    carried: Extrinsics | None = None
    driven: bool = True

    @property
    def known(self) -> tuple[Extrinsics, ...]:
        """Those that are."""
        return tuple(e for e in (self.stand, self.carried) if e is not None)


NOTHING = Past()


@dataclass(frozen=True)
class Moved:
    """How the car came since the pair before. travel_m: how far. swing_rad: how far off the pitch may be by which the
    road was carried along: by how much it turned more than between the two pairs before.
    """

    travel_m: float = 0.0
    swing_rad: float = 0.0


def likeness(rig: Array, past: Past, nearest_m: float, config: RegionConfig) -> Array:
    """(K,) how likely rigs (K, 3) are after `past`, by the kinder: 1 = the same, at least `least_likeness`.

    The rig's stand counts less by `past_less` where the road itself is carried along. A body that dives, a crest or a
    ramp tilt that road about where it is nearest, `nearest_m` [m] ahead; what is higher or lower there is a pavement,
    or lies beneath one. Rigs get knocked. Where nothing is known all are as likely.
    """
    if not past.known:
        return np.ones(len(rig))
    likely = np.full(len(rig), config.least_likeness)
    if (stand := past.stand) is not None:
        off = rig - [stand.height_m, stand.pitch_rad, stand.roll_rad]
        off /= [config.past_height * stand.height_m, config.past_pitch_rad, config.past_roll_rad]
        less = 1.0 if past.carried is None else config.past_less
        likely = np.maximum(likely, less * np.exp(-0.5 * np.sum(off**2, axis=1)))
    if (carried := past.carried) is not None:
        off = rig - [carried.height_m, carried.pitch_rad, carried.roll_rad]
        off[:, 0] = steps(rig, carried, nearest_m, config)
        off /= [config.carried_height * carried.height_m, config.carried_pitch_rad, config.carried_roll_rad]
        likely = np.maximum(likely, np.exp(-0.5 * np.sum(off**2, axis=1)))
    return likely


def nearest_of(road: Extrinsics | None, camera: StereoCamera) -> float:
    """How far ahead [m] a road comes into the picture; 0 for none."""
    if road is None:
        return 0.0
    return camera.focal_px * camera.baseline_m / max(road_disparity(camera, road), 1.0)


def steps(rig: Array, carried: Extrinsics, nearest_m: float, config: RegionConfig) -> Array:
    """(K,) how much lower [m] than the road carried along those of rigs (K, 3) lie where they are nearest."""
    about_m = config.near_length * nearest_m
    return np.asarray(rig[:, 0] - carried.height_m - about_m * (rig[:, 1] - carried.pitch_rad))


def step_of(road: Extrinsics, carried: Extrinsics, camera: StereoCamera, config: RegionConfig) -> float:
    """The same of one road, in camera heights."""
    rig = np.array([[road.height_m, road.pitch_rad, road.roll_rad]])
    return float(steps(rig, carried, nearest_of(carried, camera), config)[0]) / carried.height_m
