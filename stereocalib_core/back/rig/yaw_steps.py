"""Has the camera been turned about the vertical? Its own heading jumps where the car's cannot.

A knock turns the camera by its whole size between two frames, while a car's rate of turn changes smoothly: so
the odometry shows when, in a bend as well. Whether it lasted is told by the yaw of single pairs on straights
(`YawEstimate.pair_yaw_rad`), before and after. Where the odometry was lost in between, those alone must do.
"""

from __future__ import annotations

import numpy as np

from stereocalib_core.back.rig.body_motion import MotionSeries
from stereocalib_core.back.rig.change_points import Step, find_step
from stereocalib_core.config import ShiftAlarmConfig
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.robust import mad_sigma

_HORIZONS = (15, 30, 60)
"""Pairs on straights after a knock by which it may be certain; so many before it are its level."""
_BEFORE = 10
"""Fewer pairs on straights before a knock are no level."""
_CORRELATED = 6.0
"""So many neighbouring pairs count as one."""
_PULSE_SIGMAS, _LEVEL_SIGMAS = 8.0, 3.0
_PULSE_SIGMA, _LEVEL_SIGMA = float(np.deg2rad(0.04)), float(np.deg2rad(0.02))
"""1 sigma of jump and level that come from how bends begin and roads tilt."""
_ALIKE = (0.5, 1.6)
"""The level must change by the jump, within these factors."""
_MOST = 4


def heading_jumps(motion: MotionSeries) -> Array:
    """(N,) how far the camera turns to the left in each pair beyond what its neighbours foretell [rad].

    NaN where this or a neighbouring pair was not tracked. A cubic through two pairs on either side foretells.
    """
    turn = motion.turns
    jumps = np.full(len(turn), np.nan)
    jumps[2:-2] = (-turn[:-4] + 4.0 * turn[1:-3] + 4.0 * turn[3:-1] - turn[4:]) / 6.0 - turn[2:-2]
    return jumps


def find_yaw_steps(pair_yaw_rad: Array, motion: MotionSeries, config: ShiftAlarmConfig) -> list[Step]:
    """Knocks about the vertical, surest first; sizes and sigmas [rad], > 0: the camera now looks further left.

    pair_yaw_rad: (N,) NaN off the straights.
    """
    levels, jumps = pair_yaw_rad.copy(), heading_jumps(motion)
    least = float(np.deg2rad(config.least_angle_deg))
    known = np.isfinite(jumps)
    if not known.any():
        return []
    usual = mad_sigma(jumps[known])
    height = np.where(known, np.abs(jumps), 0.0)
    steps: list[Step] = []
    for onset in np.argsort(-height).tolist():
        if height[onset] < max(least, _PULSE_SIGMAS * usual) or len(steps) == _MOST:
            break
        # The pair across the knock has a direction of travel in neither of the two poses.
        levels[onset] = np.nan
        step = _confirmed(levels, onset, float(jumps[onset]), usual)
        if step is not None:
            steps.append(step)
            levels[onset:] -= step.size
    return steps + _unseen(levels, motion, least, config)


def _confirmed(levels: Array, onset: int, jump: float, usual: float) -> Step | None:
    """The step at a jump of the heading, as soon as the pairs on straights after it bear it out."""
    index = np.flatnonzero(np.isfinite(levels))
    before = levels[index[index < onset]][-_HORIZONS[-1] :]
    after = index[index > onset]
    if len(before) < _BEFORE:
        return None
    certain = None
    rise = spread = 0.0
    for count in _HORIZONS:
        if len(after) < count and not (certain is None and count == _HORIZONS[0] <= len(after)):
            break
        values = levels[after[:count]]
        rise = float(np.median(values) - np.median(before))
        spread = _LEVEL_SIGMA + float(np.hypot(_mean_sigma(before), _mean_sigma(values)))
        alike = _ALIKE[0] < rise / jump < _ALIKE[1]
        if certain is None and alike and abs(rise) > _LEVEL_SIGMAS * spread:
            certain = int(after[count - 1])
    if certain is None or not _ALIKE[0] < rise / jump < _ALIKE[1]:
        return None
    variances = np.array([_PULSE_SIGMA**2 + usual**2, spread**2])
    weights = (1.0 / variances) / (1.0 / variances).sum()
    size, sigma = float(weights @ [jump, rise]), float(1.0 / np.sqrt((1.0 / variances).sum()))
    return Step(onset, certain, size, sigma, abs(size) / sigma)


def _mean_sigma(values: Array) -> float:
    spread = mad_sigma(values, None)
    return spread / float(np.sqrt(max(len(values) / _CORRELATED, 1.0)))


def _unseen(levels: Array, motion: MotionSeries, least: float, config: ShiftAlarmConfig) -> list[Step]:
    """A step of the yaw on straights across a stretch whose odometry was lost."""
    index = np.flatnonzero(np.isfinite(levels))
    noise = float(np.deg2rad(config.noise_yaw_deg))
    calm = np.ones(len(index), dtype=bool)
    step = find_step(levels[index], calm, _HORIZONS, least, noise, config.threshold)
    if step is None:
        return []
    onset, last = int(index[step.onset]), int(index[step.onset - 1])
    if np.isfinite(motion.turns[last + 1 : onset + 1]).all():
        return []
    return [Step(onset, int(index[step.certain]), step.size, step.sigma, step.score)]
