"""Is the stereo pair itself still calibrated over the drive? What every frame's rows said, put together.

What rows can tell and what they cannot: see `front.rows.self_check`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.config import RectificationConfig
from stereocalib_core.errors import FailureReason
from stereocalib_core.geometry import StereoCamera
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.robust import SIGMA_PER_MAD
from stereocalib_core.results import FrameResult, Measured, Pair

Verdict = Literal["good", "suspect", "bad"]


def robust_mean(values: Array, sigma: Array) -> tuple[Array, Array]:
    """Column means and their standard deviations of (N, K) values with (N, K) sigma, outliers bounded."""
    centre = np.median(values, axis=0)
    spread = np.maximum(SIGMA_PER_MAD * np.median(np.abs(values - centre), axis=0), 1e-12)
    weights = np.ones_like(values)
    for _ in range(8):
        weights = 1.0 / ((1.0 + ((values - centre) / (3.0 * spread)) ** 2) * (sigma**2 + spread**2))
        centre = (weights * values).sum(axis=0) / weights.sum(axis=0)
    scatter = (weights * (values - centre) ** 2).sum(axis=0) / weights.sum(axis=0)
    # Matches of neighbouring frames share their scene: one independent look in four frames; and never better
    # than 0.1 of one frame's own sigma, because of the lens distortion that the model leaves out.
    count = max(len(values) / 4.0, 1.0)
    return centre, np.sqrt(scatter / count + (0.1 * np.median(sigma, axis=0)) ** 2)


def _worst_part(values_deg: Array, window: int) -> NDArray[np.bool_]:
    """Which of (N, 2) pitch, roll belong to the state furthest from zero, if there are two states."""
    n = len(values_deg)
    everything = np.ones(n, dtype=bool)
    if n < 2 * window:
        return everything
    medians = np.median(np.lib.stride_tricks.sliding_window_view(values_deg, window, axis=0), axis=-1)
    scale = np.array([1.0, 0.5])
    sizes = np.abs(medians * scale).max(axis=1)
    worst, mildest = medians[int(np.argmax(sizes))], medians[int(np.argmin(sizes))]
    apart = np.abs((worst - mildest) * scale).max()
    noise = SIGMA_PER_MAD * np.median(np.abs(np.diff(values_deg * scale, axis=0)), axis=0).max()
    if apart < max(0.02, 2.0 * noise):
        return everything
    distance = np.abs((values_deg - worst) * scale).max(axis=1)
    return np.asarray(distance < 0.5 * apart)


def summarise(
    camera: StereoCamera, results: Sequence[FrameResult], config: RectificationConfig | None = None
) -> Pair:
    """The pair over a drive, from what every frame measured; where it changed on the way, its worse part."""
    config = config or RectificationConfig()
    swapped = [
        r.frame for r in results if r.failure is not None and r.failure.reason is FailureReason.SWAPPED
    ]
    measured = [(r.frame, r.rectification) for r in results if r.rectification is not None]
    if len(swapped) > max(2, 0.5 * len(results)) or (swapped and not measured):
        why = f"left and right are swapped: negative disparities in {len(swapped)} of {len(results)} frames"
        return Pair("bad", why, rows_verdict="bad", rows_why=why)
    if len(measured) < config.min_frames:
        why = f"only {len(measured)} of {len(results)} frames could be matched: not measured"
        return Pair("suspect", why, rows_verdict="suspect", rows_why=why)
    frames = np.array([frame for frame, _ in measured])
    values = np.array([s.values for _, s in measured])
    sigma = np.sqrt(np.array([np.diag(s.covariance) for _, s in measured]))
    part = _worst_part(np.rad2deg(values[:, 1:]), config.window)
    mean, error = robust_mean(values[part], sigma[part])
    keystone = float(np.median([s.keystone_rad for (_, s), used in zip(measured, part, strict=True) if used]))
    pitch, roll = np.rad2deg(mean[1:])
    pitch_error, roll_error = np.rad2deg(error[1:])
    verdict: Verdict = "good"
    if abs(pitch) > config.suspect_pitch_deg or abs(roll) > config.suspect_roll_deg:
        verdict = "suspect"
    if abs(pitch) > config.bad_pitch_deg or abs(roll) > config.bad_roll_deg:
        verdict = "bad"
    first, last = int(frames[part][0]), int(frames[part][-1])
    why = (
        f"rows of left and right differ by {mean[0]:+.2f} px, as of a relative pitch of {pitch:+.3f} +- "
        f"{pitch_error:.3f} deg (good up to {config.suspect_pitch_deg:g}), relative roll {roll:+.3f} +- "
        f"{roll_error:.3f} deg (good up to {config.suspect_roll_deg:g})"
    )
    if not part.all():
        why += f", in frames {first} to {last}; the rest of the drive differs"
    if swapped:
        why += f"; left and right swapped in {len(swapped)} frames from {swapped[0]} on"
        verdict = "suspect" if verdict == "good" else verdict
    if abs(np.rad2deg(keystone)) > 0.1:
        why += f"; keystone as of a relative yaw of {np.rad2deg(keystone):+.2f} deg (or a principal point)"
    offset, relative_pitch, relative_roll = (
        Measured(float(value), float(sigma)) for value, sigma in zip(mean, error, strict=True)
    )
    return Pair(
        verdict,
        why,
        offset,
        relative_pitch,
        relative_roll,
        keystone_rad=keystone,
        frames=len(measured),
        first=first,
        last=last,
        rows_verdict=verdict,
        rows_why=why,
    )
