"""Settings of what is seen in one stereo pair: pictures, disparity, free map, profile, lane, direct alignment."""

from __future__ import annotations

from typing import Literal

from pydantic.dataclasses import dataclass

from stereocalib_core.config.bend import BendConfig
from stereocalib_core.config.strict import STRICT


@dataclass(frozen=True, config=STRICT)
class DisparityConfig:
    """Dense matching. `scale` 2 matches at half resolution, 1 at full."""

    matcher: str = "sgbm"
    """Which matcher: a name in `front.matching.MATCHERS`, or MODULE:NAME of a Python module."""
    scale: Literal["auto", 1, 2, 4, 8] = "auto"
    """Picture pixels per cell; auto: as fine as `most_cells` allow."""
    most_cells: int = 320_000
    """So many cells are matched in the time of one frame on two cores: 640x480 whole, KITTI halved, 4K by eight."""
    max_disparity_px: Literal["auto"] | int = "auto"
    """Largest disparity searched, in full-resolution pixels; auto: that of the nearest road in the picture."""
    margin: float = 1.5
    """Auto searches so many times the nearest road's disparity: what stands on the road is nearer than it."""
    block_size: Literal[1, 3, 5, 7, 9, 11] = 3
    small_step_penalty: int = 8
    """SGBM's P1. The matcher's downward pass drags each row towards the disparity of the row above, and a road
    grows nearer row by row: the usual 200 costs 0.25 px of disparity (0.06 deg of pitch), 8 costs 0.02 px."""
    large_step_penalty: int = 600
    """SGBM's P2."""
    min_valid_fraction: float = 0.10
    """Fewer valid pixels than this below the middle row: NO_DISPARITY."""


@dataclass(frozen=True, config=STRICT)
class SightConfig:
    """What any camera can tell of a road; see `front.sight`."""

    matcher_noise: float = 0.15
    """1 sigma of the matcher's disparity, in cells of its grid (semi-global matching with parabola fit on road)."""
    most_noise: float = 0.016
    """The road is followed to where the matcher's noise is this share of its disparity, and of the camera's height."""
    least_disparity: float = 12.0
    """Cells nearer to infinity than so many sigmas of the matcher tell nothing of a plane."""
    least_reach: float = 3.0
    """... but always to so many times the nearest visible road."""
    lane_far_m: float = 20.0
    """... and no farther than this otherwise: the lane that a road's plane is meant for."""
    heights_per_baseline: float = 1.4
    """A pair of cameras is mounted at least so many baselines high."""
    guess_per_baseline: float = 3.0
    """Height to start from where no road is known yet, in baselines."""
    above_horizon_rad: float = 0.06
    """Matched finely to so much above the horizon of the road a moment ago, and coarsely beyond. A ramp of 18 % over
    the 20 m of a lane comes so high above a camera at 1.65 m."""
    least_rows_above: int = 8
    """Fewer cells of the coarse grid above that are not worth a map of their own."""
    most_of_width: float = 0.6
    """Largest disparity, as a share of the width, that leaves both pictures enough in common."""


