"""Is the stereo pair itself still calibrated over the drive? What every frame's rows said, put together.

What rows can tell and what they cannot: see `front.rows.self_check`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.config import RectificationConfig
from stereocalib_core.errors import FailureReason
from stereocalib_core.geometry import StereoCamera
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.robust import SIGMA_PER_MAD
from stereocalib_core.results import FrameResult

Verdict = Literal["good", "suspect", "bad"]


@dataclass(frozen=True)
class RectificationReport:
    """The pair over a whole drive; each value with its standard deviation, NaN where nothing was measured.

    row_offset_px: right row minus left row at the principal point [px].
    relative_pitch_rad: the same as an angle, > 0: the right camera looks further down.
    relative_roll_rad: > 0: the right picture's rows fall to the right.
    keystone_rad: the part of dv that goes with u v / f, as the relative yaw that it would be.
    frames: how many frames were measured. first, last: the frames that the values speak of.
    """

    row_offset_px: float
    row_offset_sigma_px: float
    relative_pitch_rad: float
    relative_pitch_sigma_rad: float
    relative_roll_rad: float
    relative_roll_sigma_rad: float
    keystone_rad: float
    frames: int
    first: int
    last: int
    verdict: Verdict
    why: str

    def as_report(self) -> dict[str, Any]:
        """The block `rectification` of report.json: degrees, null where nothing was measured."""

        def pair(value: float, sigma: float) -> dict[str, float] | None:
            return {"value": value, "sigma": sigma} if np.isfinite(value) else None

        degrees = np.rad2deg
        return {
            "row_offset_px": pair(self.row_offset_px, self.row_offset_sigma_px),
            "relative_pitch_deg": pair(
                float(degrees(self.relative_pitch_rad)), float(degrees(self.relative_pitch_sigma_rad))
            ),
            "relative_roll_deg": pair(
                float(degrees(self.relative_roll_rad)), float(degrees(self.relative_roll_sigma_rad))
            ),
            "verdict": self.verdict,
            "why": self.why,
        }


def _robust_mean(values: Array, sigma: Array) -> tuple[Array, Array]:
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
) -> RectificationReport:
    """The pair over a drive, from what every frame measured; where it changed on the way, its worse part."""
    config = config or RectificationConfig()
    swapped = [
        r.frame for r in results if r.failure is not None and r.failure.reason is FailureReason.SWAPPED
    ]
    measured = [(r.frame, r.rectification) for r in results if r.rectification is not None]
    if len(swapped) > max(2, 0.5 * len(results)) or (swapped and not measured):
        why = f"left and right are swapped: negative disparities in {len(swapped)} of {len(results)} frames"
        return _empty("bad", why)
    if len(measured) < config.min_frames:
        return _empty(
            "suspect", f"only {len(measured)} of {len(results)} frames could be matched: not measured"
        )
    frames = np.array([frame for frame, _ in measured])
    values = np.array([s.values for _, s in measured])
    sigma = np.sqrt(np.array([np.diag(s.covariance) for _, s in measured]))
    part = _worst_part(np.rad2deg(values[:, 1:]), config.window)
    mean, error = _robust_mean(values[part], sigma[part])
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
    return RectificationReport(
        float(mean[0]),
        float(error[0]),
        float(mean[1]),
        float(error[1]),
        float(mean[2]),
        float(error[2]),
        keystone,
        len(measured),
        first,
        last,
        verdict,
        why,
    )


def _empty(verdict: Verdict, why: str) -> RectificationReport:
    nan = float("nan")
    return RectificationReport(nan, nan, nan, nan, nan, nan, nan, 0, -1, -1, verdict, why)
