"""Settings of the tracks: where corners are looked for, how they are followed, and which are kept."""

from __future__ import annotations

from typing import Literal

from pydantic.dataclasses import dataclass

from stereocalib_core.config.strict import STRICT


@dataclass(frozen=True, config=STRICT)
class PatchConfig:
    """The small patches that are found again. Their sizes are compiled into the kernels: one value each."""

    half_px: Literal[7] = 7
    """Half size of the square patch followed from frame to frame [px of its level]. Source: KLT practice (15 x 15)."""
    row_half_u_px: Literal[8] = 8
    """Half sizes of the patch matched from left to right [px]; low, for a road is seen at a flat angle."""
    row_half_v_px: Literal[5] = 5
    min_contrast: float = 2.5
    """Standard deviation of grey values below which a patch shows nothing [grey levels]: about twice the noise of
    an 8-bit camera."""
    min_correlation: float = 0.75
    """Correlation of a patch with its like that is believed. Tuned on KITTI 03 and 06."""
    max_return_px: float = 0.4
    """How far from its start a patch may come back, forward and backward [px]: the noise of a track."""


@dataclass(frozen=True, config=STRICT)
class CornersConfig:
    """Corners of the left picture, well spread, on the road and above it."""

    road_cell_px: tuple[int, int] = (32, 10)
    """Width and height of the cells that give one road corner each [px]; low, for a road is seen at a flat angle."""
    above_cell_px: tuple[int, int] = (64, 40)
    """The same for points above the road [px]."""
    max_road: int = 260
    """Corners kept before tracking: what one core follows in some 8 ms."""
    max_above: int = 150
    road_tolerance_px: float = 1.0
    """|measured disparity - disparity of the plane| of a point on the road [px]. Three sigmas of a matched disparity;
    the free map alone would let kerbs in."""
    matcher_px: float = 0.5
    """What the dense matcher's whole steps add to that before a disparity is refined [px]."""
    above_road_m: float = 0.4
    """Height above the road from which a point counts as off the road [m]: above kerbs."""
    road_near_m: float = 4.0
    """Nearest and farthest road that is taken for a plane [m]. Physics: before the bumper; beyond, camber and crests
    exceed a disparity's noise."""
    road_far_m: float = 30.0
    road_half_width_m: float = 7.0
    """The same to the side [m]: two lanes."""
    search_disparity_px: float = 2.0
    """How far a corner's disparity may be from the first guess [px]."""
    min_score: float = 2e-6
    """Least eigenvalue of a road corner (OpenCV's cornerMinEigenVal on the half-size picture); four times that above
    the road. Tuned on KITTI 06, whose road has the least texture."""


@dataclass(frozen=True, config=STRICT)
class MotionSearchConfig:
    """Motions that are tried where nothing predicts one: at the start, after a jump, when tracks fail."""

    slow_step_m: float = 0.1
    """Travel per frame is tried in such steps up to `slow_m`, then in `fast_step_m` below `fast_m` [m]: a step is less
    than the reach of a patch of the quarter-size picture."""
    slow_m: float = 1.0
    fast_step_m: float = 0.2
    fast_m: float = 3.5
    widest_m: float = 16.0
    """Where that fails, and both pairs show a road, so far is tried in steps of `fast_step_m` [m]: drives of single
    pairs. Physics: half of the road that is tracked is then behind the car."""
    turns_deg: tuple[float, ...] = (1.0, 2.0, 3.0)
    """Heading changes per frame that are tried, to both sides [deg]: 30 deg/s at 10 Hz."""
    factors: tuple[float, ...] = (0.5, 1.5, 2.0, 3.0, 4.0)
    """Multiples of the last known motion that are tried besides itself and a stop: lost or doubled frames."""
    fine_deg: tuple[float, ...] = (0.3, 0.6)
    """Pitch and turn about the best that are tried as well, to both sides [deg]: a bump moves everything by pixels."""
    fine_m: float = 0.05
    """And travel [m]."""
    points: int = 120
    """Corners that vote."""
    half_px: Literal[3] = 3
    """Half size of the patches compared [px of the quarter-size picture]; compiled in."""


@dataclass(frozen=True, config=STRICT)
class BentPairConfig:
    """When points are judged by a motion that leaves the pair's own yaw free."""

    least_move_px: float = 0.5
    """A bend that moves nine of ten points by less than that against the motion by the depths as measured moves hardly
    any out of `TracksConfig.tolerance_px` [px]: a third of it. How much it moves them goes with the way driven in
    baselines: a small rig on a fast car is thrown off by a fraction of a pixel of disparity."""
    sure: float = 5.0
    """... and so many sigmas: else a passing lorry would do for a bend."""
    noise_px: float = 0.3
    """1 sigma of a track against its motion [px]; three of these count a quarter (Geman-McClure). Source: residuals of
    KITTI's tracks are 0.15 to 0.3 px."""
    reach: float = 3.0
    """Points so many `tolerance_px` away are looked at."""
    widest_rad: float = 0.02
    """1 sigma of the yaw beforehand [rad]: what no pair can be turned by that still matches."""
    rounds: int = 5
    """Numerical."""


@dataclass(frozen=True, config=STRICT)
class TracksConfig:
    """Points of the road, and above it, from one stereo pair to the next."""

    patch: PatchConfig = PatchConfig()
    corners: CornersConfig = CornersConfig()
    search: MotionSearchConfig = MotionSearchConfig()
    bent: BentPairConfig = BentPairConfig()
    tolerance_px: float = 1.5
    """How far a point may be from where the pair's motion puts it [px]: about four sigmas of a track."""
    disparity_tolerance_px: float = 1.0
    """The same for its disparity in the second pair [px]."""
    reach_px: float = 3.0
    """How far that disparity is searched [px]."""
    border_px: float = 8.0
    """Predicted nearer to the edge, a point is not expected to be found [px]: the half size of a patch."""
    samples: int = 48
    """Random triples of points tried beside the predicted motion: with half of the points good, one is all good with
    99.8 %."""
    min_agreement: float = 0.55
    """Share of the points that must move together, else the prediction was wrong and is searched for. Tuned on KITTI
    03 and 06 with dropped frames."""
    road_votes: float = 2.0
    """What a road point counts against one above it: a passing lorry may fill the picture, but not the road."""
    min_consent: float = 0.4
    """Share of the points found again that must move together, else no motion is believed."""
    min_points: int = 12
    """Fewer points make no tracks. Numerical."""
    max_jump: int = 4
    """Frames that may be missing between the two of a pair: at 10 Hz half a second, in which half the road that was
    seen is passed."""
