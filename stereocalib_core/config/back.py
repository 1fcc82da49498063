"""Settings of what the whole drive says of the rig: the pair's own rows, filter, yaw, shifts of the mount."""

from __future__ import annotations

from pydantic.dataclasses import dataclass

from stereocalib_core.config.steps import StepConfig, TurmoilConfig, YawStepConfig
from stereocalib_core.config.strict import STRICT, Floor, Share


@dataclass(frozen=True, config=STRICT)
class RowMatchesConfig:
    """Sparse matches of left and right whose rows are free."""

    cells: int = 130
    """That the picture is cut into; the strongest corner of each spreads them over all of it. What one core matches in
    some 3 ms."""
    coarse_half_px: int = 4
    """Half size of the patch that is searched in the half-size picture [px]: 8 x 8."""
    fine_radius_px: int = 6
    """... and of the one that is aligned in the whole picture [px]: 13 x 13."""
    steps: int = 8
    """Of Gauss-Newton at most. Numerical."""
    clear: Share = 0.85
    clear_of_others: Share = 0.04
    """Least correlation of a coarse match, and by how much it must be better than any elsewhere. Tuned on KITTI 06."""
    aligned: Share = 0.92
    """Least correlation once it is aligned. Tuned on KITTI 06."""


@dataclass(frozen=True, config=STRICT)
class RectificationConfig:
    """The pair's self-check by the rows of its matches."""

    matches: RowMatchesConfig = RowMatchesConfig()
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
    keystone_deg: float = 0.5
    """1 sigma of the keystone: a weak pull to zero keeps frames with matches in one half of the picture
    from trading it against the roll. Physics: no mount turns further unseen."""
    behind_px: float = 4.0
    """Nothing that a camera sees lies so far behind infinity, whatever the last pixel of its calibration."""
    overhead: float = 2.0
    """A swapped or roadless pair whose upper third is so many times as near as its lower third is upside down.
    Physics: what a vehicle's camera has nearest is the ground below it."""


@dataclass(frozen=True, config=STRICT)
class LagConfig:
    """Whether the right pictures belong to neighbouring frames."""

    most: int = 2
    """Frames by which they are tried earlier and later. A dropped picture shifts a list by one, two by two."""
    frames: int = 16
    """Frames that are asked, spread over those that failed. Numerical."""
    sigmas: float = 4.0
    """The matches must be more by so many sigmas of their counts: once in 16 000 by chance."""
    alike: float = 4.0
    """So many neighbouring matches count as one: they share their bit of scene."""
    share: float = 0.75
    """... and more in so many of the frames by themselves: a few rich frames decide nothing."""


@dataclass(frozen=True, config=STRICT)
class RoadPointsConfig:
    """The road by the tracked points on it in the own lane, and when the filter leans on that."""

    min_points: int = 20
    """Fewer points in the lane make no plane: three unknowns and an outlier in five. Numerical."""
    noise_px: float = 0.15
    """1 sigma of a tracked point's disparity [px]. Tuned on KITTI 06 and the synthetic town."""
    unevenness_m: float = 0.004
    """1 sigma of the road's height about a plane [m]. Source: ISO 8608 class A to B over the length of a lane."""
    unseen_bend_m: float = 0.008
    """How far a road bends, 1 sigma [m], where nothing of the lane along the car's way shows a point; with the square
    of the share that shows none, as a curve leaves its tangent. No camber or twist is taken for smaller. Tuned on the
    synthetic town of seed 5 and `curves`."""
    further_per_along: float = 2.0
    """How large bends are that are not fitted, of the bend along the lane that is: a bump is short, and a bend
    fitted to it a poor likeness. Tuned on the synthetic town of seed 5 and `curves`, with `persistent_share`."""
    rounds: int = 14
    """Of reweighting: the first with gentle weights, so that the first plane may be a poor one. Numerical."""
    soft_rounds: int = 4
    least_scale: float = 0.3
    """Residuals smaller than their noise make no fit surer than this share of it."""
    correlation: float = 0.3
    """Of the errors of the points and of the pair's own estimate: both see one road. Tuned on the synthetic town of
    seed 5 and on `curves`, whose errors change by a tenth between 0 and 0.6."""
    gate: float = 3.0
    """Contradiction, in sigmas of both, by which only one of them can be right."""


@dataclass(frozen=True, config=STRICT)
class NoiseBankConfig:
    """The grid of small filters by which the body's liveliness and the measurements' noise are learnt."""

    body_factors: tuple[float, ...] = (0.18, 0.35, 0.7, 1.4, 2.8)
    """On the nominal standard deviation of the body's motion: steps of two."""
    noise_factors: tuple[float, ...] = (0.35, 0.6, 1.0, 1.7, 3.0)
    """On the stated standard deviation of the measurement: steps of 1.7."""
    body_middle: float = 0.7
    """The body factor that is expected beforehand, and how sure that is, 1 sigma of its logarithm. Tuned on the
    synthetic town."""
    body_prior: float = 0.8
    noise_prior: float = 0.35
    """1 sigma of the logarithm of the noise factor beforehand: stated values are believed until the data speak."""
    surprise: float = 36.0
    """Largest squared innovation in sigmas that a model is blamed for: one wild frame must not rule it out."""


