"""Chosen numbers of the board calibrator: sizes, tolerances and limits, each with its unit and its reason.

A share is of the board's shorter side unless it says otherwise, so that one number fits a board of 30 cm and one
of 2 m. One frozen dataclass a stage; the instance beside it is what the calibrator uses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class ChessboardConfig:
    """Corners in a picture, and the board's pose from them."""

    search_width_px: int = 1100
    """Pictures are searched at about this width first: ten times quicker, and less misled by blur."""
    window_share: float = 0.35
    """Half a sub-pixel window, of the spacing of corners: geometry, it must not reach the next corner."""
    least_window_px: int = 2
    most_window_px: int = 11
    """OpenCV's usual window; a larger one averages over the lens."""
    most_moved_share: float = 0.5
    """Of the spacing: a corner refined farther than half a square has run to another one."""
    least_spacing_px: float = 3.0
    """Closer corners are not resolved by a 2-pixel window."""
    most_bend_share: float = 0.35
    """Of the step: second differences of a grid under perspective and lens stay well below; tuned on renderings."""
    second_pose_ratio: float = 4.0
    """The mirrored solution of a planar pose is tried when it misses by less than so many times the first."""
    least_rms_px: float = 0.05
    """Covariance of a pose never claims better corners: the best sub-pixel detectors reach this (Duda & Frese 2018)."""
    sampled_pictures: int = 4
    least_agreeing_share: float = 0.5
    """Pictures looked at first for the named pattern, and the share that must show another before it is believed."""
    worst_rms_px: float = 3.0
    """Corners that miss the board by more belong to another lens or another board."""


@dataclass(frozen=True)
class CloudSearchConfig:
    """Boards in whole clouds, without knowing where to look."""

    most_kept_points: int = 400_000
    """Points of a cloud kept in memory (10 MB); drawn evenly and repeatably."""
    most_rays: int = 60_000
    """Rays that an outline is judged by: enough for 100 on a board of 1 m at 8 m, and ten times quicker."""
    most_seeds: int = 6000
    """Places where a patch is tried: time."""
    voxel_share: float = 1 / 24
    seed_share: float = 0.25
    patch_share: float = 0.5
    coarse_voxel_share: float = 1 / 12
    """Spacing of points, of seeds, radius of a patch: a board holds some 50 voxels and 4 seeds."""
    least_patch: int = 8
    """Points of a patch that say something of its plane (3 are a plane)."""
    least_breadth_share: float = 0.12
    """Rms along the second axis: narrower patches are poles and edges."""
    noise_quantile: float = 0.25
    """Floors and walls are everywhere, so the flattest quarter of the patches shows the sensor's own noise."""
    tolerance_sigmas: float = 3.5
    """Distance from a plane that still belongs to it: 1 of 2,000 points of Gaussian noise lies beyond."""
    least_tolerance_m: float = 0.03
    least_cropped_tolerance_m: float = 0.02
    most_tolerance_m: float = 0.10
    """Data sheets: 2 to 3 cm of range noise for spinning LiDARs, up to 10 cm for the cheapest."""
    flat_share: float = 0.7
    """Of the tolerance: patches that scatter more are no planes."""
    least_incidence: float = 0.12
    """Cosine; a board seen under 7 degrees shows too few rings. Geometry."""
    sectors: int = 8
    """Directions in which a plane may end; a board ends in at least half of them."""
    ring_inner_share: float = 0.08
    ring_width_share: float = 0.35
    """The ring beyond the half diagonal that must be mostly empty."""
    settled_share: float = 0.01
    near_share: float = 0.15
    """Patches closer than this are of one place."""
    same_facing: float = 0.98
    """Cosine of two normals that are one plane's: 11 degrees."""
    apart_share: float = 0.3
    """Two candidates closer than this are one board."""
    least_score: float = 0.5
    """Outline overlap of a candidate; the boards of real sets score 0.7 to 1, agreement between pairs does the rest."""
    most_candidates: int = 8
    """Places kept of a cloud: the agreement of pairs is quadratic in them."""
    rough_tolerance_m: float = 0.05
    least_cropped_points: int = 10
    least_cropped_share: float = 0.3
    """A cropped cloud of which less lies on one plane is no board."""
    edge_on_incidence: float = 0.06
    edge_on_breadth_share: float = 0.15
    edge_on_flat_share: float = 0.05
    edge_on_tolerance_m: float = 0.05
    """A free-standing patch whose plane passes through the LiDAR within 3.4 degrees: it can't show its outline."""
    farther_than_camera_m: float = 3.0
    """The sensors of one rig sit no farther apart than this."""
    distance_step_m: float = 0.5
    """Clouds are searched so many times this far; coarse enough not to change with a camera's last pixel."""
    lone_score: float = 0.8
    """A board that does not fit its own picture must be clearer than others to be believed."""
    lone_near_m: float = 0.15
    lone_facing: float = 0.98


