"""What a lane's surface is besides a plane: the bends that are fitted, and those that are not.

Roads are cambered and they twist. Both bends have mean zero and no slope over the whole lane ahead, so the
plane that is left is the least-squares plane of that surface, however unevenly the picture samples it. How
large they may be is not known beforehand: the fit is averaged over a ladder of sizes, each weighted by how
well it explains the lane (its evidence). A flat road keeps its precision, a cambered one its plane, and
nothing jumps in between.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from stereocalib_core.config import DirectConfig
from stereocalib_core.numeric import bent_square
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.evidence import average_over_sizes
from stereocalib_core.numeric.robust import SIGMA_PER_MAD
from stereocalib_core.numeric.small_algebra import median_size, solve_square

SLOTS = 3
"""The first so many unknowns are the plane's; the bends follow."""


@dataclass(frozen=True)
class LaneFit:
    """solution (6,): change of the plane's parameters, then the bends [m]; covariance (6, 6) from the residuals found.

    gain (6, N): how the solution follows each offset. robust (N,): weights 0...1. residual (N,) [px]. beyond_shape (N,)
    [px]: the residual over the plane and bends of whatever size fits best. scale: of the variances.
    """

    solution: Array
    covariance: Array
    gain: Array
    robust: Array
    residual: Array
    beyond_shape: Array
    scale: float


def _normal(x_m: Array, z_m: Array, config: DirectConfig) -> tuple[Array, Array]:
    """Across and along, -1...1 over the lane."""
    middle, half = 0.5 * (config.far_m + config.near_m), 0.5 * (config.far_m - config.near_m)
    return x_m / config.lane_half_width_m, (z_m - middle) / half


def bends(x_m: Array, z_m: Array, config: DirectConfig) -> Array:
    """(N, 3) height of camber, twist and a bend along the lane of 1 m at road points."""
    return bent_square.bends(*_normal(x_m, z_m, config))


def further_bends(x_m: Array, z_m: Array, config: DirectConfig) -> Array:
    """(N, 4) height of the bends that are not fitted, per metre of size: the next orders.

    With what is left of the bend along the lane: a short piece of road shows little of it.
    """
    return bent_square.further_bends(*_normal(x_m, z_m, config))


@njit(cache=True, nogil=True)
def _robust_fit(
    J: Array, offset: Array, variance: Array, loose: Array, rounds: int, tukey: float, min_scale: float
) -> tuple[Array, Array]:
    """Weighted least squares repeated with Tukey weights: solution, weights 0...1.

    loose: (K, K) information added to the normal matrix while it is solved. The solution is NaN where it is singular.
    """
    n, unknowns = J.shape
    x, robust, residual = np.zeros(unknowns), np.ones(n), np.empty(n)
    H, b = np.zeros((unknowns, unknowns)), np.zeros(unknowns)
    held, change = np.empty((unknowns, unknowns)), np.empty((unknowns, 1))
    for _ in range(rounds):
        for i in range(n):
            e = offset[i]
            for p in range(unknowns):
                e -= J[i, p] * x[p]
            residual[i] = e / np.sqrt(variance[i])
        limit = tukey * max(SIGMA_PER_MAD * median_size(residual), min_scale)
        H.fill(0.0)
        b.fill(0.0)
        for i in range(n):
            robust[i] = max(1.0 - (residual[i] / limit) ** 2, 0.0) ** 2
            w = robust[i] / variance[i]
            for p in range(unknowns):
                b[p] += w * J[i, p] * offset[i]
                for q in range(unknowns):
                    H[p, q] += w * J[i, p] * J[i, q]
        for p in range(unknowns):
            change[p, 0] = b[p]
            for q in range(unknowns):
                held[p, q] = H[p, q] + loose[p, q]
        fixed = solve_square(held, change) != 0.0
        for p in range(unknowns):
            x[p] = change[p, 0] if fixed else np.nan
        if not fixed:
            break
    return x, robust


