"""Settings of the LiDAR's check against the stereo road."""

from __future__ import annotations

from pydantic.dataclasses import dataclass

from stereocalib_core.config.strict import STRICT


@dataclass(frozen=True, config=STRICT)
class RoadCheckConfig:
    """The LiDAR's road against the stereo road: the lane, the tolerance of the calibration, and the alarm."""

    near_m: float = 4.0
    far_m: float = 20.0
    lane_half_width_m: float = 1.75
    """Roads are cambered: beyond the car's own lane two sensors that sample differently see different planes."""
    max_tilt_deg: float = 5.0
    """A LiDAR turned further against the stereo road is not looked for."""
    max_offset_m: float = 0.3
    """The same for its height at the camera."""
    even_m: float = 12.0
    """Up to here both sensors weigh the road evenly; beyond it stereo noise takes over."""
    obstacle_cell_m: float = 0.35
    obstacle_height_m: float = 0.2
    """Points of one cell that reach over more than this are no road."""
    vote_points: int = 400
    vote_trials: int = 160
    agree_height_m: float = 0.04
    """A point agrees with a plane within this height; no plane fits road and kerb as closely."""
    min_agreement: float = 0.6
    """A smaller share of the lane's area on the plane is no road: a car ahead, a kerb."""
    tukey: float = 4.0
    """Heights beyond so many robust sigmas are rejected."""
    min_spread_m: float = 0.004
    rounds: int = 8
    min_points: int = 60
    cell_m: float = 0.7
    """Heights closer than this rise and fall together."""
    min_cells: int = 15
    systematic_height_m: float = 0.003
    """1 sigma of the scan's plane that more points do not remove: each beam has an error of its own."""
    systematic_angle_deg: float = 0.02
    limit_height_m: float = 0.04
    """A calibration whose residual lies beyond the limits by `certain_sigmas` raises the alarm."""
    limit_pitch_deg: float = 0.25
    limit_roll_deg: float = 0.5
    certain_sigmas: float = 3.0
    least_height_m: float = 0.025
    """Smaller steps are not reported."""
    least_pitch_deg: float = 0.2
    least_roll_deg: float = 0.3
    step_sigmas: float = 6.0
    min_frames: int = 5
    """Fewer residuals say nothing of a drive."""
    window: int = 20
    """Frames on either side of a step that are held against each other; the alarm comes within so many."""
    settled: int = 10
    """Frames after a step before it counts."""
    correlated_frames: float = 5.0
    """Residuals of neighbouring frames share their error: so many count as one."""
    wander_height_m: float = 0.001
    """How far a sound mounting may creep in a second, 1 sigma; it grows with the root of time."""
    wander_angle_deg: float = 0.01