@dataclass(frozen=True, config=STRICT)
class RegionConfig:
    """The road's own region."""

    candidate_cells: int = 4000
    candidates: int = 300
    """Planes tried where nothing is known; three cells are all on a road that fills a third of what is near."""
    candidates_with_past: int = 100
    refined: int = 6
    refine_rounds: int = 3
    """So many of the best are fitted to the cells on them, in so many rounds, before the best one is taken."""
    carried_frames: int = 5
    """The roads of so many frames are carried along by the odometry, to be seen from where the car is now: half a
    second, in which a car does not get beyond what it saw..."""
    carried_step: float = 0.2
    """... and each at least so many camera heights (a foot) after the one before, so that a car that stands at a
    junction still knows the road that it came along."""
    draw_within: float = 0.3
    """Cells are drawn by area, fading beyond the distance within which so many of them lie."""
    way_side_m: float = 2.0
    """Road counts less to the side of the car's way, by half at this distance: a car is 2 m wide."""
    half_width_m: float = 6.0
    """Farther from the way is another road."""
    half_strip_m: float = 1.75
    """The strip ahead whose cover is told: a lane."""
    least_share_ahead: float = 0.08
    """Less of the strip ahead is road: NO_ROAD, for what is seen is a pavement as likely. A twelfth of a lane is four
    square metres, half of a car. Chosen on a junction of a rendered drive where a car hides the road, and on real
    streets, which show 0.09 at least."""
    least_share_carried: float = 0.02
    """... and this where the road carried along says that it is no pavement: a square metre."""
    kerb: float = 0.04
    """Higher or lower than the road carried along by so many camera heights (6.6 cm on a car) is beyond a kerb: twice
    what unevenness and both measurements make of it. Kerbs are 8 to 14 cm high."""
    leans_below: float = 0.3
    """A region that covers less of the strip is looked for again at the road carried along where it leans from that by
    more than two sigmas."""
    min_share_ahead: float = 0.2
    """Less of the strip straight ahead is road: the strip along the car's way is meant, where more of that is."""
    near_length: float = 1.3
    """Road counts less ahead, by half at so many times the nearest visible road."""
    candidate_tolerance_m: float = 0.03
    """A cell counts for a candidate plane the less the farther it is off, nothing from here on: kerbs are 0.1 m high,
    and a plane halfway between road and pavement must not win by having both."""
    tolerance_m: float = 0.05
    tolerance_of_height: float = 0.03
    """A cell is on the plane within this height, or this share of the camera's, whichever is less (kerbs are 0.1 m);"""
    tolerance_noise: float = 2.0
    """... but at least within so many sigmas of the matcher."""
    below_weight: float = 0.25
    """What a cell below a candidate plane takes away; one on it adds half on the average. A road has only mismatches
    below."""
    past_height: float = 0.035
    past_pitch_rad: float = 0.0175
    past_roll_rad: float = 0.0227
    """How far a rig's own road lies from that of a moment ago, 1 sigma: the body's swing with the road's own shape,
    half a degree of which over the 6 m to the near road is 3.5 % of the height. Chosen with `below_weight` on
    Karlsruhe, 03, 0005 and a rendered turn of seed 5; judged on other seeds and drives."""
    carried_height: float = 0.02
    """How much higher or lower the nearest road in the picture lies than the road carried along, 1 sigma, in camera
    heights: unevenness and what both were measured by, 3 cm on a car. A kerb is four times as high."""
    carried_pitch_rad: float = 0.0087
    carried_roll_rad: float = 0.0114
    """How far a road leans from the one carried along, 1 sigma: half of what a rig's own does, for the body's swing is
    known. Chosen on a rendered junction before a pavement; judged on 03, Karlsruhe, 0005 and other seeds."""
    past_less: float = 0.5
    """A plane that is the rig's by its stand of a moment ago, but not the road then seen carried along, needs so much
    more road. At a junction the pavement beyond may lie as high as the road that the car came along."""
    past_frames: int = 15
    """The road of a moment ago is the median of so many frames (1.5 s at 10 Hz: longer than the body swings)..."""
    least_past: int = 3
    """... and of so many at least."""
    least_driven: float = 1.0
    """... and before the car has driven so many camera heights, over which a quarter of the near road is another, they
    are one look, repeated."""
    least_travel: float = 0.06
    """Between two pairs, in camera heights: less shows no direction."""
    straight_per_m: float = 0.01
    """Curvature below which the car goes where it points: over a lane of 20 m it leaves it by its width at most."""
    most_slope: float = 0.18
    most_curvature_per_m: float = 0.15
    """What a mounting yaw (10 deg) and a car's steering (6.7 m) can make of the way."""
    least_likeness: float = 0.02
    """A plane far from the past needs so much more road: a knocked rig finds none on the old one."""
    pinhole_cells: int = 5
    rounds: int = 3
    tukey: float = 4.5
    min_cells: int = 200
    bins_per_near: float = 5.0
    bin_share: float = 0.1
    """A stretch of the strip, a fifth of the nearest distance long, is road where so much of it is in the region."""


