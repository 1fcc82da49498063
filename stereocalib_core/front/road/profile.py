"""The road profile of the v-disparity (eq. 9-11): a line v = slope Delta + intercept through the free cells ahead.

Cells are given as flat arrays (u, v, disparity), image pixels, so that the fit keeps the matcher's
sub-pixel values; the v-disparity of whole bins is only where the line is first looked for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from stereocalib_core.config import ProfileConfig
from stereocalib_core.geometry import StereoCamera
from stereocalib_core.numeric.arrays import Array


@dataclass(frozen=True)
class Profile:
    """A road profile v = slope Delta + intercept with the cells that agree.

    covariance: (2, 2) of (slope [px/px], intercept [px]); support: share of the given cells within tolerance.
    """

    slope: float
    intercept_px: float
    covariance: Array
    inliers: int
    support: float


@njit(cache=True, nogil=True)
def collect(
    values: NDArray[np.float32],
    mask: NDArray[np.bool_],
    step: int,
    cx: float,
    half_width_in_baselines: float,
    d_min: float,
) -> tuple[Array, Array, Array]:
    """u, v, disparity [px] of the masked cells at disparity >= d_min within a lateral distance of the camera.

    |X| = b |u - cx| / Delta, so the corridor is |u - cx| <= half_width_in_baselines * Delta.
    """
    height, width = values.shape
    n = 0
    for i in range(height):
        for j in range(width):
            d = values[i, j]
            if mask[i, j] and d >= d_min and abs((j + 0.5) * step - 0.5 - cx) <= half_width_in_baselines * d:
                n += 1
    u, v, disparity = np.empty(n), np.empty(n), np.empty(n)
    n = 0
    for i in range(height):
        for j in range(width):
            d = values[i, j]
            x = (j + 0.5) * step - 0.5
            if mask[i, j] and d >= d_min and abs(x - cx) <= half_width_in_baselines * d:
                u[n], v[n], disparity[n] = x, (i + 0.5) * step - 0.5, d
                n += 1
    return u, v, disparity


@njit(cache=True, nogil=True)
def _vote_lines(
    u: Array,
    v: Array,
    d: Array,
    cx: float,
    tilts: Array,
    slopes: Array,
    first: float,
    row_bin: float,
    rows: int,
    every: int,
) -> Array:
    """Hough votes (tilt, slope, intercept) of every n-th cell for the line v = slope d + tilt (u - cx) + intercept."""
    votes = np.zeros((len(tilts), len(slopes), rows))
    fall = np.empty(len(slopes))
    for k in range(0, len(v), every):
        for s in range(len(slopes)):
            fall[s] = slopes[s] * d[k] / row_bin
        for t in range(len(tilts)):
            level = (v[k] - tilts[t] * (u[k] - cx) - first) / row_bin
            for s in range(len(slopes)):
                i = int(level - fall[s])
                if 0 <= i < rows:
                    votes[t, s, i] += 1.0
    return votes


_AT_REST_PX = 1e-4
"""A line that moves by less anywhere in the picture has converged."""


# Sums may be reordered, so that several cells are taken at once.
@njit(cache=True, nogil=True, fastmath={"reassoc", "contract", "arcp", "nsz"})
def _refine_line(
    v: Array,
    d: Array,
    slope: float,
    intercept: float,
    tolerance: float,
    relative_tolerance: float,
    rounds: int,
) -> tuple[float, float, int, float, Array]:
    """Least squares of d on v among the cells near the line, repeated with Tukey weights until it rests.

    Rows are exact and disparities are not, so d is regressed on v; returns slope, intercept, inliers,
    residual sigma of d [px] and the (2, 2) normal matrix of (gain, offset) in d = gain v' + offset.
    """
    gain, offset = 1.0 / slope, -intercept / slope
    top = bottom = v[0]
    for k in range(len(v)):
        top, bottom = min(top, v[k]), max(bottom, v[k])
    inliers, sigma = 0, 0.0
    normal = np.zeros((2, 2))
    for _ in range(rounds):
        s0 = s1 = s2 = t0 = t1 = e2 = 0.0
        inliers = 0
        for k in range(len(v)):
            expected = gain * v[k] + offset
            limit = tolerance + relative_tolerance * expected
            r = (d[k] - expected) / limit
            inside = max(1.0 - r * r, 0.0)
            w = inside * inside
            s0 += w
            s1 += w * v[k]
            s2 += w * v[k] * v[k]
            t0 += w * d[k]
            t1 += w * d[k] * v[k]
            e2 += w * (d[k] - expected) ** 2
            inliers += inside > 0.0
        det = s0 * s2 - s1 * s1
        if inliers < 20 or det <= 1e-9:
            return np.nan, np.nan, inliers, np.nan, normal
        gain_step = (s0 * t1 - s1 * t0) / det - gain
        offset_step = (s2 * t0 - s1 * t1) / det - offset
        gain, offset = gain + gain_step, offset + offset_step
        sigma = np.sqrt(e2 / s0)
        normal[0, 0], normal[0, 1], normal[1, 0], normal[1, 1] = s2, s1, s1, s0
        if max(abs(gain_step * top + offset_step), abs(gain_step * bottom + offset_step)) < _AT_REST_PX:
            break
    return 1.0 / gain, -offset / gain, inliers, sigma, normal


_SEARCH_TILTS = np.tan(np.deg2rad([-4.0, -2.0, 0.0, 2.0, 4.0]))
_ROW_BIN_PX = 3.0


def search_profile(
    u: Array, v: Array, d: Array, camera: StereoCamera, config: ProfileConfig
) -> tuple[float, float, float] | None:
    """The most voted line: tilt and slope [px/px] and intercept [px]; None without cells."""
    if len(v) < config.min_inliers:
        return None
    low, high = config.min_height_m / camera.baseline_m, config.max_height_m / camera.baseline_m
    slopes = np.geomspace(low, high, config.search_slopes)
    reach = camera.focal_px * np.tan(config.max_pitch_rad)
    first, rows = camera.cy_px - reach, int(2 * reach / _ROW_BIN_PX) + 1
    every = max(len(v) // config.search_cells, 1)
    votes = _vote_lines(u, v, d, camera.cx_px, _SEARCH_TILTS, slopes, first, _ROW_BIN_PX, rows, every)
    votes[:, :, 1:-1] += 0.5 * (votes[:, :, :-2] + votes[:, :, 2:])
    t, s, i = np.unravel_index(int(np.argmax(votes)), votes.shape)
    return float(_SEARCH_TILTS[t]), float(slopes[s]), float(first + (i + 0.5) * _ROW_BIN_PX)


def fit_profile(
    v: Array, d: Array, start: tuple[float, float], relative_tolerance: float, config: ProfileConfig
) -> Profile | None:
    """Robust line d on v through the cells, from a starting line; None without enough agreement."""
    slope, intercept, inliers, sigma, normal = _refine_line(
        v, d, start[0], start[1], config.tolerance_px, relative_tolerance, config.rounds
    )
    if not np.isfinite(slope) or slope <= 0 or inliers < config.min_inliers:
        return None
    gain, offset = 1.0 / slope, -intercept / slope
    covariance = np.linalg.inv(normal) * sigma**2 * config.correlated_cells
    jacobian = np.array([[-1.0 / gain**2, 0.0], [offset / gain**2, -1.0 / gain]])
    return Profile(slope, intercept, jacobian @ covariance @ jacobian.T, inliers, inliers / len(v))
