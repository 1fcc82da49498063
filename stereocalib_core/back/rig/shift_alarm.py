"""Has the mount moved? Steps and slow drifts of height, pitch, roll and yaw, told from the body's own motion.

Height, pitch and roll are taken over the road under the wheels (`over_wheels`), so that what the road does ahead
is out of it, and freed of what braking and cornering explain (`explained`). What is left swings on the springs;
a mount that was knocked moves from one frame to the next and stays. So each frame is tried as the onset of a
step in the whitened series (`steps`), which must be many times its sigma, larger than a least size, and must
last; and the road ahead must show it too, so that a slip of the odometry is no knock. What a speed hump hides
is told by the levels around it (`turmoil`). For the yaw it is the jump
of the camera's own heading (`yaw_steps`). Drift is looked for last, as one ramp over a long drive.

A road shows height, pitch and roll, and with straight travel the yaw. What it cannot show is in `UNSEEN`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.back.rig.body_motion import MotionSeries, remove_explained
from stereocalib_core.back.rig.change_points import Step, find_step
from stereocalib_core.back.rig.over_wheels import over_wheels
from stereocalib_core.back.rig.turmoil import find_hidden_step, wild_stretches
from stereocalib_core.back.rig.yaw_steps import find_yaw_steps
from stereocalib_core.config import ShiftAlarmConfig
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.robust import mad_sigma
from stereocalib_core.results import Axis, FrameResult, Shift, estimates

UNSEEN = "A shift of the camera along x or z leaves the picture of a road unchanged and cannot be seen."
"""What a user is told beside the shifts that were found."""


def find_shifts(
    results: Sequence[FrameResult],
    motion: MotionSeries | None = None,
    pair_yaw_rad: Array | None = None,
    config: ShiftAlarmConfig | None = None,
) -> tuple[Shift, ...]:
    """All shifts of a drive, in the order of their frames.

    motion: what the car did, None = unknown (then only large and lasting shifts are told from the body's own
    motion). pair_yaw_rad: (N,) yaw by single pairs on straights, NaN elsewhere (`YawEstimate.pair_yaw_rad`).
    """
    config = config or ShiftAlarmConfig()
    values = estimates(results)
    steady = np.zeros(len(results), dtype=bool)
    wheels = slow = values
    witnessed = motion is not None and motion.poses is not None
    if motion is not None and len(results):
        wheels = remove_explained(over_wheels(values, motion, config.wheels), motion)
        values = remove_explained(values, motion)
        # A standing car sees one scene, errors and all, again and again: no drift to judge by. And roads bank
        # more often than they rise.
        slow = np.column_stack([values[:, :2], wheels[:, 2]])
        slow[np.abs(motion.speed) < config.standing_m_s] = np.nan
        steady = motion.steady
    frames = np.array([r.frame for r in results], dtype=np.int64)
    angle, height = float(np.deg2rad(config.least_angle_deg)), config.least_height_m
    noise = float(np.deg2rad(config.noise_angle_deg))
    axes: list[tuple[Axis, float, float]] = [
        ("height", height, config.noise_height_m),
        ("pitch", angle, noise),
        ("roll", angle, noise),
    ]
    shifts: list[Shift] = []
    wild = wild_stretches(wheels, config.turmoil) if witnessed else []
    for k, (axis, least, least_noise) in enumerate(axes):
        witness = values[:, k] if witnessed else None
        steps = _steps(wheels[:, k], witness, steady, wild, least, least_noise, config)
        shifts += _axis_shifts(axis, frames, slow[:, k], steps, least, least_noise, config)
    if pair_yaw_rad is not None and motion is not None:
        steps = find_yaw_steps(pair_yaw_rad, motion, config)
        noise = float(np.deg2rad(config.noise_yaw_deg))
        shifts += _axis_shifts("yaw", frames, pair_yaw_rad, steps, angle, noise, config)
    return tuple(sorted(shifts, key=lambda s: (s.frame, s.axis)))


def _steps(
    series: Array,
    witness: Array | None,
    steady: NDArray[np.bool_],
    wild: list[tuple[int, int]],
    least: float,
    noise: float,
    config: ShiftAlarmConfig,
) -> list[Step]:
    """Steps one by one, surest first, each taken out before the next is looked for."""
    series, witness = series.copy(), None if witness is None else witness.copy()
    steps: list[Step] = []
    for _ in range(config.most_steps):
        step = find_step(
            series, steady, config.horizons, least, noise, config.threshold, witness, config.steps
        )
        if step is None:
            step = find_hidden_step(series, wild, least, noise, witness, config.turmoil)
        if step is None:
            break
        steps.append(step)
        series[step.onset :] -= step.size
        if witness is not None:
            witness[step.onset :] -= step.size
    return steps


def _axis_shifts(
    axis: Axis,
    frames: NDArray[np.int64],
    series: Array,
    steps: list[Step],
    least: float,
    noise: float,
    config: ShiftAlarmConfig,
) -> list[Shift]:
    """The steps of one axis, and the drift of what remains of its series without them."""
    rest = series.copy()
    shifts: list[Shift] = []
    for step in steps:
        onset, certain = int(frames[step.onset]), int(frames[step.certain])
        shifts.append(Shift(onset, axis, step.size, step.sigma, "step", certain))
        rest[step.onset :] -= step.size
    drift = _drift(axis, frames, rest, least, noise, config)
    return shifts if drift is None else [*shifts, drift]


def _drift(
    axis: Axis, frames: NDArray[np.int64], series: Array, least: float, noise: float, config: ShiftAlarmConfig
) -> Shift | None:
    """A slow change between the ends of the drive that no step explains."""
    index = np.flatnonzero(np.isfinite(series))
    if len(index) < config.drift_blocks * config.drift_block:
        return None
    block = max(config.drift_block, len(index) // config.drift_levels)
    values = series[index]
    count = len(values) // block
    level = np.median(values[: count * block].reshape(count, block), axis=1)
    t = np.arange(count) + 0.5
    best_cost, best = np.inf, (0, 0, 0.0)
    flat = float(np.abs(level - np.median(level)).sum())
    for first in range(count - 2):
        for last in range(first + 2, count + 1):
            ramp = np.clip((t - first) / (last - first), 0.0, 1.0)
            design = np.stack([np.ones(count), ramp], axis=1)
            (base, size), *_ = np.linalg.lstsq(design, level, rcond=None)
            cost = float(np.abs(level - base - size * ramp).sum())
            if cost < best_cost:
                best_cost, best = cost, (first, last, float(size))
    first, last, size = best
    ramp = np.clip((t - first) / (last - first), 0.0, 1.0)
    residual = level - np.median(level - size * ramp) - size * ramp
    scatter = max(mad_sigma(residual), noise)
    if abs(size) < max(config.drift_factor * least, config.threshold * scatter) or best_cost > 0.5 * flat:
        return None
    middle = index[min((first + last) * block // 2, len(index) - 1)]
    return Shift(int(frames[index[first * block]]), axis, size, scatter, "drift", int(frames[middle]))
