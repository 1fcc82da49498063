"""How the camera is mounted: what remains of height, pitch and roll when the body's own motion is taken out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stereocalib_core.back.rig.body_motion import MotionSeries, remove_explained
from stereocalib_core.back.rig.over_wheels import over_wheels
from stereocalib_core.config import FilterConfig, PipelineConfig
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.robust import cauchy_mean, mad_sigma
from stereocalib_core.results import FrameResult, Measured, Rig, Shift, estimates


def estimate_mount(
    results: Sequence[FrameResult],
    motion: MotionSeries | None = None,
    yaw: Measured | None = None,
    lever_arm: Measured | None = None,
    shifts: Sequence[Shift] = (),
    config: PipelineConfig | None = None,
) -> Rig:
    """The rig as this drive leaves it, from each pair's own values.

    With `motion` the means are of steady driving, over the road under the wheels where the path is known, with what
    acceleration explains taken out. After a step among `shifts` only the frames since then count, axis by axis. Axes
    without any measurement are None. `note` says so where a few seconds are all there is.
    """
    config = config or PipelineConfig()
    rules = config.mount
    values, own = estimates(results), _own_sigma(results)
    steady = np.ones(len(results), dtype=bool)
    if motion is not None and len(results):
        wheels = over_wheels(values, motion, config.shift_alarm.wheels)
        # A drive of a few metres, or of wide steps, hardly ever comes to where it saw the road.
        seen_again = np.isfinite(wheels).all(axis=1).sum()
        enough = seen_again >= max(rules.min_frames, 0.5 * np.isfinite(values).all(axis=1).sum())
        values = remove_explained(wheels if enough else values, motion)
        steady = motion.steady
    frames = np.array([r.frame for r in results], dtype=np.int64)
    block = frames_alike(np.array([r.timestamp_s for r in results], dtype=np.float64), rules.alike_s)
    floors = (rules.floor_height_m, *np.deg2rad([rules.floor_angle_deg] * 2).tolist())
    axes, fewest = [], len(results)
    for k, axis in enumerate(("height", "pitch", "roll")):
        since = max((s.frame for s in shifts if s.axis == axis and s.kind == "step"), default=-1)
        known = np.isfinite(values[:, k]) & (frames >= since)
        chosen = known & steady if (known & steady).sum() >= 2 * block else known
        fewest = min(fewest, int(chosen.sum()))
        swing = body_swing(config.filter)[k]
        axes.append(_mean(values[chosen, k], own[:, k], swing, floors[k], block, rules.prior_blocks))
    note = None
    if 0 < fewest < 2 * block:
        note = (
            f"from {fewest} frame{'s' * (fewest > 1)}: {rules.alike_s:g} s of driving are one look at the mount, for "
            "the body swings meanwhile; sigma says so, a longer drive says more"
        )
    return Rig(axes[0], axes[1], axes[2], yaw, lever_arm, note)


def body_swing(config: FilterConfig) -> tuple[float, float, float]:
    """1 sigma of height [m], pitch, roll [rad] by which springs and rest pose are off in a short stretch."""
    pitch, roll, rest = np.deg2rad([config.body_pitch_deg, config.body_roll_deg, config.rest_angle_deg])
    height = np.hypot(config.body_height_m, config.rest_height_m)
    return float(height), float(np.hypot(pitch, rest)), float(np.hypot(roll, rest))


def frames_alike(times_s: Array, alike_s: float) -> int:
    """How many frames of a drive lie within `alike_s`, at least one."""
    if len(times_s) < 2:
        return 1
    dt = float(np.median(np.diff(times_s)))
    return max(round(alike_s / dt), 1) if dt > 0 else 1


def _own_sigma(results: Sequence[FrameResult]) -> Array:
    """(N, 3) what each pair says of itself, NaN where it shows no road."""
    rows = [np.full(3, np.nan) if r.road is None else r.road.sigma for r in results]
    return np.array(rows, dtype=np.float64).reshape(-1, 3)


def _mean(
    values: Array, own_sigma: Array, swing: float, floor: float, block: int, prior_blocks: float
) -> Measured | None:
    """Robust mean with what it is worth.

    Frames within `block` share the body's pose and the road's shape, so that blocks are the looks that count. How
    much looks differ is told by their scatter, and by `swing` as far as there are few of them; on top comes what the
    pairs say of themselves, own_sigma (M,), NaN where they say nothing.
    """
    if len(values) == 0:
        return None
    centre = float(np.median(values))
    spread = max(mad_sigma(values, centre), 1e-12)
    centre = cauchy_mean(values, centre, spread)
    looks = max(len(values) / block, 1.0)
    count = len(values) // block
    scatter = spread
    if count >= 4:
        scatter = mad_sigma(np.median(values[: count * block].reshape(count, block), axis=1), None)
    free = looks - 1.0
    variance = (prior_blocks * swing**2 + free * scatter**2) / (prior_blocks + free)
    variance += float(np.nanmedian(own_sigma)) ** 2
    return Measured(centre, float(np.sqrt(variance / looks + floor**2)))
