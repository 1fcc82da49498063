"""Is the stereo pair itself still calibrated? The rows of left and right matches say so, in every frame.

A right camera that is turned by small angles against the left one (`P_right = Rx(pitch) Rz(roll) Ry(yaw) P`,
signs as in geometry.py) moves its matches, with u, v counted from the principal point, by

    dv = v_right - v_left = -pitch (f + v^2 / f) + roll u + yaw u v / f

What rows can tell apart: the roll (it grows with u) and the keystone u v / f. What they cannot: a row offset
(principal points at different heights) from a relative pitch, whose v^2 / f is a few hundredths of a pixel.
So one number is measured, the offset of the rows at the principal point, and given twice: `row offset`
in pixels and `relative pitch` as the angle that explains all of it; they are the same finding. The keystone
is fitted beside them and kept out of the verdict: a rectification may carry half a degree of it (a pixel in
the corners) without a relative yaw, since a wrong principal point of the right camera looks the same. A
relative yaw itself is a disparity offset, which rows do not show.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray

from stereocalib_core.config import RectificationConfig
from stereocalib_core.errors import Failure, FailureReason
from stereocalib_core.geometry import StereoCamera
from stereocalib_core.results import Check, FrameResult, RectificationSample
from stereocalib_core.rig.row_matches import RowMatches, row_matches

Floats = NDArray[np.float64]
Verdict = Literal["good", "suspect", "bad"]

_KEYSTONE_RAD = float(np.deg2rad(0.5))
"""A weak pull of the keystone to zero (so much of it is common, 1 sigma) keeps frames with matches in one half of
the picture from trading it against the roll."""
_BEHIND_PX = -4.0
"""Nothing that a camera sees has a disparity below this, whatever the last pixel of its calibration."""


@dataclass(frozen=True)
class Examination:
    """One pair's self-check: what it measured, why the pair cannot be used (or None), and the numbers."""

    sample: RectificationSample | None
    failure: Failure | None
    checks: tuple[Check, ...]


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


@njit(cache=True, nogil=True)
def _robust_rows(design: Floats, dv: Floats, prior: float) -> tuple[Floats, Floats, Floats]:
    """(3,) coefficients of (M, 3) `design` for (M,) rows, the (3, 3) normal matrix and (M,) weights; NaN = failed.

    prior: inverse variance of the third one about zero.
    """
    m = len(dv)
    weights, residual = np.ones(m), np.empty(m)
    solution, normal, right = np.zeros(3), np.zeros((3, 3)), np.zeros(3)
    solution[0] = np.median(dv)
    for _ in range(12):
        for i in range(m):
            residual[i] = dv[i]
            for p in range(3):
                residual[i] -= design[i, p] * solution[p]
        scale = max(1.4826 * np.median(np.abs(residual)), 0.03)
        normal[:], right[:] = 0.0, 0.0
        normal[2, 2] = prior
        for i in range(m):
            weights[i] = 1.0 / (1.0 + (residual[i] / (2.0 * scale)) ** 2) ** 2
            for p in range(3):
                weighted = design[i, p] * weights[i] / scale**2
                right[p] += weighted * dv[i]
                for q in range(3):
                    normal[p, q] += weighted * design[i, q]
        if not np.linalg.det(normal) > 0.0:
            solution[:] = np.nan
            break
        solution[:] = np.linalg.solve(normal, right)
    return solution, normal, weights


def fit_rows(camera: StereoCamera, points: Floats) -> RectificationSample | None:
    """Robust fit of the row model to (M, 4) left u, v, right u, v [px]; None where that fails."""
    f = camera.focal_px
    cx_right = camera.cx_px if camera.cx_right_px is None else camera.cx_right_px
    u, v = points[:, 2] - cx_right, points[:, 1] - camera.cy_px
    dv = points[:, 3] - points[:, 1]
    design = np.stack([1.0 + (v / f) ** 2, u / f, u * v / f**2], axis=1)
    solution, normal, weights = _robust_rows(design, dv, 1.0 / (f * _KEYSTONE_RAD) ** 2)
    if not np.isfinite(solution).all() or np.linalg.cond(normal) > 1e8:
        return None
    # Neighbouring matches share what the model leaves out (lens distortion, their scene): four count as one.
    covariance = 4.0 * np.linalg.inv(normal)
    # Pixels to the three values: row offset [px], the pitch that explains it [rad], roll [rad].
    to_values = np.array([[1.0, 0.0, 0.0], [-1.0 / f, 0.0, 0.0], [0.0, 1.0 / f, 0.0]])
    values = to_values @ solution
    return RectificationSample(
        values, to_values @ covariance @ to_values.T, int((weights > 0.25).sum()), float(solution[2] / f)
    )