def fit_lane(
    J: Array,
    offset: Array,
    variance: Array,
    config: DirectConfig,
    further: Array | None = None,
    unseen: float = 0.0,
    off_lane: Array | None = None,
) -> LaneFit:
    """Robust weighted least squares of offsets (N,) [px] by plane and bends, J (N, 6).

    further: (N, F) [px] of the next bends per metre of size, expected small: `further_of_bends` of the others'
    size, and `further_unseen_m` of the share of the lane that is `unseen`. With them the plane does not follow the
    better seen end of a road that turns or loses its crown ahead. off_lane: (N, 2) [px] of `beside`: with them it does
    not lean with what lies beside the lane.

    Raises LinAlgError when the patches do not fix a plane.
    """
    unknowns = J.shape[1]
    loose = np.diag(np.r_[np.zeros(SLOTS), np.full(unknowns - SLOTS, config.max_bend_m**-2.0)])
    x, robust = _robust_fit(J, offset, variance, loose, config.robust_rounds, config.tukey, config.min_scale)
    if not np.isfinite(x).all():
        raise np.linalg.LinAlgError("the patches do not fix a plane")
    residual = offset - J @ x
    chi2 = float(np.sum(robust * residual**2 / variance) / np.sum(robust))
    # A chi2 below the floor says that the stated noise was too large, not that the fit is that sure.
    scale = max(chi2, config.min_chi2)
    every = J if further is None else np.hstack([J, further])
    more = every.shape[1] - unknowns
    if off_lane is not None:
        every = np.hstack([every, off_lane])
    weighted = every * (robust / (scale * variance))[:, None]
    A, right = every.T @ weighted, weighted.T @ offset

    sizes = np.geomspace(config.min_bend_m, config.max_bend_m, config.bend_sizes)
    sides = every.shape[1] - unknowns - more
    ratio = np.r_[np.ones(unknowns - SLOTS), np.full(more, config.further_of_bends), np.zeros(sides)]
    least_m = np.hypot(config.further_bend_m, config.further_unseen_m * unseen)
    least = np.r_[np.zeros(unknowns - SLOTS), np.full(more, least_m), np.full(sides, config.break_beside)]
    solution, covariance, average = average_over_sizes(
        A, right, SLOTS, sizes, config.bend_reluctance, ratio, least
    )
    if not np.isfinite(solution).all():
        raise np.linalg.LinAlgError("the patches do not fix a plane and its bends")
    return LaneFit(
        solution[:unknowns],
        covariance[:unknowns, :unknowns],
        (average @ weighted.T)[:unknowns],
        robust,
        offset - every @ solution,
        residual,
        scale,
    )


def beside(x_m: Array, config: DirectConfig) -> Array:
    """(N, 2) height of the road beside the lane, on its right and on its left, per m/m that it breaks off there.

    A crown, a gutter, a widening or the next lane's own crossfall runs all along: the lane's bends end at its edge.
    """
    half = config.lane_half_width_m
    return np.column_stack([np.maximum(x_m - half, 0.0), np.maximum(-x_m - half, 0.0)])


def unmodelled_covariance(
    fit: LaneFit, px_per_m: Array, further: Array, rough_m: float, unseen: float, config: DirectConfig
) -> Array:
    """(6, 6) of what further bends do to the solution, beyond what was expected of them in the fit.

    px_per_m: (N,) pixels of disparity per metre of height. Their size follows from what the lane shows of
    its character: how it twists, how rough it is left, and how much of it (0...1) is out of sight.
    """
    twist, along = fit.solution[SLOTS + 1 : SLOTS + 3]
    size = np.sqrt(
        config.further_bend_m**2
        + (config.further_per_twist * twist) ** 2
        + (config.further_per_along * along) ** 2
        + (config.further_per_roughness * rough_m) ** 2
        + (config.further_unseen_m * unseen) ** 2
    )
    response = fit.gain @ (further * px_per_m[:, None]) * size
    return response @ response.T


def row_covariance(fit: LaneFit, v: NDArray[np.int64], shared_px: float) -> Array:
    """(6, 6) of what patches on one row of the picture (N,) share, `shared_px` [px] 1 sigma."""
    rows = np.unique(v, return_inverse=True)[1]
    response = np.stack([np.bincount(rows, gain) for gain in fit.gain]) * shared_px
    return np.asarray(response @ response.T)


def own_unevenness(fit: LaneFit, J: Array, px_per_m: Array, area: Array, uneven_px: Array) -> Array:
    """(6, 6) to be added to `fit.covariance`, whose share of the unevenness takes the road for one of many alike.

    The plane that is meant is that of this very road, its unevenness included: the least-squares plane of the lane by
    `area` (N,) [m^2], 0 beside it. Of the unevenness (N,) [px], 1 sigma, only what the fit makes otherwise of it than
    that plane is an error.
    """
    plane = J[:, :SLOTS]
    weighted = (plane * (area / px_per_m**2)[:, None]).T
    off = fit.gain.copy()
    off[:SLOTS] -= np.linalg.solve(weighted @ plane, weighted)
    error, whole = off * uneven_px, fit.gain * uneven_px
    return fit.scale * (error @ error.T - whole @ whole.T)


def left_roughness(noise_m: Array, height_m: Array) -> float:
    """Rms height [m] left over plane and bends that the patches' noise (N,) [m] does not explain."""
    weight = 1.0 / (noise_m**2 + 0.003**2)
    excess = np.minimum(height_m**2, 0.03**2) - noise_m**2
    return float(np.sqrt(max(np.sum(weight * excess) / weight.sum(), 0.0)))


def unseen_share(x_m: Array, z_m: Array, config: DirectConfig) -> float:
    """Share of the lane without a patch."""
    return bent_square.unseen_share(*_normal(x_m, z_m, config))
