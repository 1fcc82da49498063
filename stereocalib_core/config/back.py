"""Settings of what the whole drive says of the rig: the pair's own rows, filter, yaw, shifts of the mount."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field
from pydantic.dataclasses import dataclass

from stereocalib_core.config.strict import STRICT

Share = Annotated[float, Field(ge=0.0, lt=1.0)]


@dataclass(frozen=True, config=STRICT)
class RectificationConfig:
    """The pair's self-check by the rows of its matches."""

    search_px: float = 128.0
    """Largest disparity searched; 0.4 of it is searched beyond infinity, where only a swapped pair matches."""
    search_rows_px: int = 40
    """Rows searched up and down when few corners match on their own rows."""
    clear_fraction: float = 0.3
    """Fewer of the corners matched than this: search the rows as well."""
    min_matches: int = 12
    """Fewer matches say nothing of a frame."""
    min_frames: int = 3
    """Fewer frames say nothing of a drive."""
    window: int = 15
    """Frames over which a change within the drive is looked for."""
    suspect_pitch_deg: float = 0.045
    suspect_roll_deg: float = 0.06
    bad_pitch_deg: float = 0.15
    bad_roll_deg: float = 0.25


@dataclass(frozen=True, config=STRICT)
class RoadPointsConfig:
    """The road by the tracked points on it, and when the filter leans on that."""

    near_m: float = 4.0
    far_m: float = 20.0
    lane_half_width_m: float = 1.75
    min_points: int = 20
    noise_px: float = 0.15
    unevenness_m: float = 0.004
    road_height_m: float = 1.65
    """A camera about this high: how much of an uneven road shows in a disparity."""
    alike: float = 4.0
    """So many neighbouring points count as one."""
    correlation: float = 0.3
    """Of the errors of the points and of the pair's own estimate."""
    min_share: float = 0.7
    """The points are used where they are so much surer that they would count for this share."""
    gate: float = 3.0
    """Contradiction, in sigmas of both, by which neither is believed."""


@dataclass(frozen=True, config=STRICT)
class FilterConfig:
    """The filter over height, pitch and roll. Body sizes are standard deviations about the rest pose."""

    natural_hz: float = 1.4
    damping: Share = 0.35
    """Of the critical one."""
    body_height_m: float = 0.006
    body_pitch_deg: float = 0.12
    body_roll_deg: float = 0.10
    rest_height_m: float = 0.004
    """How far the rest pose may wander in a second (braking, curves); it grows with the root of time."""
    rest_angle_deg: float = 0.15
    memory_s: float = 2.0
    """Over which the sizes of body motion and measurement noise are learnt."""
    persistent_share: Share = 0.6
    """Of a frame's variance, what it shares with its neighbours: it does not average out."""
    look_ahead: bool = True
    """Use later frames as well, within each unbroken stretch; off = causal."""
    gate: float = 21.0
    """Largest squared Mahalanobis distance of a measurement (3 degrees of freedom)."""
    gate_height_m: float = 0.04
    """What a body may do between two frames besides, 1 sigma: a speed hump turns it by a degree and more."""
    gate_angle_deg: float = 0.45
    recovery_frames: int = 2
    """Gated so often in a row, the filter believes that the mount has moved."""
    road_points: RoadPointsConfig = RoadPointsConfig()


@dataclass(frozen=True, config=STRICT)
class YawConfig:
    """Mounting yaw by the vanishing point of straight travel."""

    min_travel_m: float = 0.25
    """Pairs of frames that move less show no direction."""
    min_radius_m: float = 250.0
    """Driving is straight where its curve has a larger radius."""
    min_stretch_m: float = 6.0
    min_stretch_pairs: int = 8
    min_pairs: int = 15
    min_tracks: int = 15
    """Road tracks that agree on a pair's vanishing point."""
    tolerance_px: float = 1.0
    """Largest miss of a track that agrees."""
    pair_tolerance_deg: float = 1.0
    """Largest disagreement of a pair with the drive."""
    systematic_deg: float = 0.012
    """1 sigma that more driving does not remove."""


@dataclass(frozen=True, config=STRICT)
class ShiftAlarmConfig:
    """Steps and drifts of the mount."""

    least_angle_deg: float = 0.18
    least_height_m: float = 0.018
    threshold: float = 5.5
    """A step must be so many times its standard deviation."""
    noise_angle_deg: float = 0.015
    """Least 1 sigma of what one frame brings that the frames before it did not show."""
    noise_height_m: float = 0.0015
    noise_yaw_deg: float = 0.03
    drift_factor: float = 1.25
    """A drift must be so many times the least size."""
