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
    rules = config.yaw_steps
    levels, jumps = pair_yaw_rad.copy(), heading_jumps(motion)
    least = float(np.deg2rad(config.least_angle_deg))
    known = np.isfinite(jumps)
    if not known.any():
        return []
    usual = mad_sigma(jumps[known])
    height = np.where(known, np.abs(jumps), 0.0)
    steps: list[Step] = []
    for onset in np.argsort(-height).tolist():
        if height[onset] < max(least, rules.pulse_sigmas * usual) or len(steps) == rules.most:
            break
        # The pair across the knock has a direction of travel in neither of the two poses.
        levels[onset] = np.nan
        step = _confirmed(levels, onset, float(jumps[onset]), usual, config)
        if step is not None:
            steps.append(step)
            levels[onset:] -= step.size
    return steps + _unseen(levels, motion, least, config)


def _confirmed(levels: Array, onset: int, jump: float, usual: float, config: ShiftAlarmConfig) -> Step | None:
    """The step at a jump of the heading, as soon as the pairs on straights after it bear it out."""
    rules = config.yaw_steps
    pulse, level = np.deg2rad([rules.pulse_sigma_deg, rules.level_sigma_deg]).tolist()
    low, high = rules.agree
    index = np.flatnonzero(np.isfinite(levels))
    before = levels[index[index < onset]][-config.horizons[-1] :]
    after = index[index > onset]
    if len(before) < rules.before:
        return None
    certain = None
    rise = spread = 0.0
    for count in config.horizons:
        if len(after) < count and not (certain is None and count == config.horizons[0] <= len(after)):
            break
        values = levels[after[:count]]
        rise = float(np.median(values) - np.median(before))
        spread = level + float(np.hypot(_mean_sigma(before, rules.alike), _mean_sigma(values, rules.alike)))
        alike = low < rise / jump < high
        if certain is None and alike and abs(rise) > rules.level_sigmas * spread:
            certain = int(after[count - 1])
    if certain is None or not low < rise / jump < high:
        return None
    variances = np.array([pulse**2 + usual**2, spread**2])
    weights = (1.0 / variances) / (1.0 / variances).sum()
    size, sigma = float(weights @ [jump, rise]), float(1.0 / np.sqrt((1.0 / variances).sum()))
    return Step(onset, certain, size, sigma, abs(size) / sigma)


def _mean_sigma(values: Array, alike: float) -> float:
    return mad_sigma(values, None) / float(np.sqrt(max(len(values) / alike, 1.0)))


def _unseen(levels: Array, motion: MotionSeries, least: float, config: ShiftAlarmConfig) -> list[Step]:
    """A step of the yaw on straights across a stretch whose odometry was lost."""
    index = np.flatnonzero(np.isfinite(levels))
    noise = float(np.deg2rad(config.noise_yaw_deg))
    calm = np.ones(len(index), dtype=bool)
    step = find_step(
        levels[index], calm, config.horizons, least, noise, config.threshold, config=config.steps
    )
    if step is None:
        return []
    onset, last = int(index[step.onset]), int(index[step.onset - 1])
    if np.isfinite(motion.turns[last + 1 : onset + 1]).all():
        return []
    return [Step(onset, int(index[step.certain]), step.size, step.sigma, step.score)]
