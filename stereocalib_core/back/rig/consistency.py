"""Frames whose road this rig cannot have stood on: measured well, but not the road of the frames around them.

In a turn a lawn, a pavement or the crossing street may fill the view for a second, planar and connected, and be
measured to the millimetre. What it cannot do is agree with the road before and after. A knocked rig can: from the
knock on it agrees with what follows, so a frame is compared with both sides and the kinder one counts.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from stereocalib_core.config import ConsistencyConfig, RegionConfig
from stereocalib_core.errors import Failure, FailureReason
from stereocalib_core.numeric.arrays import Array, Mask
from stereocalib_core.results import FrameResult, estimates

AXES = (
    ("height", "m", 1.0, 2),
    ("pitch", "deg", float(np.rad2deg(1.0)), 1),
    ("roll", "deg", float(np.rad2deg(1.0)), 1),
)


def consistent(results: Sequence[FrameResult], config: ConsistencyConfig) -> list[FrameResult]:
    """The same results, those that contradict their neighbours INCONSISTENT, with by how much."""
    values = estimates(results)
    sigma = np.full_like(values, np.nan)
    for i, result in enumerate(results):
        if result.road is not None:
            sigma[i] = result.road.sigma
    measured: Mask = np.asarray(np.isfinite(values).all(axis=1))
    kept = measured
    around = np.full_like(values, np.nan)
    # What was left out no longer speaks for its neighbours: once more without it.
    for _ in range(config.rounds):
        around = _around(values, kept, config)
        found = measured & ~_contradicts(values - around, sigma, around[:, 0], config)
        if np.array_equal(found, kept):
            break
        kept = found
    checked = list(results)
    for i in np.flatnonzero(measured & ~kept).tolist():
        detail = _told(values[i], around[i], sigma[i], config)
        checked[i] = dataclasses.replace(
            results[i], road=None, failure=Failure(FailureReason.INCONSISTENT, detail)
        )
    return checked


def near_smoothed(
    results: Sequence[FrameResult], smoothed: Array, config: ConsistencyConfig
) -> list[FrameResult]:
    """The same against (N, 3) height [m], pitch, roll [rad] of the smoothed rig at each frame."""
    checked = list(results)
    for i, result in enumerate(results):
        if result.road is None or not np.isfinite(smoothed[i]).all():
            continue
        value, sigma = estimates([result]), result.road.sigma[None]
        near = dataclasses.replace(
            config,
            height=min(config.near_height, config.near_height_m / smoothed[i, 0]),
            pitch_deg=config.near_angle_deg,
            roll_deg=config.near_angle_deg,
            sigmas=config.near_sigmas,
        )
        if _contradicts(value - smoothed[i], sigma, smoothed[i, :1], near)[0]:
            detail = _told(value[0], smoothed[i], sigma[0], near)
            checked[i] = dataclasses.replace(
                result, road=None, failure=Failure(FailureReason.INCONSISTENT, detail)
            )
    return checked


def settled(
    results: Sequence[FrameResult], config: ConsistencyConfig, region: RegionConfig
) -> list[FrameResult]:
    """The same results; the doubts of pairs that had nothing before them as far as the frames after contradict.

    A drive's first pair can't tell its road from a plane beside it. The frames after come over that road, until they
    have no doubt of their own: what lies no farther from the first of those than a rig's road may lie from that of a
    moment ago is the road as surely as theirs is. Of a doubt is left what it takes to bring both together.
    """
    settled = list(results)
    values = estimates(results)
    sure = np.array([r.road is not None and r.road.alone == (0.0, 0.0) for r in results], dtype=bool)
    for i, result in enumerate(results):
        if result.road is None or sure[i]:
            continue
        after = i + 1 + np.flatnonzero(sure[i + 1 : i + 1 + config.reach])[: config.settling]
        if len(after) < config.least_frames:
            continue
        road = result.road
        measured = dataclasses.replace(road, alone=(0.0, 0.0))
        middle = np.median(values[after], axis=0)
        apart = [region.past_height * middle[0], region.past_pitch_rad, region.past_roll_rad]
        beyond = np.maximum(np.abs(values[i] - middle) - np.hypot(measured.sigma, apart), 0.0)
        doubted = dataclasses.replace(road, bend=(0.0, 0.0), along=(0.0, 0.0), crossfall_rad=0.0)
        doubt = np.sqrt(np.diag(doubted.bend_covariance))
        share = np.divide(beyond, doubt, out=np.where(beyond > 0.0, 1.0, 0.0), where=doubt > 0.0)
        left = float(min(share.max(), 1.0))
        alone = (left * road.alone[0], left * road.alone[1])
        settled[i] = dataclasses.replace(result, road=dataclasses.replace(road, alone=alone))
    return settled


def _around(values: Array, kept: Mask, config: ConsistencyConfig) -> Array:
    """(N, 3) the rig by the frames around: the median of either side that speaks, whichever is nearer; NaN: none."""
    n = len(values)
    around = np.full_like(values, np.nan)
    places = np.flatnonzero(kept)
    for i in range(n):
        first, after = np.searchsorted(places, [i, i + 1])
        sides = [places[max(first - config.window, 0) : first], places[after : after + config.window]]
        sides = [side[np.abs(side - i) <= config.reach] for side in sides]
        speaking = [side for side in sides if len(side) >= config.least_side]
        if not speaking:
            both = np.concatenate(sides)
            if len(both) < config.least_frames:
                continue
            speaking = [both]
        medians = np.array([np.median(values[side], axis=0) for side in speaking])
        off = np.abs(medians - values[i]) / _limits(medians[:, 0], config)
        around[i] = medians[int(np.argmin(off.max(axis=1)))]
    return around


def _limits(height_m: float | Array, config: ConsistencyConfig) -> Array:
    """(..., 3) how far height [m], pitch, roll [rad] may be from those around, at height `height_m`."""
    height = config.height * np.asarray(height_m)
    pitch, roll = np.deg2rad([config.pitch_deg, config.roll_deg])
    return np.stack([height, np.full_like(height, pitch), np.full_like(height, roll)], axis=-1)


def _contradicts(off: Array, sigma: Array, height_m: Array, config: ConsistencyConfig) -> Mask:
    beyond = (np.abs(off) > _limits(height_m, config)) & (np.abs(off) > config.sigmas * sigma)
    return np.asarray(beyond.any(axis=1))


def _told(value: Array, around: Array, sigma: Array, config: ConsistencyConfig) -> str:
    off = np.abs(value - around) / _limits(around[0], config)
    axis = int(np.argmax(off))
    name, unit, scale, digits = AXES[axis]
    here, there = scale * value[axis], scale * around[axis]
    times = abs(here - there) / (scale * sigma[axis])
    return (
        f"{name} {here:.{digits}f} {unit} where the frames around have {there:.{digits}f}: "
        f"{here - there:+.{digits}f} {unit}, {times:.0f} sigma"
    )
