"""Settings of the LiDAR: its check against the stereo road, and what is kept of a scan to hold edges against edges."""

from __future__ import annotations

from pydantic.dataclasses import dataclass

from stereocalib_core.config.strict import STRICT, Share


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
    least_change: float = 1e-5
    """A round that changes the plane by less [m, and m/m] is the last: a hundredth of its sigma."""
    min_points: int = 60
    cell_m: float = 1.5
    """Heights closer than this rise and fall together: as `DirectConfig.uneven_length_m`, and a patch is as long."""
    min_cells: int = 8
    """Fewer say nothing of how sure three unknowns are."""
    systematic_height_m: float = 0.003
    """1 sigma of the scan's plane that more points do not remove: each beam has an error of its own."""
    systematic_angle_deg: float = 0.05
    """The same of its angles: a body that pitches by 5 deg/s between laser and shutter, 10 ms apart."""
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


@dataclass(frozen=True, config=STRICT)
class LidarAlignmentConfig:
    """All six between LiDAR and camera from depth edges, surfaces and the road, stretch by stretch."""

    widths_px: tuple[float, ...] = (12.0, 8.0, 5.0, 3.0, 2.0)
    """Gauss curves by which edges are matched along a row, coarse to fine. The first reaches what the search for yaw
    leaves: half its step and 10 cm at 5 m, 14 px; the last is the spread of true matches on real drives (2.3 px)."""
    borne_out: Share = 0.5
    """The camera has moved if its own path jumps by the size of a slip, within this share of it; the LiDAR, if it jumps
    by less than this share. Physics: the nearer of the two."""
    quiet_share: Share = 0.2
    """... and the path around it is quieter than this share, 1 sigma: a jump of half the size is then 2.5 sigma."""
    near_widths: int = 3
    """So many of them, the last, where a stretch near by is known: 5 px catch a slip of 1 deg (12 px) in its tails."""
    rounds: int = 3
    """Gauss-Newton steps at each width."""
    row_tolerance_px: float = 3.0
    """Matches lie within so many rows: edges are kept every 4 px."""
    disparity_tolerance_px: float = 1.0
    """1 sigma by which the disparities of a match differ: of a break in the disparity, four times that of a surface."""
    disparity_tolerance_share: float = 0.05
    """And as a share of the disparity: the near side of an edge need not face the camera."""
    half_contrast: float = 8.0
    """Contrast [grey/px] at which a picture edge counts for half: a step of 30 grey, well above the noise of 2."""
    background: float = 0.3
    """How likely no match is against a match at its best: some 15 % of beam edges find one on real drives, of the three
    or so picture edges within reach."""
    surfaces_from_px: float = 3.0
    """Surfaces join when edges are matched this closely: before that, points fall on the wrong surface."""
    patch_half_px: float = 8.0
    """Half of the square over which a surface of the picture was fitted (`scan_sample.patch_px`)."""
    surface_sigma_px: float = 0.5
    """1 sigma of a surface's disparity: twice the matcher's noise, since the whole square shares its error."""
    surface_most_px: float = 4.0
    """Points farther off are of something else."""
    thing_m: float = 1.0
    """All in one square of the ground of this size is one thing, with one error: a trunk, the corner of a car."""
    correlated_frames: float = 5.0
    """So many road residuals count as one, as in the road's own check."""
    prior_angle_deg: float = 2.0
    """1 sigma of what a LiDAR may be off before it is looked at: wide enough to say nothing where edges do."""
    prior_length_m: float = 0.2
    prior_edge_px: float = 2.0
    """1 sigma by which scan and picture may differ in how wide things are: a beam of 0.1 deg, the matcher's window."""
    prior_offset_px: float = 1.0
    """1 sigma of a disparity offset: 0.08 deg between the two cameras."""
    matcher_bias_px: float = 0.2
    """1 sigma by which the dense matcher differs from the tracks, where these show the offset: on a perfect road it is
    off by so much, since it locks to whole pixels of its half-size pictures."""
    prior_scale: float = 0.02
    """1 sigma of a scale of disparity: focal length or baseline wrong by 2 %."""
    known_sweep_sigma: float = 0.0005
    """1 sigma of how far the LiDAR turns from frame to frame where it is known: so small that it stays, against many
    thousand edges that each count in full on the way to the solution."""
    stated_sweep: float = 0.9
    """How likely the sense of rotation is that a recording states, beforehand: KITTI's description says counter-
    clockwise, those who undo it turn the other way and find their paths better for it."""
    sweep_scans: int = 40
    """Scans by which it is found where it is not known."""
    lost_share: float = 0.7
    """A stretch that matches by less than this share of what stretches do is looked for afresh: edges differ from
    street to street by a third, and a LiDAR 1 deg off matches a quarter."""
    search_yaw_deg: float = 2.0
    """Yaw is looked for this far to either side."""
    search_steps: int = 21
    """In so many steps: 0.2 deg or 2.5 px, half of `search_width_px`."""
    search_width_px: float = 5.0
    search_scans: int = 15
    """And by so many scans, evenly chosen."""
    systematic_px: float = 0.25
    """1 sigma of an edge that more edges do not remove: a quarter of a pixel, as an angle, and as a shift at
    `systematic_range_m`."""
    systematic_range_m: float = 15.0
    """Where the things are that tell x and z."""
    stretch_scans: int = 30
    """Three seconds at 10 Hz: some 200 things pass by."""
    hop_scans: int = 10
    """A slip is looked for at every so many scans."""
    least_scans: int = 10
    """Fewer say nothing of yaw, x and z."""
    most_scans: int = 90
    """Of a longer part so many are used, evenly chosen: the rest repeats them."""
    most_slips: int = 6
    """After as many the LiDAR is loose, and where it was when is of no use."""
    least_slip_deg: float = 0.1
    """Smaller slips in angle are not reported: 1.2 px, half the spread of edges."""
    least_slip_m: float = 0.025
    """The same for shifts: as the road's check has it for height."""
    slip_sigmas: float = 4.0
    """A slip stands out by so many sigma: by chance once in 16,000 looks, where a drive of 1,000 scans has 600."""
    most_sigma_deg: float = 0.1
    """Yaw known less well than this is not given."""
    most_sigma_m: float = 0.05
    """The same for x and z."""
    least_things: int = 30
    """Fewer things than this show no yaw: an open road."""
    least_distinct: float = 3.0
    """Edges match where they were found to this many times as well as at other yaws. Chosen on scans put to pictures of
    other moments, which reach 2.6, against those of the same moment on the same drives (two real, one rendered), which
    start at 5.6."""
    limit_yaw_deg: float = 0.25
    """A calibration off by more than this from the start, by `certain_sigmas`, raises the alarm: as for pitch."""
    limit_shift_m: float = 0.08
    """The same for x and z: what calibrations by targets differ by from each other."""
    certain_sigmas: float = 3.0
    told_frames: int = 5
    """Who has slipped is told by the camera's path this near the slip."""
