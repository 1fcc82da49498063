"""The paper's chain on the free map: road profile (eq. 9-11), roll at fixed disparity (eq. 12), profile again.

Cells are given as flat arrays (u, v, disparity), image pixels, so that the fit keeps the matcher's
sub-pixel values; the v-disparity of whole bins is only where the line is first looked for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from stereocalib_core.config import ProfileConfig
from stereocalib_core.geometry import (
    Extrinsics,
    StereoCamera,
    extrinsics_from_profile,
    roll_from_slope,
    slope_from_roll,
)
from stereocalib_core.road.stages import DisparityMap

Float = NDArray[np.float64]


@dataclass(frozen=True)
class Profile:
    """A road profile v = slope Delta + intercept with the cells that agree.

    covariance: (2, 2) of (slope [px/px], intercept [px]); support: share of the given cells within tolerance.
    """

    slope: float
    intercept_px: float
    covariance: Float
    inliers: int
    support: float


@dataclass(frozen=True)
class RollVote:
    """Eq. 12 at several disparities: slope C of v = C u + d, its variance, and how many disparities voted."""

    slope: float
    variance: float
    votes: int
    inliers: int


@njit(cache=True, nogil=True)
def collect(
    values: NDArray[np.float32],
    mask: NDArray[np.bool_],
    step: int,
    cx: float,
    half_width_in_baselines: float,
    d_min: float,
) -> tuple[Float, Float, Float]:
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
    u: Float,
    v: Float,
    d: Float,
    cx: float,
    tilts: Float,
    slopes: Float,
    first: float,
    row_bin: float,
    rows: int,
    every: int,
) -> Float:
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
    v: Float,
    d: Float,
    slope: float,
    intercept: float,
    tolerance: float,
    relative_tolerance: float,
    rounds: int,
) -> tuple[float, float, int, float, Float]:
    """Least squares of d on v among the cells near the line, repeated with Tukey weights until it rests.

    Rows are exact and disparities are not, so d is regressed on v; returns slope, intercept, inliers,
    residual sigma of d [px] and the (2, 2) normal matrix of (gain, offset) in d = gain v' + offset.
    """
    gain, offset = 1.0 / slope, -intercept / slope
    top, bottom = v.min(), v.max()
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
    u: Float, v: Float, d: Float, camera: StereoCamera, config: ProfileConfig
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
    v: Float, d: Float, start: tuple[float, float], relative_tolerance: float, config: ProfileConfig
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


@njit(cache=True, nogil=True)
def _slopes_at_fixed_disparity(
    u: Float,
    v: Float,
    d: Float,
    cx: float,
    profile_slope: float,
    intercept: float,
    d_min: float,
    d_max: float,
    tolerance_px: float,
    trials: int,
    bin_px: int,
) -> tuple[Float, Float, NDArray[np.int64]]:
    """Eq. 12 at each whole disparity of the matcher's grid, `bin_px` apart.

    Returns the slope of v = C (u - cx) + c, its variance and its support (NaN, inf, 0 where there is none).
    """
    first, last = int(np.ceil(d_min / bin_px)), int(d_max / bin_px)
    count = max(last - first + 1, 0)
    slopes, variances, support = np.full(count, np.nan), np.full(count, np.inf), np.zeros(count, np.int64)
    starts = np.zeros(count + 1, np.int64)
    for k in range(len(d)):
        b = int(np.floor(d[k] / bin_px + 0.5)) - first
        if 0 <= b < count:
            starts[b + 1] += 1
    for b in range(count):
        starts[b + 1] += starts[b]
    fill = starts.copy()
    x, y = np.empty(starts[count]), np.empty(starts[count])
    for k in range(len(d)):
        b = int(np.floor(d[k] / bin_px + 0.5)) - first
        if 0 <= b < count:
            x[fill[b]] = u[k] - cx
            # Moves each cell along the profile to the bin's own disparity.
            y[fill[b]] = v[k] - intercept - profile_slope * d[k]
            fill[b] += 1
    np.random.seed(2)  # noqa: NPY002 - numba knows only the legacy generator
    for b in range(count):
        lo, hi = starts[b], starts[b + 1]
        n = hi - lo
        if n < 30:
            continue
        best, slope, offset = -1, 0.0, 0.0
        some_x, some_y = x[lo : hi : 1 + n // 200].copy(), y[lo : hi : 1 + n // 200].copy()
        for _ in range(trials):
            i, j = lo + np.random.randint(n), lo + np.random.randint(n)  # noqa: NPY002
            if abs(x[i] - x[j]) < 20.0:
                continue
            c = (y[i] - y[j]) / (x[i] - x[j])
            if abs(c) > 0.2:
                continue
            o = y[i] - c * x[i]
            agree = 0
            for k in range(len(some_x)):
                agree += abs(some_y[k] - c * some_x[k] - o) < tolerance_px
            if agree > best:
                best, slope, offset = agree, c, o
        if best < 0:
            continue
        for _ in range(4):
            s0 = s1 = s2 = t0 = t1 = e2 = 0.0
            inliers = 0
            for k in range(lo, hi):
                r = (y[k] - slope * x[k] - offset) / (2.0 * tolerance_px)
                if abs(r) < 1.0:
                    w = (1.0 - r * r) ** 2
                    s0 += w
                    s1 += w * x[k]
                    s2 += w * x[k] * x[k]
                    t0 += w * y[k]
                    t1 += w * y[k] * x[k]
                    e2 += w * (y[k] - slope * x[k] - offset) ** 2
                    inliers += 1
            det = s0 * s2 - s1 * s1
            if inliers < 20 or det < 1e-6:
                inliers = 0
                break
            slope = (s0 * t1 - s1 * t0) / det
            offset = (s2 * t0 - s1 * t1) / det
        if inliers >= 0.5 * n or inliers >= 60:
            slopes[b], support[b] = slope, inliers
            variances[b] = (e2 / s0 + 0.05) * s0 / det
    return slopes, variances, support


def vote_roll(
    u: Float, v: Float, d: Float, step_px: int, profile: Profile, camera: StereoCamera, config: ProfileConfig
) -> RollVote | None:
    """Eq. 12 at every whole disparity of the near range; robust weighted mean of the slopes; None without votes."""
    slopes, variances, support = _slopes_at_fixed_disparity(
        u, v, d, camera.cx_px, profile.slope, profile.intercept_px,
        config.roll_min_disparity_px, float(d.max(initial=0.0)), config.roll_tolerance_px, config.roll_trials, step_px,
    )  # fmt: skip
    good = np.isfinite(slopes)
    if not good.any():
        return None
    slopes, variances, support = slopes[good], variances[good], support[good]
    order = np.argsort(slopes)
    weight = np.cumsum(1.0 / variances[order])
    centre = slopes[order][np.searchsorted(weight, 0.5 * weight[-1])]
    for _ in range(5):
        scale = max(1.4826 * np.median(np.abs(slopes - centre)), 1e-4)
        w = np.clip(1.0 - ((slopes - centre) / (4.0 * scale)) ** 2, 0.0, None) ** 2 / variances
        centre = float(np.sum(w * slopes) / np.sum(w))
    scatter = np.sum(w * (slopes - centre) ** 2) / np.sum(w)
    variance = max(float(scatter / max(np.sum(w > 0) - 1, 1)), config.correlated_cells / float(np.sum(w)))
    return RollVote(centre, variance, int(np.sum(w > 0)), int(support.sum()))


@dataclass(frozen=True)
class PaperFit:
    """The chain's result. `profile` is the last fit, with roll taken out; `first` the one before."""

    extrinsics: Extrinsics
    covariance: Float
    first: Profile
    profile: Profile
    roll: RollVote | None