@dataclass(frozen=True)
class OutlineConfig:
    """The rectangle of the board's size on a plane."""

    rim_m: float = 0.20
    """How far round the board rays are asked: an arm's breadth, nearer than a wall."""
    edge_share: float = 0.025
    """Rays closer to the edge may see both board and background: half a beam's footprint."""
    coarse_rays: int = 160
    fine_rays: int = 1000
    """Rays used in the first and in the later rounds: time."""
    hopeless: float = 0.4
    """A first round below this is not refined: twice as far from a board as the least score allows."""
    least_visible: float = 0.7
    least_extent: float = 0.6
    """Shares of the rectangle that must be seen for the full score: a mere corner is no board."""
    least_slant: float = 0.03
    """Cosine; rays that graze the plane meet it nowhere definite."""
    search_share: float = 0.15
    """How far beyond the rectangle the search may move."""
    square_share: float = 0.02
    """Sides that differ by less are a square, which looks the same after a quarter turn."""
    steps_per_quarter: int = 9
    """10 degrees a step: the overlap of a square board falls by a tenth within it."""
    shift_share: float = 0.09
    rounds: tuple[float, ...] = (1.0, 0.35, 0.12)
    """Steps of the three searches, each three times finer than the one before."""
    turns: int = 7
    extent_quantile: float = 0.02
    """Two in a hundred points may lie astray."""
    least_hits: int = 6
    equal_score: float = 0.004
    """Scores closer than this are equal: gaps between rings must not pull the middle."""


@dataclass(frozen=True)
class ExtractionConfig:
    """The board's points, once it is known where the board should be."""

    least_points: int = 12
    """Two rings of six points: fewer do not show a plane that leaves anything to check it with."""
    least_score: float = 0.6
    """Share of the rays that obey the outline."""
    loose_tolerance_m: float = 0.12
    """First distance from the expected plane: what a rough transform may be off by."""
    most_turn_rad: float = math.radians(15.0)
    """A plane turned further is another thing."""
    reach_m: float = 0.1
    edge_m: float = 0.02
    edge_share: float = 0.04
    """Points nearer to the board's edge than both may mix board and background: a beam's footprint at 5 m."""
    own_sigmas: float = 3.0
    least_own_share: float = 0.5
    growth: float = 1.3
    most_own_share: float = 2.5
    """The board's own tolerance: three sigmas, grown from within, so that a hand or a coat near it adds nothing."""


@dataclass(frozen=True)
class ConsensusConfig:
    """Which place in each cloud is the board: the one that agrees with the other pairs."""

    most_turn_rad: float = math.radians(6.0)
    """Between the normals of one board in both sensors: 3 cm of range noise over a board of 0.6 m."""
    detection_share: float = 0.35
    solution_share: float = 0.5
    """How far a centre in the cloud may lie from the one in the picture: outlines of few rings are as uncertain."""
    most_proposals: int = 4000
    """Time."""
    usual_baseline_m: float = 3.0
    baseline_penalty: float = 0.2
    """Sensors of one rig rarely sit farther apart; it only decides between equals (a pair's gain is up to 1.5)."""
    tightening: tuple[float, ...] = (1.0, 1.0, 0.7)
    fits_near_m: float = 0.15
    fits_turn_rad: float = math.radians(8.0)
    """A cloud this close to another picture's board probably belongs to it."""


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
    least_corner_sigma_px: float = 0.05
    least_range_sigma_m: float = 0.001
    """No detector is better (Duda & Frese 2018) once its own bias counts, and no LiDAR: what repeats within a picture
    does not average out."""
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
    margin_share: float = 0.01
    least_incidence: float = 0.4
    """Cosine: flatter boards show too few rings and blurred corners."""
    beyond_rad: float = math.radians(4.0)
    """How far above and below the boards of this set a LiDAR is thought to see: two rings of the sparsest."""
    least_tilt_rad: float = math.radians(0.1)
    least_offset_m: float = 0.001
    least_rows: float = 2.0
    """Two rows are the fewest that show a tilt at all."""
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
    least_boards: int = 4
    """Rows of fewer points, and sets of fewer boards, say nothing of a beam."""
    rounds: int = 60
    least_freedom: float = 4.0
    """Degrees of freedom below which Student's t has hardly a variance: the beams' share is doubled at most."""


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
    weak: float = 0.12
    """Singular values of the stacked unit normals over sqrt M: normals within 3 and 7 degrees of a plane."""
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
class CloudFileConfig:
    """Point clouds from files."""

    least_points: int = 20
    nearest_m: float = 0.05
    farthest_m: float = 1000.0
    """Returns nearer than a lens cap or farther than any LiDAR sees are none."""
    farthest_usual_m: float = 300.0
    """Median distance of a scene with a board in it: beyond the reach of LiDARs it is millimetres, or a map."""
    clearly_better: float = 3.0
    """Of binary files: how much nearer neighbours must lie for another record than KITTI's to be believed."""
    absurd: float = 1e7
    """Larger numbers of a binary file are none, in metres or millimetres."""
    largest_file_bytes: int = 4 << 30
    longest_header_bytes: int = 64 * 1024
    largest_unpacked_bytes: int = 1 << 31


@dataclass(frozen=True)
class BoardPictureConfig:
    """Drawings of a calibration."""

    panel_width_px: int = 960
    near_m: float = 1.0
    far_m: float = 12.0
    """Ends of the colours of depth."""


CHESSBOARD = ChessboardConfig()
CLOUD_SEARCH = CloudSearchConfig()
OUTLINE = OutlineConfig()
EXTRACTION = ExtractionConfig()
CONSENSUS = ConsensusConfig()
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
CLOUD_FILE = CloudFileConfig()
BOARD_PICTURE = BoardPictureConfig()
