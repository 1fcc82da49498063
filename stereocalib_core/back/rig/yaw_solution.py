"""The yaw of the pair and the motions of the car together, by robust reprojection.

Per pair of frames the motion is free in all six degrees; the yaw is one number for the drive. Depths and motions are
eliminated (Schur complement).
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.back.rig.relative_yaw_kernels import MOTION, TURN, move, pair_equations
from stereocalib_core.back.rig.stereo_tracks import StereoTracks
from stereocalib_core.config.pair import PairConfig
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.chunks import MOST_AT_ONCE, in_chunks
from stereocalib_core.numeric.spill import let_go, roomy
from stereocalib_core.numeric.stretches import median_of, stretches

CHI2_MEDIAN = 2.366
"""Median of chi^2 with three degrees of freedom: four measurements of a point less its depth."""


@dataclass(frozen=True)
class YawSolution:
    """The yaw of the pairs `used`, and what each of them says of it once its own motion is taken out.

    yaw_rad. curvature, score: (K,) second and first derivative of the cost by the yaw in every pair: alone, pair k
    would give yaw + score / curvature. leverage: (2,) change of the yaw by the roll and pitch assumed.
    without_strips: (S,) change of the yaw [rad] when a strip of the picture is left out.
    motions: (N, 6) of T_current_previous, translations in baselines. noise_px: of one measurement.
    shown: share of what the disparities say of the yaw that no motion explains, 0...1.
    """

    yaw_rad: float
    used: NDArray[np.int64]
    curvature: Array
    score: Array
    leverage: Array
    without_strips: Array
    motions: Array
    noise_px: float
    shown: float

    @property
    def of_pairs(self) -> Array:
        """(K,) what every pair of frames by itself gives for the yaw [rad]."""
        return self.yaw_rad + self.score / np.maximum(self.curvature, 1e-300)


@dataclass(frozen=True)
class _Reduced:
    """Normal equations of the used pairs without their motions: curvature (K, 3, 3) and score (K,) of the turn.

    steps: (K, 6, 2) the motions' own steps, and by how much they follow the yaw. unreduced: curvature by the yaw
    with all motions known.
    """

    curvature: Array
    score: Array
    steps: Array
    unreduced: float


def _reduce(normal: Array, right: Array, used: NDArray[np.int64]) -> _Reduced | None:
    """Schur complement of the `used` (K,) of (N, 9, 9) and (N, 9); None where a motion is not determined."""
    curvature, score = np.empty((len(used), TURN, TURN)), np.empty(len(used))
    steps = np.empty((len(used), MOTION, 2))
    for first in range(0, len(used), MOST_AT_ONCE):
        part = slice(first, first + MOST_AT_ONCE)
        A, b = normal[used[part]], right[used[part]]
        H, cross = A[:, :MOTION, :MOTION].copy(), A[:, :MOTION, MOTION:]
        H[:, range(MOTION), range(MOTION)] *= 1.0 + 1e-9
        try:
            solved = np.linalg.solve(H, np.dstack([cross, b[:, :MOTION, None]]))
        except np.linalg.LinAlgError:
            return None
        curvature[part] = A[:, MOTION:, MOTION:] - np.einsum("nmp,nmq->npq", cross, solved[:, :, :TURN])
        score[part] = b[:, MOTION] - np.einsum("nm,nm->n", cross[:, :, 0], solved[:, :, TURN])
        steps[part] = np.dstack([solved[:, :, TURN], solved[:, :, 0]])
        let_go(normal)
    total = curvature[:, 0, 0].sum()
    if not (np.isfinite(total) and total > 0.0):
        return None
    return _Reduced(curvature, score, steps, float(normal[used, MOTION, MOTION].sum()))


def solve_yaw(
    tracks: StereoTracks,
    motions: Array,
    active: NDArray[np.bool_],
    roll_pitch: tuple[float, float],
    config: PairConfig,
    by_strips: bool = True,
) -> YawSolution | None:
    """The yaw of the `active` (N,) pairs, Gauss-Newton over it and all their motions at once.

    motions: (N, 6 or more) start, rotation vector [rad] and translation [m]. roll_pitch: of the right camera [rad],
    held. by_strips: also what the yaw is without strips of the picture, for sigma. None where no pair is left or the
    equations are singular.
    """
    count, f = len(tracks), tracks.camera.focal_px
    now = np.array(motions[:, :6], dtype=np.float64)
    now[:, 3:] /= tracks.camera.baseline_m
    active = active & (np.diff(tracks.start) >= config.min_points)
    used = np.flatnonzero(active)
    if not len(used):
        return None
    turn = np.array([0.0, *roll_pitch])
    normal, right = roomy((count, MOTION + TURN, MOTION + TURN)), np.zeros((count, MOTION + TURN))
    misfit = roomy(tracks.rays.shape[1])
    of_used = np.repeat(active, np.diff(tracks.start))
    noise, step, total = config.noise_px / f, np.inf, np.nan
    reduced: _Reduced | None = None
    for _ in range(config.rounds):
        in_chunks(
            pair_equations, count,
            tracks.rays, tracks.start, active, now, turn, noise, config.tuning, normal, right, misfit,
        )  # fmt: skip
        reduced = _reduce(normal, right, used)
        if reduced is None:
            return None
        total = reduced.curvature[:, 0, 0].sum()
        if abs(step) < config.settled_rad:
            break
        step = reduced.score.sum() / total
        move(now, used, reduced.steps[:, :, 0] - reduced.steps[:, :, 1] * step)
        turn[0] += step
        # the drive's own residuals say how noisy its points are, and so which of them are wrong
        scale = np.sqrt(median_of(misfit, of_used) / CHI2_MEDIAN)
        noise *= float(np.clip(scale, 1.0 / config.most_rescaled, config.most_rescaled))
    if reduced is None or not np.isfinite(turn[0]):
        return None
    curvature = reduced.curvature[:, 0]
    leverage = -curvature[:, 1:].sum(axis=0) / total
    without = _without_strips(tracks, now, active, turn, noise, config) if by_strips else np.zeros(0)
    return YawSolution(
        float(turn[0]), used, curvature[:, 0], reduced.score, leverage, without, now, noise * f,
        float(total / reduced.unreduced),
    )  # fmt: skip


def _strips(tracks: StereoTracks, strips: int) -> Array:
    """(strips - 1,) x between upright strips of the picture that hold equally many points."""
    x = roomy(tracks.rays.shape[1])
    for part in stretches(len(x)):
        x[part] = tracks.rays[0, part]
        let_go(tracks.rays)
    return np.asarray(np.quantile(x, np.linspace(0.0, 1.0, strips + 1)[1:-1], overwrite_input=True))


def _without_strips(
    tracks: StereoTracks, now: Array, active: NDArray[np.bool_], turn: Array, noise: float, config: PairConfig
) -> Array:
    """(S,) change of the yaw [rad] when the points of one of S upright strips of the picture are left out.

    One step from the solution of all of them; the strips hold equally many points.
    """
    count, strips = len(tracks), config.strips
    used = np.flatnonzero(active)
    shape = (count, MOTION + TURN, MOTION + TURN)
    edges, strip = _strips(tracks, strips), roomy(tracks.rays.shape[1], np.int8)
    for stretch in stretches(len(strip)):
        strip[stretch] = np.searchsorted(edges, tracks.rays[0, stretch])
        let_go(tracks.rays, strip)
    parts = []
    for k in range(strips):
        # where the points of each pair begin among those inside; a running sum over all would be eight bytes a point
        each = [np.count_nonzero(strip[a:b] == k) for a, b in itertools.pairwise(tracks.start)]
        start = np.concatenate([[0], np.cumsum(each)])
        normal, right = roomy(shape), np.zeros(shape[:2])
        rays, n = roomy((len(tracks.rays), int(start[-1]))), 0
        for stretch in stretches(len(strip)):
            some = tracks.rays[:, stretch][:, strip[stretch] == k]
            rays[:, n : n + some.shape[1]] = some
            n += some.shape[1]
            let_go(rays, tracks.rays, strip)
        in_chunks(
            pair_equations, count,
            rays, start, active, now, turn, noise,
            config.tuning, normal, right, roomy(int(start[-1])),
        )  # fmt: skip
        let_go(normal)
        parts.append((normal, right))
    curvature: list[list[Array]] = [[] for _ in parts]
    score: list[list[Array]] = [[] for _ in parts]
    for first in range(0, len(used), MOST_AT_ONCE):
        these = used[first : first + MOST_AT_ONCE]
        of_some = [(normal[these], right[these]) for normal, right in parts]
        let_go(*(normal for normal, _ in parts))
        whole = [np.sum(each, axis=0) for each in zip(*of_some, strict=True)]
        for k, (normal, right) in enumerate(of_some):
            rest = whole[0] - normal
            # a pair that is left without its own motion says nothing
            enough = np.flatnonzero(np.linalg.cond(rest[:, :MOTION, :MOTION]) < config.worst_condition)
            if not len(enough):
                continue
            reduced = _reduce(rest, whole[1] - right, enough)
            curvature[k].append(np.array([np.nan]) if reduced is None else reduced.curvature[:, 0, 0])
            score[k].append(np.array([np.nan]) if reduced is None else reduced.score)
    return np.array(
        [
            np.concatenate(of_score).sum() / np.concatenate(of_turn).sum() if of_turn else np.nan
            for of_score, of_turn in zip(score, curvature, strict=True)
        ]
    )