def covariance_of(
    camera: StereoCamera, profile: Profile, roll: RollVote, pitch_rad: float, config: ProfileConfig
) -> Float:
    """(3, 3) of height, pitch, roll from those of profile and slope, with what roads add to it."""
    c = np.cos(pitch_rad)
    jacobian = np.array([[camera.baseline_m * c, 0.0], [0.0, -(c**2) / camera.focal_px]])
    result = np.zeros((3, 3))
    result[:2, :2] = jacobian @ profile.covariance @ jacobian.T
    result[2, 2] = c**2 * roll.variance
    systematic = (
        config.systematic_height_m,
        *np.deg2rad([config.systematic_pitch_deg, config.systematic_roll_deg]),
    )
    result += np.diag(np.square(systematic))
    return result


def fit_paper(
    disparity: DisparityMap,
    mask: NDArray[np.bool_],
    camera: StereoCamera,
    config: ProfileConfig,
    single_pass: bool = False,
) -> PaperFit | None:
    """Profile on the v-disparity of `mask`, roll by eq. 12, profile again with the roll taken out of the rows.

    `single_pass` keeps the paper's order: pitch and height from the first profile. None without a road.
    """
    wide = collect(
        disparity.values, mask, disparity.step_px, camera.cx_px,
        config.roll_half_width_m / camera.baseline_m, config.min_disparity_px,
    )  # fmt: skip
    inside = np.abs(wide[0] - camera.cx_px) * camera.baseline_m <= config.corridor_half_width_m * wide[2]
    u, v, d = (array[inside] for array in wide)
    start = search_profile(u, v, d, camera, config)
    if start is None:
        return None
    tilt, slope, intercept = start
    search = v if single_pass else v - tilt * (u - camera.cx_px)
    first = fit_profile(search, d, (slope, intercept), config.search_relative_tolerance, config)
    if first is None:
        return None
    roll = vote_roll(*wide, disparity.step_px, first, camera, config)
    pitch = extrinsics_from_profile(camera, first.slope, first.intercept_px).pitch_rad
    roll_rad = 0.0 if roll is None else roll_from_slope(roll.slope, pitch)
    profile = first
    if not single_pass and roll is not None:
        for _ in range(2):
            level = v - slope_from_roll(roll_rad, pitch) * (u - camera.cx_px)
            refit = fit_profile(
                level, d, (profile.slope, profile.intercept_px), config.relative_tolerance, config
            )
            if refit is None:
                return None
            profile = refit
            pitch = extrinsics_from_profile(camera, profile.slope, profile.intercept_px).pitch_rad
            roll_rad = roll_from_slope(roll.slope, pitch)
    extrinsics = extrinsics_from_profile(
        camera, profile.slope, profile.intercept_px, 0.0 if single_pass else roll_rad
    )
    extrinsics = Extrinsics(extrinsics.height_m, extrinsics.pitch_rad, roll_rad)
    vote = roll or RollVote(0.0, float(np.deg2rad(3.0)) ** 2, 0, 0)
    return PaperFit(extrinsics, covariance_of(camera, profile, vote, pitch, config), first, profile, roll)
