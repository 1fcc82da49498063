"""Chosen numbers of looking for boards in pictures, clouds and their files, each with its unit and its reason.

A share is of the board's shorter side unless it says otherwise. What is solved from then on is in `config.boards`.
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


CHESSBOARD = ChessboardConfig()
CLOUD_SEARCH = CloudSearchConfig()
OUTLINE = OutlineConfig()
EXTRACTION = ExtractionConfig()
CONSENSUS = ConsensusConfig()
CLOUD_FILE = CloudFileConfig()
