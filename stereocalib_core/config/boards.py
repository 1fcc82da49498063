"""Chosen numbers of the board calibrator: sizes, tolerances and limits, each with its unit and its reason.

A share is of the board's shorter side unless it says otherwise, so that one number fits a board of 30 cm and one
of 2 m. One frozen dataclass a stage; the instance beside it is what the calibrator uses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class PlaneConfig:
    """Planes through LiDAR points."""

    least_points: int = 10
    range_sigma_floor_m: float = 1e-4
    """Ten times below the best LiDAR's: keeps perfect data finite."""
    slant_floor: float = 0.02
    """Least |n . u| in a weight: a ray that grazes the plane would otherwise count without limit."""
    huber: float = 2.5
    """Sigmas; 99 % efficient for Gaussian noise (Huber 1964, k = 2.5)."""
    ransac_points: int = 1500
    ransac_trials: int = 200
    """One in four points on the plane still gives 95 % of success."""


@dataclass(frozen=True)
class RefineConfig:
    """The joint refinement."""

    huber: float = 2.5
    """Sigmas, as for planes."""
    most_iterations: int = 40
    rounding: float = 1e-9
    settled: float = 1e-8
    """Relative gain below which the iteration ends."""
    most_points: int = 1500
    """Points of one board: more do not help, what is left is common to all of them."""
    least_corner_sigma_px: float = 0.02
    least_range_sigma_m: float = 0.001
    """No detector is better, not on sharp renderings either, and no LiDAR: what repeats within a picture does not
    average out."""
    plane_sigma_floor_rad: float = 1e-6
    plane_sigma_floor_m: float = 1e-6
    """A plane whose whole error is thought to be none is held this closely: keeps weights finite."""


@dataclass(frozen=True)
class VarianceConfig:
    """How far LiDAR planes as a whole are off, and the board's scale."""

    least_boards: int = 5
    """Fifteen mismatches less six of the transform and one of the scale: fewer boards show no variance."""
    first_tilt_rad: float = math.radians(0.3)
    first_offset_m: float = 0.003
    """Where the scoring begins: beams that are off by 1 cm over a board of 0.6 m."""
    rounds: int = 30
    settled: float = 1e-3
    solve_rounds: int = 4
    loose_scale_sigma: float = 0.1
    """Share; while the variances are sought the printed square may be anything."""
    scale_sigma: float = 0.003
    """Share; a printed square measured by ruler over several squares: 0.3 mm of 95 mm."""


@dataclass(frozen=True)
class FindingConfig:
    """Causes that most pairs have in common."""

    most_refused: float = 0.5
    """Share of the pairs: beyond it the set as a whole is wrong, not a pair."""
    least_pictures: int = 4
    """As many as it takes to estimate a camera and to hold one pair against the others."""
    fair_rms_px: float = 0.5
    """Corners of a sound camera miss by less, blurred ones included."""
    clearly_worse: float = 3.0
    """Times the rms of a camera that was estimated from the same corners."""
    same_scale: float = 0.01
    """Share; picture sizes are rounded to whole pixels."""
    same_centre: float = 0.1
    other_size: float = 0.15
    """Logarithms: a lens' centre lies within 5 % of the middle; the next usual size differs by 20 %."""
    same_focal: float = 0.12
    """Logarithm; a focal length estimated from ten boards is good to 5 %."""
    places_per_cloud: int = 3
    """Time: every place is tried with every picture."""
    least_covered: float = 0.25
    """Share of the picture that corners must span to tell a lens; less leaves focal length and centre to luck."""
    least_lens_pictures: int = 8
    """Zhang (2000) finds errors settle at eight to ten pictures."""


@dataclass(frozen=True)
class NextPoseConfig:
    """The grid of poses among which the board to add is looked for."""

    places: tuple[float, ...] = (0.2, 0.5, 0.8)
    """Shares of the picture's width and height."""
    tilts_rad: tuple[float, ...] = (0.0, math.radians(20.0), math.radians(40.0))
    """Beyond 40 degrees corners get hard to find (Atcheson et al. 2010, figure 5)."""
    directions: int = 8
    distances: int = 5
    nearest_share: float = 0.45
    nearest_m: float = 1.2
    """From half as near as the nearest board of the set, or where spinning LiDARs begin to see, to its farthest."""
    finer: tuple[float, ...] = (0.12, 0.12, 0.06)
    """Shares of the distance by which the best pose of the grid is moved in turn."""
    margin_share: float = 0.01
    least_incidence: float = 0.4
    """Cosine: flatter boards show too few rings and blurred corners."""
    beyond_rad: float = math.radians(4.0)
    """How far above and below the boards of this set a LiDAR is thought to see: two rings of the sparsest."""
    least_scanned: float = 0.75
    """Share of a board's height that rows must cover: its outline is found from 0.6 on."""
    least_tilt_rad: float = math.radians(0.1)
    least_offset_m: float = 0.001
    least_rows: int = 4
    """Three tell a plane, the fourth whether it is one."""
    imagined_points: int = 120
    """Points that stand for all on a board that is only imagined: time."""
    rest_weight: float = 0.02
    """Of the other sigmas in the choice: it decides between poses that mend the worst one alike."""


