"""The car's body on its springs: how pitch, roll and height of the camera move about the mount."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from stereocalib_core.config.scene import (
    DAMPING,
    FRAME_RATE_HZ,
    LOAD,
    NATURAL_HZ,
    PITCH_PER_BRAKING,
    ROLL_PER_LATERAL,
    ROUGH,
)
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.simulator.path import Motion


@dataclass(frozen=True)
class BodyMotion:
    """Additions to the mount, every array (N,): height_m, pitch_rad, roll_rad."""

    height_m: Array
    pitch_rad: Array
    roll_rad: Array


def ride(motion: Motion, amount: float, load: float, seed: int) -> BodyMotion:
    """The body's motion along a drive; `amount` 0 is a rigid car, `load` 1 a full boot."""
    n = len(motion.time_s)
    rng = np.random.default_rng([seed, 21])
    height = np.full(n, load * LOAD[0])
    pitch = np.full(n, load * LOAD[1])
    roll = np.full(n, load * LOAD[2])
    if amount > 0:
        rough = [_filtered_noise(n, rng) * size * np.minimum(motion.speed / 8.0, 1.2) for size in ROUGH]
        height = height + amount * rough[0]
        pitch = pitch + amount * (spring(-PITCH_PER_BRAKING * motion.acceleration) + rough[1])
        roll = roll + amount * (spring(ROLL_PER_LATERAL * motion.lateral) + rough[2])
    return BodyMotion(height, pitch, roll)


def spring(target: Array) -> Array:
    """The answer of a damped spring to its resting value over frames: (N,) to (N,), starts at rest."""
    if len(target) == 0:
        return target
    fine = 20
    dt = 1.0 / FRAME_RATE_HZ / fine
    omega = 2 * np.pi * NATURAL_HZ
    goal = np.interp(np.arange(fine * len(target)) / fine, np.arange(len(target)), target)
    result = np.empty(len(target))
    x, v = float(target[0]), 0.0
    for i, g in enumerate(goal.tolist()):
        if i % fine == 0:
            result[i // fine] = x
        v += dt * (omega**2 * (g - x) - 2 * DAMPING * omega * v)
        x += dt * v
    return result


def _filtered_noise(n: int, rng: np.random.Generator) -> Array:
    """(n,) of unit standard deviation: bounce of about a hertz and slower waves of the road."""
    white = rng.standard_normal(n + 200)
    fast = gaussian_filter1d(white, 1.2) - gaussian_filter1d(white, 6.0)
    slow = gaussian_filter1d(rng.standard_normal(n + 200), 12.0)
    mixed = (fast / fast.std() + 0.7 * slow / slow.std())[100:-100]
    return mixed / 1.22
