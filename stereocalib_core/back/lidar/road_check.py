"""Do camera and LiDAR still agree? The residuals of a drive (see `lidar_road`) against time and tolerance.

Two alarms. A step: the residual before and after some frame differ by more than they scatter; it says that one
sensor has moved on the other during the drive. An offset: the residual lies beyond the tolerance from the start;
it says that the calibration brought along is wrong. Both ask for frames that are independent of each other, and
neighbouring residuals are not (the same road, the same shadows): `correlated_frames` of them count as one.

Signs are those of the extrinsics: the LiDAR's own height, pitch and roll over the road less what the calibration
makes of the camera's.

Who has moved? Both see the same road. A camera that is knocked alone changes its own height, pitch or roll over the
road by as much as it changes the residual, the other way round; a knocked LiDAR changes the residual only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.config import RoadCheckConfig
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.robust import SIGMA_PER_MAD
from stereocalib_core.results import FrameResult, LidarCheck, LidarSeries, LidarShift, Residual

Axis = Literal["height", "pitch", "roll"]

AXES: tuple[Axis, ...] = ("height", "pitch", "roll")
UNSEEN = (
    "a road fixes roll, pitch and height of the LiDAR; it says nothing of its yaw and of shifts along x or z"
)

_MOST_STEPS = 4


def check(results: Sequence[FrameResult], config: RoadCheckConfig) -> LidarCheck | None:
    """The LiDAR against the stereo road over a drive; None where no frame shows both."""
    seen = [(r, r.lidar) for r in results if r.lidar is not None]
    if not seen:
        return None
    frames = np.array([r.frame for r, _ in seen], dtype=np.int64)
    times = np.array([r.timestamp_s for r, _ in seen])
    values = np.array([residual.values for _, residual in seen])
    covariance = np.array([residual.covariance for _, residual in seen])
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    median, scatter = _robust(values)
    shifts: list[LidarShift] = []
    levels = np.zeros_like(values)
    for axis in range(3):
        steps = _steps(values[:, axis], sigma[:, axis], axis, config)
        shifts += [_shift(frames, axis, *step) for step in steps]
        for onset, _, size, _ in steps:
            levels[onset:, axis] += size
        first = steps[0][0] if steps else len(values)
        offset = _offset(values[:first, axis], sigma[:first, axis], axis, config)
        if offset is not None:
            certain, size, deviation = offset
            shifts.append(
                LidarShift(int(frames[0]), AXES[axis], size, deviation, "offset", int(frames[certain]))
            )
    filtered, filtered_sigma = _filter(values, sigma, levels, times, config)
    rms = np.sqrt(np.mean((values - median) ** 2, axis=0))
    of_one = np.median(sigma, axis=0)
    height, pitch, roll = (
        Residual(float(median[k]), float(scatter[k]), float(rms[k]), float(of_one[k])) for k in range(3)
    )
    return LidarCheck(
        height,
        pitch,
        roll,
        shifts=tuple(sorted(shifts, key=lambda s: (s.frame, AXES.index(s.axis)))),
        frames=len(frames),
        unseen=UNSEEN,
        series=LidarSeries(frames, values, sigma, filtered, filtered_sigma),
    )


def who_moved(
    found: LidarCheck, camera_steps: Sequence[tuple[int, str, float]], config: RoadCheckConfig
) -> LidarCheck:
    """The same with `moved` told for every step, from the steps (frame, axis, size) of the camera over the road."""

    def told(shift: LidarShift) -> LidarShift:
        if shift.kind != "step":
            return shift
        near = [
            size
            for frame, axis, size in camera_steps
            if axis == shift.axis and abs(frame - shift.frame) < config.window
        ]
        if not near:
            return replace(shift, moved="lidar")
        unlike = min(abs(size + shift.size) for size in near)
        return replace(shift, moved="camera" if unlike < 0.5 * abs(shift.size) else None)

    return replace(found, shifts=tuple(told(shift) for shift in found.shifts))


def _robust(values: Array) -> tuple[Array, Array]:
    """Median and 1.4826 times the median distance from it, along the first axis."""
    median = np.median(values, axis=0)
    return median, SIGMA_PER_MAD * np.median(np.abs(values - median), axis=0)


def _shift(
    frames: NDArray[np.int64], axis: int, onset: int, certain: int, size: float, sigma: float
) -> LidarShift:
    return LidarShift(int(frames[onset]), AXES[axis], size, sigma, "step", int(frames[certain]))


def _spread(values: Array, sigma: Array) -> float:
    """1 sigma of one residual about its level: what is found, or what was stated where few were found."""
    return max(float(_robust(values)[1]), float(np.median(sigma)))


def _mean_sigma(spread: float, count: int, config: RoadCheckConfig) -> float:
    """1 sigma of the level of `count` neighbouring residuals."""
    return spread / float(np.sqrt(max(count / config.correlated_frames, 1.0)))


def _least(axis: int, config: RoadCheckConfig) -> float:
    angles = np.deg2rad([config.least_pitch_deg, config.least_roll_deg])
    return float((config.least_height_m, *angles)[axis])


def _steps(
    values: Array, sigma: Array, axis: int, config: RoadCheckConfig
) -> list[tuple[int, int, float, float]]:
    """Onset, index by which it was certain, size and sigma of every step, surest first taken out."""
    rest = values.copy()
    found: list[tuple[int, int, float, float]] = []
    while len(found) < _MOST_STEPS:
        step = _surest_step(rest, sigma, _least(axis, config), config)
        if step is None:
            break
        found.append(step)
        rest[step[0] :] -= step[2]
    return sorted(found)


def _surest_step(
    values: Array, sigma: Array, least: float, config: RoadCheckConfig
) -> tuple[int, int, float, float] | None:
    """The step that stands out most, by the medians of the windows before and after each frame."""
    for length in (config.settled, config.window):
        # A longer wait is only for what the shorter one does not show.
        sizes, deviations = _jumps(values, sigma, length, config)
        scores = np.where(np.abs(sizes) > least, np.abs(sizes) / deviations, 0.0)
        if len(scores) and float(scores.max()) > config.step_sigmas:
            onset = _onset(values, config.min_frames + int(np.argmax(scores)), length, config)
            at = onset - config.min_frames
            return onset, onset + length - 1, float(sizes[at]), float(deviations[at])
    return None


def _jumps(values: Array, sigma: Array, length: int, config: RoadCheckConfig) -> tuple[Array, Array]:
    """Size and sigma of a step at each onset from `min_frames` to the last with `length` values after it."""
    onsets = np.arange(config.min_frames, len(values) - length + 1)
    lead = np.full(config.window, np.nan)
    before = np.concatenate([lead, values])[onsets[:, None] + np.arange(config.window)]
    stated = np.concatenate([lead, sigma])[onsets[:, None] + np.arange(config.window)]
    after = values[onsets[:, None] + np.arange(length)]
    low, high = _row_medians(before), _row_medians(after)
    spreads = [
        SIGMA_PER_MAD * _row_medians(np.abs(w - m[:, None])) for w, m in ((before, low), (after, high))
    ]
    spread = np.maximum(np.hypot(*spreads) / np.sqrt(2), _row_medians(stated))
    known = np.minimum(onsets, config.window)
    independent = [np.maximum(count / config.correlated_frames, 1.0) for count in (known, length)]
    return high - low, spread * np.sqrt(1.0 / independent[0] + 1.0 / independent[1])


def _row_medians(rows: Array) -> Array:
    """(M, W) to the (M,) medians of what is not NaN."""
    count = np.isfinite(rows).sum(axis=1)
    ordered = np.sort(rows, axis=1)
    row = np.arange(len(rows))
    return np.asarray(0.5 * (ordered[row, (count - 1) // 2] + ordered[row, count // 2]))


def _onset(values: Array, near: int, length: int, config: RoadCheckConfig) -> int:
    """The first value after the step: where two levels leave the least absolute deviation."""
    start, stop = max(near - config.window, 0), near + length
    low, high = np.median(values[start:near]), np.median(values[near:stop])
    gain = np.abs(values[start:stop] - high) - np.abs(values[start:stop] - low)
    # Everything before the onset belongs to `low`, all else to `high`: the cost of each cut, up to a constant.
    cost = -np.concatenate([[0.0], np.cumsum(gain)])
    first = max(config.min_frames - start, 1)
    last = min(len(cost) - 1, len(values) - length - start)
    return start + first + int(np.argmin(cost[first : last + 1]))


def _offset(
    values: Array, sigma: Array, axis: int, config: RoadCheckConfig
) -> tuple[int, float, float] | None:
    """Index by which it was certain, size and sigma of a residual beyond the tolerance; None within it."""
    angles = np.deg2rad([config.limit_pitch_deg, config.limit_roll_deg])
    limit = float((config.limit_height_m, *angles)[axis])

    def level(count: int) -> tuple[float, float, bool]:
        size = float(np.median(values[:count]))
        deviation = _mean_sigma(_spread(values[:count], sigma[:count]), count, config)
        return size, deviation, abs(size) - config.certain_sigmas * deviation > limit

    if len(values) < config.min_frames or not level(len(values))[2]:
        return None
    certain = next(count for count in range(config.min_frames, len(values) + 1) if level(count)[2])
    size, deviation, _ = level(len(values))
    return certain - 1, size, deviation


def _filter(
    values: Array, sigma: Array, levels: Array, times_s: Array, config: RoadCheckConfig
) -> tuple[Array, Array]:
    """(N, 3) residuals averaged over the past, each axis a level that creeps and jumps only where a step was found."""
    wander = np.array([config.wander_height_m, *np.deg2rad([config.wander_angle_deg] * 2)]) ** 2
    # Neighbours share their error: each brings so much less.
    noise = np.maximum(sigma, _robust(values - levels)[1]) ** 2 * config.correlated_frames
    state, variance = values[0].copy(), noise[0]
    filtered, deviation = np.empty_like(values), np.empty_like(values)
    for i in range(len(values)):
        if i > 0:
            jump = levels[i] != levels[i - 1]
            predicted = variance + wander * max(times_s[i] - times_s[i - 1], 0.0)
            gain = predicted / (predicted + noise[i])
            state = np.where(jump, values[i], state + gain * (values[i] - state))
            variance = np.where(jump, noise[i], (1.0 - gain) * predicted)
        filtered[i], deviation[i] = state, np.sqrt(variance)
    return filtered, deviation
