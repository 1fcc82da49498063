"""Settings of the LiDAR: its check against the stereo road, and what is kept of a scan to hold edges against edges."""

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


@dataclass(frozen=True, config=STRICT)
class ScanSampleConfig:
    """What is kept of a scan and of the pictures of the same moment, to compare depth edges and surfaces."""

    least_disparity_px: float = 4.0
    """Farther things are left out: the matcher's 0.25 px are 6 % of their depth, near hardly differs from far."""
    jump_px: float = 1.5
    """Depth breaks where the disparity does by at least this: six times the matcher's noise of 0.25 px. The same for
    the scan, so that both sides keep the same edges."""
    jump_share: float = 0.12
    """And by this share of the nearer disparity: less is a slanted surface as often as an edge."""
    reach_px: int = 5
    """The picture's contrast is looked for so far from the break in the disparity: half the matcher's window and the
    smoothing over two half-size pixels."""
    row_px: int = 4
    """Picture edges are kept on every so many rows: beams are 0.4 deg or 5 px apart, closer rows repeat each other."""
    margin: float = 0.06
    """What of the scan lies outside the picture by less than this share of its width is kept: so far may the
    calibration be off (1.5 deg and 10 cm at 5 m are 30 px of 1242)."""
    beam_step_deg: float = 0.5
    """Neighbours of one beam are at most this far apart; spinning LiDARs step by 0.1 to 0.4 deg."""
    beam_tilt: float = 0.01
    """And of the same elevation within this (sine): beams leave some centimetres beside the LiDAR's origin, so that one
    and the same is up to 0.5 deg higher near by than far away."""
    least_range_m: float = 0.5
    """Nearer returns are the car itself."""
    straight_m: float = 0.1
    """Neighbours of one beam on a surface are off a straight line by less: three sigma of 0.03 m of range noise."""
    point_every: int = 7
    """So many smooth points pass before the next is kept: neighbours see the same surface."""
    patch_px: int = 16
    """Surfaces of the picture are squares of this size."""
    patch_rms_px: float = 0.5
    """Twice the matcher's noise; more is no plane."""
    patch_share: float = 0.8
    """Known disparity in at least this share of the square."""
    clear_of_road_m: float = 0.3
    """Surfaces are kept from this height over the road."""
    most_edges: int = 1200
    """Of a scan and of a picture: keeps a frame at some 25 kB."""
    most_points: int = 400
    """The same for points and patches."""