@dataclass(frozen=True, config=STRICT)
class FilterConfig:
    """The filter over height, pitch and roll. Body sizes are standard deviations about the rest pose."""

    body_height_m: float = 0.006
    """How far springs move the body in ordinary driving, 1 sigma [m], [deg]; the start of what is learnt. Source:
    KITTI 03 and 06, scatter of a calm stretch."""
    body_pitch_deg: float = 0.12
    body_roll_deg: float = 0.10
    rest_height_m: float = 0.004
    """How far the rest pose may wander in a second (braking, curves) [m], [deg]; it grows with the root of time."""
    rest_angle_deg: float = 0.15
    memory_s: float = 2.0
    """Over which the sizes of body motion and measurement noise are learnt [s]: some three swings of the body."""
    persistent_share: Share = 0.45
    """Of a frame's variance of height and pitch, what it shares with its neighbours: it does not average out before
    the car is past `alike_m`. Tuned so that two sigma cover 95 % of the errors on the synthetic town of seed 5, on
    `curves` and on a town along KITTI's poses of 07, `direct`; of values that did as well there, these suited the town
    of seed 0 too, so that its figures are no proof."""
    persistent_roll_share: Share = 0.47
    """The same of roll."""
    alike_m: float = 8.0
    """Length of way after which errors of the road are others, to 1/e [m]. Physics: the lane that a plane is fitted to
    is 16 m long; the slope of a white one would be another after a third of it, its height after all of it."""
    road_height_m: float = 0.006
    """How far roads are off a plane, as the height [m], pitch and roll [deg] that it would be: over `alike_m` the
    plane ahead changes by so much whatever the car does. Physics: roads of ISO 8608 class A to B, as for the odometry's
    floors."""
    road_pitch_deg: float = 0.06
    road_roll_deg: float = 0.1
    least_height_m: Floor = 0.0002
    least_angle_deg: Floor = 0.001
    """1 sigma of what no motion between two frames is surer than [m], [deg]. Numerical."""
    gate: float = 21.0
    """Largest squared Mahalanobis distance of a measurement (3 degrees of freedom): one in ten thousand."""
    gate_height_m: float = 0.04
    """What a body may do between two frames besides, 1 sigma [m], [deg]: a speed hump turns it by a degree and more."""
    gate_angle_deg: float = 0.45
    hump_share: Share = 0.05
    """Share of frames in which the body is as free as that, where two looks at the road contradict. Guessed: with 0.01
    and with 0.2 the errors on the synthetic town of seed 5 and on `curves` are the same to a hundredth."""
    recovery_frames: int = 2
    """Gated so often in a row, the filter believes that the mount has moved."""
    longest_step_s: float = 1.0
    """Time between two frames that is believed [s]: at least, at most."""
    shortest_step_s: float = 1e-3
    noise_bank: NoiseBankConfig = NoiseBankConfig()
    road_points: RoadPointsConfig = RoadPointsConfig()


@dataclass(frozen=True, config=STRICT)
class YawConfig:
    """Mounting yaw by the vanishing point of straight travel."""

    min_travel_m: float = 0.25
    """Pairs of frames that move less show no direction [m]."""
    min_radius_m: float = 250.0
    """Driving is straight where its curve has a larger radius [m]."""
    min_stretch_m: float = 6.0
    min_stretch_pairs: int = 8
    min_pairs: int = 15
    min_tracks: int = 15
    """Road tracks that agree on a pair's vanishing point."""
    tolerance_px: float = 1.0
    """Largest miss of a track that agrees [px]."""
    min_flow_px: float = 0.7
    """A shorter track has no direction [px]: its noise is half of it."""
    samples: int = 80
    """Intersections tried within a pair: with half of the tracks good, one is good with certainty."""
    pair_tolerance_deg: float = 1.0
    """Largest disagreement of a pair with the drive [deg]."""
    hypotheses: int = 200
    """Pairs whose yaw is tried for that of the drive, evenly by size; the mean that follows takes in all."""
    rounds: int = 20
    """Of the weighted mean over the pairs that agree; it has settled long before."""
    stray_sigmas: float = 5.0
    """A pair further off, in their own deviations, is none of them."""
    min_inlier_share: Share = 0.3
    """Of the pairs, which must agree on the yaw."""
    pair_sigma_deg: float = 0.05
    """1 sigma of the yaw of one pair [deg], for the weight of the car's assumed sway against the drive's own."""
    alike_pairs: int = 8
    """Pairs whose errors may be alike (the same stretch of road): sigma comes from means over so many."""
    systematic_deg: Floor = 0.012
    """1 sigma that more driving does not remove [deg]."""
    most_deg: float = 10.0
    """A camera that looks where the car goes is mounted with less [deg]; more comes of a principal point that is
    not that of the pictures. Source: resized pictures with the calibration they had before read 9.8 and 23 deg."""


