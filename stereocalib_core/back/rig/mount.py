"""How the camera is mounted: what remains of height, pitch and roll when the body's own motion is taken out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stereocalib_core.back.rig.body_motion import MotionSeries, remove_explained
from stereocalib_core.back.rig.over_wheels import over_wheels
from stereocalib_core.config import MountConfig
from stereocalib_core.config.back import WheelsConfig
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.robust import cauchy_mean, mad_sigma
from stereocalib_core.results import FrameResult, Measured, Rig, Shift, estimates


def estimate_mount(
    results: Sequence[FrameResult],
    motion: MotionSeries | None = None,
    yaw: Measured | None = None,
    lever_arm: Measured | None = None,
    shifts: Sequence[Shift] = (),
    config: MountConfig | None = None,
    road_under: WheelsConfig | None = None,
) -> Rig:
    """The rig as this drive leaves it, from each pair's own values.

    With `motion` the means are of steady driving, over the road under the wheels where the path is known, with
    what acceleration explains taken out. After a step
    among `shifts` only the frames since then count, axis by axis. Axes without any measurement are None.
    """
    config = config or MountConfig()
    floors = (config.floor_height_m, *np.deg2rad([config.floor_angle_deg] * 2).tolist())
    values = estimates(results)
    steady = np.ones(len(results), dtype=bool)
    if motion is not None and len(results):
        wheels = over_wheels(values, motion, road_under)
        # A drive of a few metres never comes to where it saw the road.
        values = remove_explained(wheels if np.isfinite(wheels).any() else values, motion)
        steady = motion.steady
    frames = np.array([r.frame for r in results], dtype=np.int64)
    axes = []
    for k, axis in enumerate(("height", "pitch", "roll")):
        since = max((s.frame for s in shifts if s.axis == axis and s.kind == "step"), default=-1)
        known = np.isfinite(values[:, k]) & (frames >= since)
        chosen = known & steady if (known & steady).sum() >= 2 * config.alike_frames else known
        axes.append(_mean(values[chosen, k], floors[k], config.alike_frames))
    return Rig(axes[0], axes[1], axes[2], yaw, lever_arm)


def _mean(values: Array, least_sigma: float, alike: int) -> Measured | None:
    """Robust mean; its sigma from the scatter of block means, so that slow swings count as what they are."""
    if len(values) == 0:
        return None
    centre = float(np.median(values))
    spread = max(mad_sigma(values, centre), 1e-12)
    centre = cauchy_mean(values, centre, spread)
    count = len(values) // alike
    if count >= 4:
        blocks = np.median(values[: count * alike].reshape(count, alike), axis=1)
        sigma = mad_sigma(blocks, None) / np.sqrt(count)
    else:
        sigma = spread / np.sqrt(max(len(values) / alike, 1.0))
    return Measured(centre, float(np.hypot(sigma, least_sigma)))