@dataclass(frozen=True, config=STRICT)
class FreeMapConfig:
    """Obstacles by u-disparity."""

    bin_px: float = 1.0
    """Width of a disparity bin."""
    road_height_m: float = 2.0
    """A camera at most this high over a road: sets how many rows the road itself puts into a bin."""
    road_margin: float = 1.5
    """How much more than the road's own rows makes an obstacle."""
    obstacle_height_m: float = 0.25
    """Lower things are not told from the road."""


@dataclass(frozen=True, config=STRICT)
class ProfileConfig:
    """Road profile and roll of the paper."""

    min_height_m: float = 0.5
    max_height_m: float = 3.0
    max_pitch_rad: float = 0.19
    min_disparity_px: float = 8.0
    """Farther cells are not used."""
    corridor_half_width_m: float = 3.0
    """Cells farther to the side are not used: roads are cambered."""
    search_slopes: int = 48
    """Heights tried between the smallest and the largest, evenly in their logarithm."""
    search_cells: int = 2000
    """Cells that vote for the first line."""
    search_relative_tolerance: float = 0.06
    """Half width of the band about the first line, as a share of disparity: a rolled road is a wedge."""
    relative_tolerance: float = 0.02
    tolerance_px: float = 1.0
    rounds: int = 6
    min_inliers: int = 300
    roll_half_width_m: float = 3.0
    """Roll needs width more than the profile does: cells this far to the side vote."""
    roll_min_disparity_px: float = 20.0
    roll_tolerance_px: float = 1.5
    roll_trials: int = 40
    correlated_cells: float = 12.0
    """Neighbouring cells share their error: so many count as one."""
    systematic_height_m: float = 0.008
    systematic_pitch_deg: float = 0.05
    systematic_roll_deg: float = 0.07
    """1 sigma that averaging does not remove: the camber and twist of roads, which one line and one slope take in."""


