"""The papers' other ways to the same numbers, kept for comparison on the same cells and frames.

A `corridor_m` is the half width of the road that is used, in metres; None takes the whole width of the picture, as
the paper does.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from stereocalib_core.config import PipelineConfig, ProfileConfig
from stereocalib_core.front.road.paper import PaperFit, fit_paper
from stereocalib_core.front.road.profile import collect, fit_profile, search_profile
from stereocalib_core.front.road.roll_vote import slopes_by_disparity
from stereocalib_core.front.road.uv_disparity import v_disparity
from stereocalib_core.geometry import Extrinsics, StereoCamera, extrinsics_from_profile, roll_from_slope
from stereocalib_core.numeric.arrays import Array, Mask
from stereocalib_core.numeric.robust import SIGMA_PER_MAD
from stereocalib_core.results import DisparityMap

_EVERYWHERE_M = 1000.0


def within(config: ProfileConfig, corridor_m: float | None) -> ProfileConfig:
    """The settings with both corridors, of profile and roll, of this half width."""
    width = _EVERYWHERE_M if corridor_m is None else corridor_m
    return dataclasses.replace(config, corridor_half_width_m=width, roll_half_width_m=width)


def fit_cells(
    disparity: DisparityMap,
    mask: Mask,
    camera: StereoCamera,
    config: PipelineConfig,
    corridor_m: float | None = None,
    single_pass: bool = False,
) -> PaperFit | None:
    """The chain of eq. 9-12 on the cells of `mask`; `single_pass` keeps the paper's own order: pitch and height from
    the profile as it stands, then roll."""
    return fit_paper(disparity, mask, camera, within(config.profile, corridor_m), single_pass)


def fit_whole_map(disparity: DisparityMap, camera: StereoCamera, config: PipelineConfig) -> Extrinsics | None:
    """The profile from the v-disparity of the whole disparity map, obstacles and roadside included.

    The paper's comparison: its height scatters by 0.1383 m instead of 0.0875 m with the free map.
    """
    fit = fit_cells(disparity, disparity.values > 0, camera, config)
    return None if fit is None else fit.extrinsics


def eq12_roll(
    disparity: DisparityMap, free: Mask, camera: StereoCamera, config: PipelineConfig
) -> float | None:
    """Roll [rad] by eq. 12 on its own, from the whole width of the free map as in the paper.

    On real roads the pipeline keeps to a corridor (`roll_half_width_m`), because the verges are cambered.
    """
    fit = fit_cells(disparity, free, camera, config)
    return None if fit is None or fit.roll is None else fit.extrinsics.roll_rad


def fit_to_the_letter(
    disparity: DisparityMap, free: Mask, camera: StereoCamera, config: PipelineConfig
) -> Extrinsics | None:
    """The paper's own way: a line in the picture of the v-disparity (eq. 9-11), and eq. 12 at one fixed disparity.

    The v-disparity counts whole disparities, the line is the most voted and then fitted to the counts near it, with
    room for the wedge that a roll makes of it; the
    one disparity of eq. 12 is that of the near range with the most cells on their line.
    """
    line = line_in_v_disparity(disparity, free, camera, config)
    if line is None:
        return None
    slope, intercept = line
    level = extrinsics_from_profile(camera, slope, intercept)
    wide = within(config.profile, None)
    cells = collect(
        disparity.values, free, disparity.step_px, camera.cx_px,
        wide.roll_half_width_m / camera.baseline_m, wide.min_disparity_px,
    )  # fmt: skip
    slopes, _, support = slopes_by_disparity(*cells, disparity.step_px, slope, intercept, camera, wide)
    if not np.isfinite(slopes).any():
        return None
    best = int(np.argmax(np.where(np.isfinite(slopes), support, -1)))
    return Extrinsics(level.height_m, level.pitch_rad, roll_from_slope(float(slopes[best]), level.pitch_rad))


def line_in_v_disparity(
    disparity: DisparityMap, free: Mask, camera: StereoCamera, config: PipelineConfig
) -> tuple[float, float] | None:
    """Slope [px/px] and intercept [px] of the road profile as a line in the v-disparity; None without a road."""
    rules = config.profile
    # bins about whole disparities
    bins = int(np.nanmax(disparity.values, initial=0.0)) + 2
    shifted = disparity.values + np.float32(0.5)
    counts = v_disparity(np.where(disparity.values > 0, shifted, 0.0).astype(np.float32), free, 1.0, bins)
    rows, d = np.nonzero(counts)
    far = d >= rules.min_disparity_px
    rows, d = rows[far], d[far]
    weight = counts[rows, d].astype(np.float64)
    v = np.asarray((rows + 0.5) * disparity.step_px - 0.5, dtype=np.float64)
    if weight.sum() < rules.min_inliers:
        return None
    start = _voted_line(v, d.astype(np.float64), weight, camera, rules)
    slope, intercept = start
    for _ in range(rules.rounds):
        limit = slope * (rules.tolerance_px + rules.search_relative_tolerance * d)
        near = np.clip(1.0 - ((v - slope * d - intercept) / limit) ** 2, 0.0, None) ** 2 * weight
        if near.sum() <= 0.0:
            return None
        # rows are exact and disparities are not: d on v, as for single cells
        gain, offset = np.polyfit(v, d, 1, w=np.sqrt(near))
        if not gain > 0.0:
            return None
        slope, intercept = 1.0 / float(gain), -float(offset) / float(gain)
    return slope, intercept


def _voted_line(
    v: Array, d: Array, weight: Array, camera: StereoCamera, rules: ProfileConfig
) -> tuple[float, float]:
    """The line v = slope d + intercept with the most counts within a row or two, of all heights and pitches."""
    low, high = rules.min_height_m / camera.baseline_m, rules.max_height_m / camera.baseline_m
    reach = camera.focal_px * np.tan(rules.max_pitch_rad)
    rows = int(reach) + 1
    best = (-1.0, 0.0, 0.0)
    for slope in np.geomspace(low, high, rules.search_slopes):
        row = ((v - slope * d - camera.cy_px + reach) / 2.0).astype(int)
        inside = (row >= 0) & (row < rows)
        votes = np.bincount(row[inside], weights=weight[inside], minlength=rows).astype(np.float64)
        votes[1:-1] += 0.5 * (votes[:-2] + votes[2:])
        k = int(np.argmax(votes))
        best = max(best, (float(votes[k]), float(slope), float(camera.cy_px - reach + 2.0 * k + 1.0)))
    return best[1], best[2]


def fit_labayrade(
    disparity: DisparityMap,
    free: Mask,
    camera: StereoCamera,
    config: PipelineConfig,
    corridor_m: float | None = None,
    projections: int = 10,
) -> Extrinsics | None:
    """Roll by repeated projections (Labayrade and Aubert 2003): the tilt that makes the profile sharpest.

    Each projection levels the rows by one tilt and fits the profile; the best of an even row over +-6 degrees
    is refined by the parabola through it and its neighbours, so that ten projections suffice.
    """
    rules = within(config.profile, corridor_m)
    u, v, d = collect(
        disparity.values, free, disparity.step_px, camera.cx_px,
        rules.corridor_half_width_m / camera.baseline_m, rules.min_disparity_px,
    )  # fmt: skip
    if len(v) < rules.min_inliers:
        return None
    start = search_profile(u, v, d, camera, rules)
    if start is None:
        return None
    tilt, slope, intercept = start
    # The wedge of the road about the first line, whatever its roll; the rest is sky and roadside.
    expected = (v - tilt * (u - camera.cx_px) - intercept) / slope
    road = np.abs(d - expected) < 2.0 + 0.15 * expected
    u, v, d = u[road], v[road], d[road]
    if len(v) < rules.min_inliers:
        return None
    low, high = np.tan(np.deg2rad([-6.0, 6.0]))
    coarse = max(projections // 2, 3)
    best = None
    for _ in range(2):
        tilts = np.linspace(low, high, coarse)
        spread = np.array([_spread(v - t * (u - camera.cx_px), d) for t in tilts])
        k = int(np.clip(np.argmin(spread), 1, len(tilts) - 2))
        before, at, after = spread[k - 1 : k + 2]
        bend = before - 2 * at + after
        step = tilts[1] - tilts[0]
        shift = 0.5 * (before - after) / bend if bend > 0 else 0.0
        best = float(tilts[k] + step * np.clip(shift, -1.0, 1.0))
        low, high = best - 0.5 * step, best + 0.5 * step
    assert best is not None
    level = v - best * (u - camera.cx_px)
    gain, offset = np.polyfit(d, level, 1)
    profile = fit_profile(level, d, (float(gain), float(offset)), rules.search_relative_tolerance, rules)
    if profile is None:
        return None
    pitch = extrinsics_from_profile(camera, profile.slope, profile.intercept_px).pitch_rad
    roll = roll_from_slope(best, pitch)
    return extrinsics_from_profile(camera, profile.slope, profile.intercept_px, roll)


def _spread(level: Array, d: Array) -> float:
    """Robust spread [px] of the levelled rows about their profile, by two rounds of least squares."""
    gain, offset = np.polyfit(d, level, 1)
    residual = level - gain * d - offset
    keep = np.abs(residual) < 4.0 * SIGMA_PER_MAD * np.median(np.abs(residual))
    gain, offset = np.polyfit(d[keep], level[keep], 1)
    return float(np.mean(np.minimum((level - gain * d - offset) ** 2, 900.0)))
