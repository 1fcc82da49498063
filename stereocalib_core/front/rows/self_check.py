"""The pair's check of itself: the rows of left and right matches, in every frame.

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

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from stereocalib_core.config import RectificationConfig
from stereocalib_core.errors import Failure, FailureReason
from stereocalib_core.front.rows.row_matches import RowMatches, row_matches
from stereocalib_core.geometry import StereoCamera
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.robust import SIGMA_PER_MAD
from stereocalib_core.numeric.small_algebra import median_size, solve_square
from stereocalib_core.results import Check, RectificationSample

UPSIDE_DOWN = "nearness above over below"
"""Name of the check that fails where a picture stands on its head."""


@dataclass(frozen=True)
class Examination:
    """One pair's self-check: what it measured, why the pair cannot be used (or None), and the numbers."""

    sample: RectificationSample | None
    failure: Failure | None
    checks: tuple[Check, ...]


@njit(cache=True, nogil=True)
def _robust_rows(design: Array, dv: Array, middle: float, prior: float) -> tuple[Array, Array, Array]:
    """(3,) coefficients of (M, 3) `design` for (M,) rows, the (3, 3) normal matrix and (M,) weights; NaN = failed.

    middle: what the first one is to begin with. prior: inverse variance of the third one about zero.
    """
    m = len(dv)
    weights, residual = np.ones(m), np.empty(m)
    solution, normal, right = np.zeros(3), np.zeros((3, 3)), np.zeros((3, 1))
    solved = np.empty((3, 3))
    solution[0] = middle
    for _ in range(12):
        for i in range(m):
            residual[i] = dv[i]
            for p in range(3):
                residual[i] -= design[i, p] * solution[p]
        scale = max(SIGMA_PER_MAD * median_size(residual), 0.03)
        normal.fill(0.0)
        right.fill(0.0)
        normal[2, 2] = prior
        for i in range(m):
            weights[i] = 1.0 / (1.0 + (residual[i] / (2.0 * scale)) ** 2) ** 2
            for p in range(3):
                weighted = design[i, p] * weights[i] / scale**2
                right[p, 0] += weighted * dv[i]
                for q in range(3):
                    normal[p, q] += weighted * design[i, q]
        for p in range(3):
            for q in range(3):
                solved[p, q] = normal[p, q]
        fixed = solve_square(solved, right) > 0.0
        for p in range(3):
            solution[p] = right[p, 0] if fixed else np.nan
        if not fixed:
            break
    return solution, normal, weights


def fit_rows(camera: StereoCamera, points: Array, config: RectificationConfig) -> RectificationSample | None:
    """Robust fit of the row model to (M, 4) left u, v, right u, v [px]; None where that fails."""
    f = camera.focal_px
    cx_right = camera.cx_px if camera.cx_right_px is None else camera.cx_right_px
    u, v = points[:, 2] - cx_right, points[:, 1] - camera.cy_px
    dv = points[:, 3] - points[:, 1]
    design = np.stack([1.0 + (v / f) ** 2, u / f, u * v / f**2], axis=1)
    solution, normal, weights = _robust_rows(
        design, dv, float(np.median(dv)), 1.0 / (f * np.deg2rad(config.keystone_deg)) ** 2
    )
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


def _behind_and_ahead(
    camera: StereoCamera, matches: RowMatches, config: RectificationConfig
) -> tuple[int, int]:
    """Clear matches behind and ahead of infinity; those close to it do not tell left from right."""
    disparity = matches.coarse_px - camera.disparity_offset_px
    return int((disparity < -config.behind_px).sum()), int((disparity > config.behind_px).sum())


def overhead(v: Array, disparity_px: Array, height_px: int) -> float:
    """How many times as near the upper third of a picture is as its lower third; 0 where either shows nothing.

    v (M,): rows of what is seen. disparity_px (M,): by how much it is moved, to either side.
    """
    near = np.abs(disparity_px)
    above, below = near[v < height_px / 3.0], near[v > height_px / 1.5]
    if not len(above) or not len(below):
        return 0.0
    return float(np.median(above) / max(np.median(below), 1.0))


def upside_down_check(ratio: float, config: RectificationConfig) -> Check:
    """What tells a picture that stands on its head; see `overhead`."""
    return Check("picture", UPSIDE_DOWN, ratio, high=config.overhead)


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
    matches = row_matches(left, right, far, near, config=config.matches)
    behind, ahead = _behind_and_ahead(camera, matches, config)
    few = len(matches.coarse_px) < config.clear_fraction * matches.corners
    if matches.corners >= config.min_matches and (few or 3 * behind > ahead):
        # Swapped pictures and rows far apart both look like no match: look harder (slow, so only then).
        matches = row_matches(left, right, far, near, thorough=True, config=config.matches)
        behind, ahead = _behind_and_ahead(camera, matches, config)
        if few and behind <= ahead:
            wide = row_matches(left, right, far, near, rows_px=config.search_rows_px, config=config.matches)
            if len(wide.points) > 1.5 * len(matches.points):
                matches = wide
                behind, ahead = _behind_and_ahead(camera, matches, config)
    checks = [
        Check("rectification", "left-right matches", float(len(matches.points)), low=config.min_matches)
    ]
    if behind >= config.min_matches and behind > ahead:
        detail = f"{behind} of {behind + ahead} matches have negative disparity: left and right are swapped"
        share = behind / (behind + ahead)
        checks.append(Check("rectification", "matches beyond infinity", share, high=0.5))
        points = matches.points
        turned = upside_down_check(
            overhead(points[:, 1], points[:, 0] - points[:, 2] - offset, camera.height), config
        )
        checks.append(turned)
        if not turned.ok:
            detail += (
                f"; but what is near lies above ({turned.value:.1f} times as near): they are upside down"
            )
        return Examination(None, Failure(FailureReason.SWAPPED, detail), tuple(checks))
    sample = fit_rows(camera, matches.points, config) if len(matches.points) >= config.min_matches else None
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