@dataclass(frozen=True, config=STRICT)
class DirectConfig:
    """Direct alignment of the road plane."""

    near_m: float = 4.0
    far_m: float = 20.0
    lane_half_width_m: float = 1.75
    """The lane that the plane is meant for: so far to the side, from `near_m` to `far_m`."""
    fit_half_width_m: float = 2.4
    """The road beside the lane helps to tell roll from camber, as far as this."""
    wide_half_width_m: float = 5.0
    """... and as far as this where the lane itself is hardly road: in turns, beside kerbs."""
    wide_below: float = 0.3
    """Less of the strip about the car's way in the road's region: the wide fit."""
    uneven_beside: float = 0.008
    """How much the bends of the lane may be off beside it, 1 sigma, m of height per m."""
    break_beside: float = 0.008
    """By how much the road's slope across may break at either edge of the lane, all along it, 1 sigma [m per m].
    Source: from lane to lane it changes by 0.005 to 0.01 (TxDOT, Roadway Design Manual, Pavement cross slope); a crown,
    of 0.04 and more, is off the plane."""
    patch_half_width_px: int = 6
    patch_half_height_px: int = 3
    pinhole_cells: int = 5
    """Holes of the free map up to this size are not an edge."""
    min_solid: float = 0.9
    """Smaller shares of a patch on the free map: it hangs over an edge."""
    iterations: int = 3
    robust_rounds: int = 3
    tukey: float = 4.5
    """Residuals beyond so many robust sigmas are rejected."""
    min_scale: float = 0.7
    min_chi2: float = 0.6
    """Residuals smaller than their noise make no fit surer than this share of its variance."""
    noise_floor_px: float = 0.01
    noise_shared_px: float = 0.007
    """What patches side by side have in common, 1 sigma: reading between pixels errs by where between them one reads,
    and that is the same all along a row of a road. Measured on `straight` by four cameras (0.006 to 0.008, beyond what
    single patches err by); judged on the town and `curves`."""
    initial_unevenness_m: float = 0.004
    max_unevenness_m: float = 0.008
    """A rougher road is weighted as if it were this rough, so that its near part keeps its say."""
    max_unevenness_wide_m: float = 0.025
    """The same where the whole region is meant: crossings, ruts and gutters are of this size."""
    uneven_length_m: float = 1.5
    """Road heights closer than this rise and fall together."""
    min_bend_m: float = 0.0003
    max_bend_m: float = 0.02
    bend_sizes: int = 7
    """Camber, twist and bend along the lane are tried at so many sizes between smallest and largest, 1 sigma."""
    bend_reluctance: float = 0.5
    """A size is expected beforehand in proportion to its inverse to this power: most roads are nearly flat."""
    further_of_bends: float = 0.3
    """The next bends are expected to be so large against the fitted ones: 0.3, 0.5 and 1 were tried on turns and humps
    of the town and on bends of `curves`, both of seed 5; judged on other seeds."""
    further_bend_m: float = 0.0003
    further_per_twist: float = 1.1
    further_per_along: float = 1.0
    further_per_roughness: float = 1.0
    further_unseen_m: float = 0.004
    """How large the bends are beyond those, 1 sigma: at least the first; more with the fitted twist, with
    the fitted bend along the lane (as large again: guessed), with the roughness that is left, and with the share of the
    lane out of sight (all of it: the last)."""
    other_side_rad: float = 0.05
    """1 sigma of roll (2.9 deg) where nothing of the lane that is seen lies on the plane, falling with the cube of that
    share. Physics: roads fall by 2.5 % to either side of their crown (RAS-Q, AASHTO: 2 to 2.5 %), 5 % from one side to
    the other. The cube: tuned on the snowy street of Karlsruhe, checked on the LiDAR of another city."""
    turning_roll_rad: float = 0.0144
    """1 sigma of roll (0.83 deg) added where the lane is that of a turn. Physics: a crossfall of 2.5 % to either side,
    and anything between, evenly."""
    alone_planar: tuple[float, float] = (0.9, 0.77)
    """A pair with nothing before it can't tell its road from what lies beside: from the first share of the lane's cells
    on the plane down to the second, what follows is added to its sigma. Chosen on Karlsruhe, each of whose frames
    was looked at alone; judged on 03, 06, 0005 and 0009."""
    alone_pitch_rad: float = 0.009
    alone_roll_rad: float = 0.023
    """1 sigma (0.5 and 1.3 deg) then: the lane's own road lies as far from a plane on one side of its crown, or on a
    bank of snow beside it. Told, and not held against the limits: it may well be the road."""
    min_patches: int = 25
    """Numerical: five for each of the five unknowns; whether they are enough sigma says."""
    agree_height_m: float = 0.06
    rough_range: float = 2.0
    """... times the nearest road in the picture is near;"""
    rough_range_m: float = 12.0
    """that distance for KITTI's camera, used where no region is known."""
    max_roughness_m: float = 0.035
    """Rms height over the plane up to `rough_range_m`; more (a speed hump at the bumper): NOT_PLANAR."""
    min_agreement: float = 0.75
    """A smaller share of the lane's patches within `agree_height_m`: NOT_PLANAR."""


@dataclass(frozen=True, config=STRICT)
class LaneConfig:
    """The lane in front of the car, and which cells of it agree with a plane."""

    near_m: float = 4.0
    far_m: float = 20.0
    half_width_m: float = 1.75
    agree_height_m: float = 0.06
    agree_px: float = 0.9
    """A cell agrees within this height or this disparity, whichever is more."""
    bend: BendConfig = BendConfig()


@dataclass(frozen=True, config=STRICT)
class ImageConfig:
    """What a picture needs before it is looked at; grey levels 0...255 of the lower half."""

    min_mean: float = 10.0
    """Darker: DARK."""
    max_saturated: float = 0.6
    """More pixels at 254 or above: SATURATED."""
    min_gradient: float = 0.8
    """Mean absolute horizontal difference [grey levels per px]; less: FLAT_TEXTURE."""


@dataclass(frozen=True, config=STRICT)
class LimitsConfig:
    """Where an estimate is not believed: OUT_OF_RANGE, TOO_UNCERTAIN (1 sigma)."""

    min_height_m: float = 0.15
    max_height_m: float = 5.0
    max_pitch_rad: float = 0.6109
    """35 deg."""
    max_roll_rad: float = 0.4363
    """25 deg."""
    max_height_sigma: float = 0.05
    """As a share of the height."""
    max_pitch_sigma_rad: float = 0.0105
    max_roll_sigma_rad: float = 0.0262
