"""What the car's own motion explains of its body: pitch by braking, roll by cornering, with unknown gains."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from stereocalib_core.back.odometry.packing import PackedTracks
from stereocalib_core.back.odometry.trajectory import Trajectory
from stereocalib_core.config import VehicleConfig
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.robust import cauchy_weights, mad_sigma

_SMOOTH = np.array([-2.0, 3.0, 6.0, 7.0, 6.0, 3.0, -2.0]) / 21.0
"""Quadratic smoothing over seven frames."""


@dataclass(frozen=True)
class MotionSeries:
    """What the car does, one entry a frame, NaN = unknown.

    timestamps_s, speed [m/s, forwards], yaw_rate [rad/s, > 0 turns right], all (N,).
    poses: (N, 4, 4) T_world_camera, or None. tracked: (N,) whether a frame's pose was measured from the one
    before; None = all were. vehicle: the car whose motion it is.
    """

    timestamps_s: Array
    speed: Array
    yaw_rate: Array
    poses: Array | None = None
    tracked: NDArray[np.bool_] | None = None
    vehicle: VehicleConfig = VehicleConfig()

    @classmethod
    def from_path(
        cls, timestamps_s: Array, path: Trajectory, tracks: PackedTracks, vehicle: VehicleConfig | None = None
    ) -> MotionSeries:
        """From the odometry of a drive; timestamps_s: (N,)."""
        has_pair = tracks.previous >= 0
        measured = path.measured & has_pair
        dt = np.maximum(timestamps_s - timestamps_s[np.maximum(tracks.previous, 0)], 1e-3)
        speed = np.where(measured, path.planar[:, 1] / dt, np.nan)
        yaw_rate = np.where(measured, path.planar[:, 2] / dt, np.nan)
        tracked = path.tracked.copy()
        tracked[1:] &= tracks.previous[1:] == np.arange(len(tracks) - 1)
        return cls(timestamps_s, speed, yaw_rate, path.poses, tracked, vehicle or VehicleConfig())

    @cached_property
    def turns(self) -> Array:
        """(N,) how far the camera turns right about its own vertical in each pair [rad]; NaN where unknown."""
        dt = np.diff(self.timestamps_s, prepend=self.timestamps_s[:1])
        if self.poses is None:
            return np.asarray(self.yaw_rate * dt)
        result = np.full(len(self.poses), np.nan)
        for i in range(1, len(self.poses)):
            if self.tracked is None or self.tracked[i]:
                turn = self.poses[i - 1, :3, :3].T @ self.poses[i, :3, :3]
                result[i] = np.arctan2(turn[0, 2], turn[2, 2])
        return result

    @property
    def longitudinal(self) -> Array:
        """(N,) acceleration along the car [m/s^2], smoothed; 0 where unknown."""
        speed = _smooth(_filled(self.speed))
        if len(speed) < 2:
            return np.zeros(len(speed))
        return np.gradient(speed, np.maximum.accumulate(self.timestamps_s) + 1e-9 * np.arange(len(speed)))

    @property
    def lateral(self) -> Array:
        """(N,) acceleration to the right [m/s^2], smoothed; 0 where unknown."""
        return _smooth(_filled(self.speed) * _filled(self.yaw_rate))

    @property
    def steady(self) -> NDArray[np.bool_]:
        """(N,) known, straight, and neither braked nor pushed hard."""
        known = np.isfinite(self.speed) & np.isfinite(self.yaw_rate)
        braked = np.abs(self.longitudinal) >= self.vehicle.steady_braking_m_s2
        return known & ~braked & (np.abs(self.lateral) < self.vehicle.steady_cornering_m_s2)


def _filled(values: Array) -> Array:
    known = np.isfinite(values)
    if not known.any():
        return np.zeros(len(values))
    return np.interp(np.arange(len(values)), np.flatnonzero(known), values[known])


def _smooth(values: Array) -> Array:
    if len(values) < len(_SMOOTH):
        return values
    # A knock of the camera spoils one pair's motion: a median first, so that it is no braking.
    padded = np.pad(median_filter(values, size=5, mode="nearest"), len(_SMOOTH) // 2, mode="edge")
    return np.convolve(padded, _SMOOTH[::-1], "valid")


def _sprung(target: Array, dt_s: float, vehicle: VehicleConfig) -> Array:
    """The answer of the vehicle's springs to (N,) resting values."""
    w, fine = 2.0 * np.pi * vehicle.natural_hz, 12
    result, x, v = np.empty(len(target)), float(target[0]) if len(target) else 0.0, 0.0
    for i, goal in enumerate(target.tolist()):
        result[i] = x
        for _ in range(fine):
            v += dt_s / fine * (w * w * (goal - x) - 2.0 * vehicle.damping * w * v)
            x += dt_s / fine * v
    return result


def remove_explained(values: Array, motion: MotionSeries) -> Array:
    """(N, 3) height, pitch, roll without what acceleration along and across explains.

    The gains are fitted to differences over half a second, robustly: a step of the mount touches few of them.
    """
    dt = float(np.clip(np.median(np.diff(motion.timestamps_s)), 0.02, 0.5)) if len(values) > 1 else 0.1
    result = values.copy()
    lag = max(2, round(0.5 / dt))
    lean = float(np.deg2rad(motion.vehicle.lean_sigma_deg))
    if len(values) <= 3 * lag:
        return result
    for axis, cause in ((1, motion.longitudinal), (2, motion.lateral)):
        cause = _sprung(cause, dt, motion.vehicle)
        dx, dc = values[lag:, axis] - values[:-lag, axis], cause[lag:] - cause[:-lag]
        known = np.isfinite(dx)
        dx, dc = dx[known], dc[known]
        if len(dx) < 10:
            continue
        gain = 0.0
        for _ in range(15):
            residual = dx - gain * dc
            scale = max(mad_sigma(residual), 1e-6)
            weight = cauchy_weights(residual, scale) / scale**2
            gain = float((weight * dc * dx).sum() / ((weight * dc * dc).sum() + 1.0 / lean**2))
        result[:, axis] -= gain * cause
    return result