@dataclass(frozen=True)
class BeamConfig:
    """Beams of a spinning LiDAR, told apart by their elevation."""

    least_gap_rad: float = 0.0015
    """Beams of the densest spinning LiDARs stand 0.17 degrees (0.003 rad) apart; within one the encoder's rounding."""
    least_beams: int = 4
    most_beams: int = 128
    most_width_share: float = 0.3
    """Elevations of one beam spread less than this of the gap, or there are no beams to speak of."""
    least_points: int = 5
    """Rows of fewer points say nothing of a beam."""
    usual_sigma_m: float = 0.006
    usual_freedom: float = 3.0
    """Beams before any row is seen, as if three had been measured and found off by 6 mm: data sheets of spinning LiDARs
    promise 2 to 3 cm in all, most of it noise, and the VLP-16 of `boards_vlp16` has 9 mm; rendered sets have 5."""
    sigma_range_m: tuple[float, float] = (0.0003, 0.1)
    row_share: tuple[float, float] = (0.03, 3.0)
    """Where the two variances may lie, the rows' over their mean square: beyond it the likelihood is nothing."""
    grid: int = 60
    """Steps of each: 10 % of a sigma."""


@dataclass(frozen=True)
class CentresConfig:
    """The outline's centre in the cloud against the pattern's in the picture."""

    shared_m: float = 0.010
    """How far a pattern is printed or glued beside the middle of its board: a hand's care."""
    usual_own_m: float = 0.030
    least_own_m: float = 0.010
    """One outline: half the spacing of a VLP-16's rings at 2 m where few boards show no scatter; never below the step
    of a spinning LiDAR (0.2 degrees) at 3 m, which rounds all edges alike. Tuned on rendered seeds 100 to 139."""
    least_boards: int = 5


@dataclass(frozen=True)
class SecondOpinionConfig:
    """What the boards say of the camera and of their own size, against what the files claim."""

    least_boards: int = 6
    """A lens of eight numbers and seven of the transform want 15 numbers beyond the poses: two a board and more."""
    chance: float = 1e-3
    """A sound file is doubted this rarely."""
    certain_sigmas: float = 3.0
    """A square is called wrong beyond so many sigmas, its own and the ruler's together."""
    least_share: float = 1e-9
    """Of the largest singular value: intrinsics that a picture tells apart no better are one number to it."""


@dataclass(frozen=True)
class SolveConfig:
    """The plane solutions."""

    prior_share: float = 0.05
    """Normals that spread less than this say nothing beyond noise; there a prior speaks."""


@dataclass(frozen=True)
class WrongPairConfig:
    """Pairs that do not belong together."""

    least_to_judge: int = 4
    """Three pairs solve; with a fourth one can be asked what the others say of it."""
    outlier: float = 5.0
    """Sigmas of surprise, against the median of all pairs."""
    median_surprise: float = 0.89
    """Median of the root mean square of three Gaussian numbers: sqrt(2.366 / 3)."""
    harmless_rad: float = math.radians(1.2)
    harmless_m: float = 0.02
    """A pair that misses the others by less than this is kept, however sure its covariance is of itself."""
    farthest_aside: float = 0.45
    """Farther apart, the two centres cannot be of the same board."""
    aside_weight: float = 10.0
    """A whole board aside ranks as ten sigmas when the worst pair is picked."""


@dataclass(frozen=True)
class ObservabilityConfig:
    """What a set of boards can show."""

    degenerate: float = 0.05
    """Singular value of the stacked unit normals over sqrt M: normals within 3 degrees of a plane."""
    lost_m: float = 0.25
    lost_rad: float = math.radians(5.0)
    """Sigmas beyond which a tape measure knows better."""
    poor_m: float = 0.03
    poor_rad: float = math.radians(1.0)
    """Sigmas that put a point at 10 m more than a person's breadth aside."""
    least_incidence: float = 0.05
    """A plane seen under less than 3 degrees passes, for all that can be measured, through the sensor's origin."""
    added_tilt_rad: float = math.radians(40.0)
    """Tilt of the board that is asked for: corners are still found, and its normal is well apart."""
    least_facing: float = 0.3
    named_axis: float = 0.95
    """A direction closer than 18 degrees to an axis is called by it."""


@dataclass(frozen=True)
class IntrinsicsConfig:
    """The camera estimated from the boards."""

    least_pictures: int = 3
    """Zhang's method needs three views."""
    pictures_for_lens: int = 10
    """Fewer do not tell a fisheye from a pinhole with k3."""
    worst_rms_px: float = 5.0
    """A lens that is followed no better than this is none that is known here."""
    most_rounds: int = 60


@dataclass(frozen=True)
class BoardPictureConfig:
    """Drawings of a calibration."""

    panel_width_px: int = 960
    near_m: float = 1.0
    far_m: float = 12.0
    """Ends of the colours of depth."""


PLANE = PlaneConfig()
REFINE = RefineConfig()
SOLVE = SolveConfig()
VARIANCE = VarianceConfig()
SECOND_OPINION = SecondOpinionConfig()
CENTRES = CentresConfig()
FINDING = FindingConfig()
NEXT_POSE = NextPoseConfig()
BEAM = BeamConfig()
WRONG_PAIR = WrongPairConfig()
OBSERVABILITY = ObservabilityConfig()
INTRINSICS = IntrinsicsConfig()
BOARD_PICTURE = BoardPictureConfig()