def _behind_and_ahead(camera: StereoCamera, matches: RowMatches) -> tuple[int, int]:
    """Clear matches behind and ahead of infinity; those close to it do not tell left from right."""
    disparity = matches.coarse_px - camera.disparity_offset_px
    return int((disparity < _BEHIND_PX).sum()), int((disparity > -_BEHIND_PX).sum())


def examine(
    camera: StereoCamera,
    left: NDArray[np.uint8],
    right: NDArray[np.uint8],
    config: RectificationConfig | None = None,
) -> Examination:
    """Measure one pair's rows. left, right: (H, W) uint8.

    The failure is SWAPPED where most matches lie beyond infinity, MISALIGNED where the rows part further than
    the limits of `config`, with the numbers. Too little to match: no sample, no failure.
    """
    config = config or RectificationConfig()
    offset = camera.disparity_offset_px
    near, far = offset + config.search_px, offset - 0.4 * config.search_px
    matches = row_matches(left, right, far, near)
    behind, ahead = _behind_and_ahead(camera, matches)
    few = len(matches.coarse_px) < config.clear_fraction * matches.corners
    if matches.corners >= config.min_matches and (few or 3 * behind > ahead):
        # Swapped pictures and rows far apart both look like no match: look harder (slow, so only then).
        matches = row_matches(left, right, far, near, thorough=True)
        behind, ahead = _behind_and_ahead(camera, matches)
        if few and behind <= ahead:
            wide = row_matches(left, right, far, near, rows_px=config.search_rows_px)
            if len(wide.points) > 1.5 * len(matches.points):
                matches = wide
                behind, ahead = _behind_and_ahead(camera, matches)
    checks = [Check("rectification", "left-right matches", float(len(matches.points)))]
    if behind >= config.min_matches and behind > ahead:
        detail = f"{behind} of {behind + ahead} matches have negative disparity: left and right are swapped"
        share = behind / (behind + ahead)
        checks.append(Check("rectification", "matches beyond infinity", share, high=0.5))
        return Examination(None, Failure(FailureReason.SWAPPED, detail), tuple(checks))
    sample = fit_rows(camera, matches.points) if len(matches.points) >= config.min_matches else None
    if sample is None:
        return Examination(None, None, tuple(checks))
    pitch, roll = np.rad2deg(sample.values[1:])
    sigma = np.rad2deg(np.sqrt(np.diag(sample.covariance)[1:]))
    checks.append(
        Check("rectification", "relative pitch", float(abs(pitch)), high=config.bad_pitch_deg, unit="deg")
    )
    checks.append(
        Check("rectification", "relative roll", float(abs(roll)), high=config.bad_roll_deg, unit="deg")
    )
    bad_pitch = abs(pitch) - 3.0 * sigma[0] > config.bad_pitch_deg
    bad_roll = abs(roll) - 3.0 * sigma[1] > config.bad_roll_deg
    if bad_pitch or bad_roll:
        detail = (
            f"rows differ by {sample.values[0]:+.2f} px, relative pitch {pitch:+.3f} deg (limit "
            f"{config.bad_pitch_deg:g}), relative roll {roll:+.3f} deg (limit {config.bad_roll_deg:g})"
        )
        return Examination(sample, Failure(FailureReason.MISALIGNED, detail), tuple(checks))
    return Examination(sample, None, tuple(checks))


def _robust_mean(values: Floats, sigma: Floats) -> tuple[Floats, Floats]:
    """Column means and their standard deviations of (N, K) values with (N, K) sigma, outliers bounded."""
    centre = np.median(values, axis=0)
    spread = np.maximum(1.4826 * np.median(np.abs(values - centre), axis=0), 1e-12)
    weights = np.ones_like(values)
    for _ in range(8):
        weights = 1.0 / ((1.0 + ((values - centre) / (3.0 * spread)) ** 2) * (sigma**2 + spread**2))
        centre = (weights * values).sum(axis=0) / weights.sum(axis=0)
    scatter = (weights * (values - centre) ** 2).sum(axis=0) / weights.sum(axis=0)
    # Matches of neighbouring frames share their scene: one independent look in four frames; and never better
    # than 0.1 of one frame's own sigma, because of the lens distortion that the model leaves out.
    count = max(len(values) / 4.0, 1.0)
    return centre, np.sqrt(scatter / count + (0.1 * np.median(sigma, axis=0)) ** 2)


def _worst_part(values_deg: Floats, window: int) -> NDArray[np.bool_]:
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
    noise = 1.4826 * np.median(np.abs(np.diff(values_deg * scale, axis=0)), axis=0).max()
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
