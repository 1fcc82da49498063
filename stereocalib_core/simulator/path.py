"""Where the rear axle goes and when: courses made of straights and bends, and the speed along them.

The world frame has x right (east), y down, z forward (north); heading > 0 turns from z towards x.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import fsolve

from stereocalib_core.config.scene import (
    ACCELERATION,
    BEND_RAMP_M,
    BRAKING,
    FRAME_RATE_HZ,
    LATERAL_LIMIT,
    SPEED_MAX,
    STEP_M,
    STOP_S,
)
from stereocalib_core.numeric.arrays import Array


@dataclass(frozen=True)
class Course:
    """A smooth curve sampled every `STEP_M`, all arrays (N,).

    x_m, y_m, z_m: the road surface on the curve. heading_rad: of its tangent, unwrapped. curvature: 1/m,
    > 0 to the right. bank_rad: the road's tilt across, > 0 lowers the right side. closed: end joins start.
    """

    x_m: Array
    y_m: Array
    z_m: Array
    heading_rad: Array
    curvature: Array
    bank_rad: Array
    closed: bool

    @property
    def length_m(self) -> float:
        """From the first to the last sample."""
        return STEP_M * (len(self.x_m) - 1)

    def at(self, values: Array, s_m: ArrayLike) -> Array:
        """One of the arrays at arc lengths s [m]; a closed course goes round, an open one is cut."""
        s = np.asarray(s_m, dtype=np.float64)
        if not self.closed:
            return np.interp(s / STEP_M, np.arange(len(values)), values)
        laps = np.floor(s / self.length_m)
        inside = np.interp((s - laps * self.length_m) / STEP_M, np.arange(len(values)), values)
        return inside + laps * (values[-1] - values[0])

    def points(self, s_m: ArrayLike, t_m: ArrayLike = 0.0) -> Array:
        """(..., 3) world points at arc length s and offset t to the right [m], at the height of the curve."""
        s, t = np.broadcast_arrays(np.asarray(s_m, dtype=np.float64), np.asarray(t_m, dtype=np.float64))
        heading = self.at(self.heading_rad, s)
        x = self.at(self.x_m, s) + t * np.cos(heading)
        z = self.at(self.z_m, s) - t * np.sin(heading)
        return np.stack([x, self.at(self.y_m, s) + t * np.tan(self.at(self.bank_rad, s)), z], axis=-1)


def from_curvature(curvature: Array, closed: bool) -> Course:
    """A flat course from its curvature at every step."""
    heading = np.concatenate([[0.0], np.cumsum(0.5 * (curvature[1:] + curvature[:-1]) * STEP_M)])
    middle = 0.5 * (heading[1:] + heading[:-1])
    x = np.concatenate([[0.0], np.cumsum(np.sin(middle) * STEP_M)])
    z = np.concatenate([[0.0], np.cumsum(np.cos(middle) * STEP_M)])
    zero = np.zeros_like(x)
    if closed:
        # what the sampling leaves open (a few millimetres) is spread over the whole lap
        share = np.linspace(0.0, 1.0, len(x))
        x, z = x - share * (x[-1] - x[0]), z - share * (z[-1] - z[0])
    return Course(x, zero, z, heading, curvature, zero.copy(), closed)


def _bend(angle_deg: float, radius_m: float) -> Array:
    """Curvature of a bend with linear ramps at both ends."""
    peak = 1.0 / radius_m
    arc = np.deg2rad(abs(angle_deg)) / peak - BEND_RAMP_M
    n_ramp, n_arc = round(BEND_RAMP_M / STEP_M), max(round(arc / STEP_M), 1)
    ramp = (np.arange(n_ramp) + 0.5) / n_ramp
    shape = np.concatenate([ramp, np.ones(n_arc), ramp[::-1]])
    shape *= np.deg2rad(angle_deg) / (shape.sum() * STEP_M)
    return shape


def _pieces(pieces: list[tuple[float, float, float]]) -> Array:
    """Curvature of (straight [m], then a bend [deg], with radius [m]) pieces."""
    parts = []
    for straight, angle, radius in pieces:
        parts.append(np.zeros(max(round(straight / STEP_M), 0)))
        if angle:
            parts.append(_bend(angle, radius))
    return np.concatenate(parts)


def town_course() -> Course:
    """The closed loop: about 700 m, five right bends, one left bend, and a gentle double bend."""

    def pieces(free: Array) -> list[tuple[float, float, float]]:
        return [
            (62.0, 90.0, 15.0),
            (free[1], 90.0, 14.0),
            (38.0, -90.0, 21.0),
            (34.0, 90.0, 15.0),
            (70.0, 90.0, 16.0),
            (36.0, 22.0, 45.0),
            (12.0, -22.0, 45.0),
            (62.0, 90.0, 15.0),
            (free[0], 0.0, 0.0),
        ]

    def gap(free: ArrayLike) -> Array:
        """How far the ends are apart; smooth in the straights although they are sampled."""
        free = np.asarray(free, dtype=np.float64)
        whole = np.round(free / STEP_M) * STEP_M
        course = from_curvature(np.append(_pieces(pieces(whole)), 0.0), closed=False)
        rest = free - whole
        first_straight = 90.0
        heading_1 = np.deg2rad(first_straight)
        x = course.x_m[-1] + rest[1] * np.sin(heading_1) + rest[0] * np.sin(course.heading_rad[-1])
        z = course.z_m[-1] + rest[1] * np.cos(heading_1) + rest[0] * np.cos(course.heading_rad[-1])
        return np.array([x, z])

    free = fsolve(gap, np.array([60.0, 60.0]))
    return from_curvature(np.append(_pieces(pieces(free)), 0.0), closed=True)


def curves_course() -> Course:
    """Bend after bend, never straight: 420 m."""
    s = np.arange(0.0, 420.0 + STEP_M, STEP_M)
    wave = 2 * np.pi * s / 84.0
    return from_curvature(0.032 * np.sin(wave) + 0.012 * np.sin(2.3 * wave + 0.7), closed=False)


def straight_course(length_m: float) -> Course:
    """A straight line."""
    return from_curvature(np.zeros(round(length_m / STEP_M) + 1), closed=False)


@dataclass(frozen=True)
class Motion:
    """How the rear axle moves along its course, every array (N,), one entry a frame.

    time_s, s_m, speed, acceleration (along), lateral (acceleration to the right) in SI units.
    """

    time_s: Array
    s_m: Array
    speed: Array
    acceleration: Array
    lateral: Array


def drive_along(course: Course, start_speed: float, stop_at_m: float | None) -> Motion:
    """The speed profile: bends slow the car, straights let it go, and it may stop once and start again."""
    s: Array = STEP_M * np.arange(len(course.x_m), dtype=np.float64)
    limit = np.minimum(SPEED_MAX, np.sqrt(LATERAL_LIMIT / np.maximum(np.abs(course.curvature), 1e-4)))
    limit[0] = min(limit[0], start_speed)
    if course.closed:
        limit[-1] = min(limit[-1], start_speed)
    halt = None if stop_at_m is None else round(stop_at_m / STEP_M)
    if halt is not None:
        limit[halt] = 0.1
    v2 = limit**2
    for i in range(1, len(v2)):
        v2[i] = min(v2[i], v2[i - 1] + 2 * ACCELERATION * STEP_M)
    for i in range(len(v2) - 2, -1, -1):
        v2[i] = min(v2[i], v2[i + 1] + 2 * BRAKING * STEP_M)
    t = np.concatenate([[0.0], np.cumsum(2 * STEP_M / (np.sqrt(v2[1:]) + np.sqrt(v2[:-1])))])
    if halt is not None:
        t[halt + 1 :] += STOP_S
    return _timed(course, t, s)


def constant_speed(course: Course, speed: float, wave: float = 0.0) -> Motion:
    """Drive at `speed` [m/s], with a slow variation of amplitude `wave` [m/s]."""
    s: Array = STEP_M * np.arange(len(course.x_m), dtype=np.float64)
    v = speed + wave * np.sin(2 * np.pi * s / 60.0)
    return _timed(course, np.concatenate([[0.0], np.cumsum(STEP_M / v[1:])]), s)


def _timed(course: Course, t: Array, s: Array) -> Motion:
    """Smooth s(t) on a fine clock and read it once a frame."""
    fine = 0.01
    clock = np.arange(0.0, t[-1], fine)
    position = np.interp(clock, t, s)
    # odd extension keeps the speed at both ends
    position = gaussian_filter1d(
        np.concatenate(
            [2 * position[0] - position[200:0:-1], position, 2 * position[-1] - position[-2:-202:-1]]
        ),
        0.35 / fine,
    )[200:-200]
    speed = np.gradient(position, fine)
    acceleration = np.gradient(speed, fine)
    pick = slice(0, None, round(1 / FRAME_RATE_HZ / fine))
    lateral = speed**2 * course.at(course.curvature, position)
    frames = np.arange(len(clock[pick])) / FRAME_RATE_HZ
    return Motion(frames, position[pick], speed[pick], acceleration[pick], lateral[pick])