@dataclass(frozen=True, config=STRICT)
class WheelsConfig:
    """The road under the wheels, from the planes that were seen ahead a moment ago."""

    ahead_m: float = 7.0
    """Where a pair sees the road best, ahead of the wheels [m]."""
    half_m: float = 1.5
    """Half the stretch of planes that are averaged [m]."""
    min_planes: int = 2


@dataclass(frozen=True, config=STRICT)
class MountConfig:
    """The camera's nominal mount over a drive."""

    alike_s: float = 3.0
    """Within so long the body's pose and the road's shape are one look [s]. Physics: four swings, a bend, a braking."""
    prior_blocks: float = 2.0
    """Looks that the body's usual swing counts for against the scatter of those of the drive. Numerical: with one
    look it is all there is, with twenty it hardly matters."""
    min_frames: int = 3
    """Fewer planes seen again under the wheels are left alone, and the road ahead is taken. Numerical."""
    floor_height_m: Floor = 0.001
    """1 sigma that no length of one drive removes (load, tyres, the road's own shape) [m], [deg]."""
    floor_angle_deg: Floor = 0.005


@dataclass(frozen=True, config=STRICT)
class ShiftAlarmConfig:
    """Steps and drifts of the mount."""

    least_angle_deg: float = 0.18
    """Smaller steps are not told [deg], [m]: what they do to the odometry is below its noise."""
    least_height_m: float = 0.018
    threshold: float = 5.5
    """A step must be so many times its standard deviation. Tuned on synthetic drives without a knock."""
    noise_angle_deg: float = 0.015
    """Least 1 sigma of what one frame brings that the frames before it did not show [deg], [m]."""
    noise_height_m: float = 0.0015
    noise_yaw_deg: float = 0.03
    drift_factor: float = 1.25
    """A drift must be so many times the least size."""
    horizons: tuple[int, int, int] = (15, 30, 60)
    """Frames (for the yaw: pairs on straights) after a shift by which it may be certain."""
    most_steps: int = 6
    """Steps looked for on one axis."""
    standing_m_s: float = 1.0
    """A slower car sees one scene, errors and all, again and again [m/s]: no drift to judge by."""
    drift_block: int = 20
    """Frames whose median is one level, and levels that a drift needs: a short stretch of road looks like drift."""
    drift_blocks: int = 10
    drift_levels: int = 60
    """Levels at most: a longer drive has longer ones."""
    wheels: WheelsConfig = WheelsConfig()
    steps: StepConfig = StepConfig()
    turmoil: TurmoilConfig = TurmoilConfig()
    yaw_steps: YawStepConfig = YawStepConfig()


@dataclass(frozen=True, config=STRICT)
class ConsistencyConfig:
    """When a frame's road is not that of the frames around it."""

    height: float = 0.08
    """Share of the height by which neighbours on one road never differ (0.13 m on a car): springs and kerbs."""
    pitch_deg: float = 2.5
    roll_deg: float = 3.5
    """The same of pitch and roll [deg]: braking turns a body by one, crests and crossfalls of crossings by the rest."""
    sigmas: float = 4.0
    """... and by so many of the frame's own sigma as well."""
    near_height: float = 0.09
    near_height_m: float = 0.148
    near_angle_deg: float = 1.48
    near_sigmas: float = 3.95
    """The same against the smoothed rig of that very moment, which knows of crests and crossfalls; height by the lesser
    of both. Nothing on springs differs from its own neighbours by 0.15 m or 1.5 deg; a little less is asked, so that
    what files round still fulfils it."""
    window: int = 40
    """Frames of either side that are asked: 4 s, longer than a turn shows another road."""
    reach: int = 80
    """... within so many frames: beyond, the load may have changed."""
    least_side: int = 20
    """Fewer good frames on one side do not speak for a rig of their own: two seconds of another road are common."""
    least_frames: int = 5
    """Fewer around in all say nothing."""
    settling: int = 15
    """Frames without a doubt of their own that settle those of a drive's beginning: as many as the front end looks
    back over, longer than the body swings."""
    rounds: int = 4
    """How often the frames left are asked again about those left out. Numerical."""


@dataclass(frozen=True, config=STRICT)
class CausesConfig:
    """When a number of failed frames differs from that of the good ones so much that it tells why they failed."""

    factor: float = 2.0
    """Less than the usual by this factor, or more: one stop of light. Less is what auto-exposure and scenery do."""
    sigmas: float = 4.0
    """... and by so many robust sigmas of the good frames: once in 16 000 by chance, were they normal."""
    least_share: float = 0.1
    """One robust sigma is at least so much of the usual: a drive through one scene scatters less than the next one."""
    least_frames: int = 5
    """Fewer good frames tell nothing usual. Numerical."""
    neighbours: int = 5
    """Good frames on either side whose number is told as well, where it is not the usual: half a second at 10 Hz."""
    named: int = 3
    """Numbers named with a cause: more are not read."""
    most_scale: float = 0.15
    """True depths over measured ones, less one: beyond it the calibration is one of other pictures or units. Source:
    KITTI's are off by 1 to 3 %; pictures are resized by a fifth and more, inches and feet lie farther off."""
