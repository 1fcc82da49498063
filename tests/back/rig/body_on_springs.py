"""A car's body for the tests of this folder: manoeuvres, an uneven road, measurements of known noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stereocalib_core.back.rig.shift_alarm import MotionSeries
from stereocalib_core.geometry import Extrinsics, StereoCamera
from stereocalib_core.results import FrameResult, RoadEstimate

CAMERA = StereoCamera(1242, 375, 721.5, 609.6, 172.9, 0.537)
MOUNT = np.array([1.65, np.deg2rad(0.8), np.deg2rad(-0.4)])
DIRECT = (0.003, float(np.deg2rad(0.012)), float(np.deg2rad(0.012)))
PAPER = (0.02, float(np.deg2rad(0.08)), float(np.deg2rad(0.08)))


@dataclass(frozen=True)
class Ride:
    """truth: (N, 3) height, pitch, roll. motion: what the car does meanwhile."""

    time_s: np.ndarray
    truth: np.ndarray
    motion: MotionSeries


def spring(target: np.ndarray, dt: float = 0.1) -> np.ndarray:
    """A damped spring's answer to its resting value."""
    fine, omega, x, v = 20, 2 * np.pi * 1.4, float(target[0]), 0.0
    answer = np.empty(len(target))
    for i, goal in enumerate(target):
        answer[i] = x
        for _ in range(fine):
            v += dt / fine * (omega**2 * (goal - x) - 0.7 * omega * v)
            x += dt / fine * v
    return answer


def ride(frames: int = 600, seed: int = 0, straight: bool = False) -> Ride:
    """Straights, bends (0.2 deg of roll per m/s^2), braking (0.22 deg of pitch per m/s^2), road noise."""
    rng = np.random.default_rng([seed, 5])
    t = 0.1 * np.arange(frames)
    phase = (t / 12.0) % 1.0
    lateral = np.where((phase > 0.5) & (phase < 0.75), 2.2, 0.0) * (-1.0) ** np.floor(t / 12.0)
    braking = np.where((phase > 0.38) & (phase < 0.5), -1.8, 0.0) + np.where(phase > 0.86, 1.5, 0.0)
    if straight:
        lateral, braking = 0.0 * lateral, 0.0 * braking
    soften = np.ones(6) / 6
    lateral, braking = np.convolve(lateral, soften, "same"), np.convolve(braking, soften, "same")
    speed = np.maximum(9.0 + 0.1 * np.cumsum(braking), 3.0)
    truth = np.tile(MOUNT, (frames, 1))
    for axis, size in enumerate((0.006, np.deg2rad(0.09), np.deg2rad(0.06))):
        white = rng.standard_normal((2, frames + 100))
        fast = np.convolve(white[0], [0.3, 0.6, 0.3, -0.2, -0.5, -0.2], "same")
        slow = np.convolve(white[1], np.hanning(40) / 4.0, "same")
        truth[:, axis] += size * (0.8 * fast + 0.57 * slow)[50 : frames + 50]
    truth[:, 1] += spring(np.deg2rad(0.22) * -braking)
    truth[:, 2] += spring(np.deg2rad(0.20) * lateral)
    return Ride(t, truth, MotionSeries(t, speed, lateral / np.maximum(speed, 1.0)))


def measure(
    truth: np.ndarray, sigma: tuple[float, float, float], seed: int = 1
) -> tuple[np.ndarray, np.ndarray]:
    """(N, 3) measurements and their (3, 3) covariance; half of the height's error goes with the pitch's."""
    correlation = np.array([[1.0, 0.5, 0.0], [0.5, 1.0, 0.0], [0.0, 0.0, 1.0]])
    covariance = correlation * np.outer(sigma, sigma)
    noise = np.random.default_rng([seed, 6]).standard_normal(truth.shape) @ np.linalg.cholesky(covariance).T
    return truth + noise, covariance


def as_results(
    z: np.ndarray, covariance: np.ndarray, time_s: np.ndarray, failed: range | tuple[int, ...] = ()
) -> list[FrameResult]:
    """Frames as the front end gives them."""
    results = []
    for i, (t, (h, p, r)) in enumerate(zip(time_s.tolist(), z.tolist(), strict=True)):
        road = RoadEstimate(Extrinsics(h, p, r), covariance, 1000, 0.5, (4.0, 20.0))
        results.append(FrameResult(i, t, None if i in failed else road))
    return results
