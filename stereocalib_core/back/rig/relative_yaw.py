"""The pair's relative yaw from the motion of the car: what no row of the pictures shows.

A right camera that is turned by a yaw against the left one takes f yaw (1 + x^2) from every disparity, x = (u_right -
cx) / f. All depths are then wrong, near ones by little and far ones by much, so that near and far points want
different translations of the same car. Per pair of frames the motion is free in all six degrees; the yaw is one
number for the drive. Everything is estimated together by robust reprojection in the four pictures of a pair of
frames, the depths and the motions eliminated (Schur complement).

The pair's pitch and roll come from its rows (`back.rig.pair`), which show them far better than any motion does;
they are taken out of the disparities first and what is unsure of them adds to the sigma of the yaw.

Sigma is not that of the points, which share their scene with those of the next frame, and their faults. The drive is
cut into groups of neighbouring pairs, and into its thirds: how much these disagree is what noise and scenes do. The
picture is cut into upright strips: how much the yaw changes when one is left out is what stays the same all along
the drive and is no yaw (a lens that is not quite as calibrated, rows that are not quite equal, a car ahead). What
strips disagree by in any drive, as patches are matched, is not that. `experiments.pair_sigma` counts on rendered
drives whether sigma holds.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.back.rig.stereo_tracks import StereoTracks
from stereocalib_core.back.rig.yaw_solution import YawSolution, solve_yaw
from stereocalib_core.config.pair import PairConfig
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.robust import mad_sigma
from stereocalib_core.numeric.spill import let_go
from stereocalib_core.numeric.stretches import stretches
from stereocalib_core.results import Measured


@dataclass(frozen=True)
class RelativeYaw:
    """The relative yaw of the right camera over (a part of) a drive; `reason` says why there is none.

    yaw_rad > 0: the right camera looks further left than the left one, every disparity is too small.
    halves: (2,) by the odd and the even pairs alone, thirds: (3,) by the parts of the drive [rad].
    """

    yaw_rad: float
    sigma_rad: float
    halves: Array
    thirds: Array
    pairs: int
    noise_px: float
    reason: str | None = None
    solution: YawSolution | None = None

    @property
    def measured(self) -> bool:
        """Whether there is a value."""
        return self.reason is None


def grouped_sigma(solution: YawSolution, pairs_together: int, scenes_last: float = 1.0) -> float:
    """Standard deviation of the yaw [rad] by how much groups of neighbouring pairs disagree (sandwich, clustered).

    The thirds of the drive are its coarsest groups; where they disagree by more than the small ones let expect, the
    drive has something slow in it, and sigma is what they say. Few groups hardly know how much they disagree; so it is
    never less than `scenes_last` times what pairs without anything in common would say.
    """
    total = solution.curvature.sum()
    sigmas = []
    for groups in (solution.used // pairs_together, np.arange(len(solution.used)) * 3 // len(solution.used)):
        _, of = np.unique(groups, return_inverse=True)
        sums = np.bincount(of, weights=solution.score)
        if len(sums) > 1:
            sigmas.append(np.sqrt(np.sum(sums**2) * len(sums) / (len(sums) - 1.0)) / total)
    single = float(np.sqrt(np.sum(solution.score**2)) / total)
    return float(max([scenes_last * single, *sigmas]))


def strip_sigma(solution: YawSolution, share: float) -> float:
    """Standard deviation of the yaw [rad] by how much it hangs on single strips of the picture (jackknife).

    share: of the jackknife's own; strips that lie beside each other share what is wrong in them, so that it says
    more than is true.
    """
    changes = solution.without_strips[np.isfinite(solution.without_strips)]
    if len(changes) < 2:
        return float("inf")
    return float(share * np.sqrt((len(changes) - 1.0) / len(changes) * np.sum(changes**2)))


def relative_yaw(
    tracks: StereoTracks,
    motions: Array,
    active: NDArray[np.bool_],
    roll_pitch: tuple[Measured, Measured],
    config: PairConfig,
) -> RelativeYaw:
    """The yaw over the `active` (N,) pairs, with sigma; `motions` (N, 6 or more) is where their motions start."""
    if np.count_nonzero(active) < config.min_pairs:
        return _none(f"the car moves in {np.count_nonzero(active)} pairs of frames only", 0)
    roll, pitch = roll_pitch
    solution = solve_yaw(tracks, motions, active, (roll.value, pitch.value), config)
    if solution is None or len(solution.used) < config.min_pairs:
        return _none("too few points were followed from frame to frame", 0)
    if solution.shown < config.least_shown:
        return _none(
            "near and far points are too much alike: the scene has no range of depth", len(solution.used)
        )
    patches = config.patches_strips_px / tracks.camera.focal_px
    parts = [
        grouped_sigma(solution, config.pairs_together, config.scenes_last),
        np.sqrt(
            max(strip_sigma(solution, config.strip_share) ** 2 - (config.strip_share * patches) ** 2, 0.0)
        ),
        solution.leverage[0] * roll.sigma,
        solution.leverage[1] * pitch.sigma,
        config.least_sigma_px / tracks.camera.focal_px,
        config.share_of_yaw * solution.yaw_rad,
        config.share_of_roll * roll.value,
    ]
    odd = np.arange(len(solution.used)) % 2
    third = np.arange(len(solution.used)) * 3 // len(solution.used)
    return RelativeYaw(
        solution.yaw_rad, float(np.linalg.norm(parts)), _parts(solution, odd), _parts(solution, third),
        len(solution.used), solution.noise_px, None, solution,
    )  # fmt: skip


def as_it_may_be(yaw: RelativeYaw, tracks: StereoTracks, keystones: Array, config: PairConfig) -> RelativeYaw:
    """The yaw with a sigma that knows whether the rows show a turn at all.

    Where they do not, disparities may be off by as much all over the picture, as by a principal point: what reads as
    yaw (1 + x^2) is then yaw (1 + mean x^2), and sigma has the difference. keystones: (K,) [rad] by the rows of every
    frame, which would be the yaw of a turn.
    """
    if not yaw.measured or len(keystones) < config.min_pairs or not tracks.rays.shape[1]:
        return yaw
    # neighbouring frames share their scene: one look in four
    scatter = mad_sigma(keystones, None) / np.sqrt(max(len(keystones) / 4.0, 1.0))
    apart = abs(float(np.median(keystones)) - yaw.yaw_rad)
    if apart < config.unlike_turn * abs(yaw.yaw_rad) + config.unlike_sigmas * scatter:
        return yaw
    wide = 0.0
    for part in stretches(tracks.rays.shape[1]):
        wide += float(np.sum((tracks.rays[0, part] - tracks.rays[2, part]) ** 2)) / tracks.rays.shape[1]
        let_go(tracks.rays)
    return dataclasses.replace(yaw, sigma_rad=float(np.hypot(yaw.sigma_rad, wide * yaw.yaw_rad)))


def _parts(solution: YawSolution, part: NDArray[np.int64]) -> Array:
    """What each part of the pairs gives by itself [rad]."""
    weights = np.bincount(part, weights=solution.curvature)
    return solution.yaw_rad + np.bincount(part, weights=solution.score) / np.maximum(weights, 1e-300)


def _none(reason: str, pairs: int) -> RelativeYaw:
    nan = float("nan")
    return RelativeYaw(nan, nan, np.full(2, nan), np.full(3, nan), pairs, nan, reason)
