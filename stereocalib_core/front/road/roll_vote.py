"""Roll from the rows of road cells at one and the same disparity (eq. 12), at every disparity of the near range."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from stereocalib_core.config import ProfileConfig
from stereocalib_core.front.road.profile import Profile
from stereocalib_core.geometry import StereoCamera
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.robust import SIGMA_PER_MAD


@dataclass(frozen=True)
class RollVote:
    """Eq. 12 at several disparities: slope C of v = C u + d, its variance, and how many disparities voted."""

    slope: float
    variance: float
    votes: int
    inliers: int


@njit(cache=True, nogil=True)
def _slopes_at_fixed_disparity(
    u: Array,
    v: Array,
    d: Array,
    cx: float,
    profile_slope: float,
    intercept: float,
    d_min: float,
    d_max: float,
    tolerance_px: float,
    trials: int,
    bin_px: int,
) -> tuple[Array, Array, NDArray[np.int64]]:
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


def slopes_by_disparity(
    u: Array,
    v: Array,
    d: Array,
    step_px: int,
    slope: float,
    intercept_px: float,
    camera: StereoCamera,
    config: ProfileConfig,
) -> tuple[Array, Array, NDArray[np.int64]]:
    """(K,) slopes of eq. 12 at every whole disparity of the near range, far first, their variances and support.

    slope, intercept_px: the road profile, along which cells are brought to their whole disparity.
    """
    slopes, variances, support = _slopes_at_fixed_disparity(
        u, v, d, camera.cx_px, slope, intercept_px,
        config.roll_min_disparity_px, float(d.max(initial=0.0)), config.roll_tolerance_px, config.roll_trials, step_px,
    )  # fmt: skip
    return slopes, variances, support


def vote_roll(
    u: Array, v: Array, d: Array, step_px: int, profile: Profile, camera: StereoCamera, config: ProfileConfig
) -> RollVote | None:
    """Eq. 12 at every whole disparity of the near range; robust weighted mean of the slopes; None without votes."""
    slopes, variances, support = slopes_by_disparity(
        u, v, d, step_px, profile.slope, profile.intercept_px, camera, config
    )
    good = np.isfinite(slopes)
    if not good.any():
        return None
    slopes, variances, support = slopes[good], variances[good], support[good]
    order = np.argsort(slopes)
    weight = np.cumsum(1.0 / variances[order])
    centre = slopes[order][np.searchsorted(weight, 0.5 * weight[-1])]
    for _ in range(5):
        scale = max(SIGMA_PER_MAD * np.median(np.abs(slopes - centre)), 1e-4)
        w = np.clip(1.0 - ((slopes - centre) / (4.0 * scale)) ** 2, 0.0, None) ** 2 / variances
        centre = float(np.sum(w * slopes) / np.sum(w))
    scatter = np.sum(w * (slopes - centre) ** 2) / np.sum(w)
    variance = max(float(scatter / max(np.sum(w > 0) - 1, 1)), config.correlated_cells / float(np.sum(w)))
    return RollVote(centre, variance, int(np.sum(w > 0)), int(support.sum()))
