"""Direct road-plane alignment: left against right over the disparity plane of the car's own lane.

The lane is tiled with small patches. Each patch is warped by the current plane, aligned by one
Gauss-Newton step in disparity (its own gain and bias, so exposure and shade do not matter), and the plane
is fitted robustly to the patches' offsets. Repeating this converges to the photometric optimum over the
plane's three parameters while cars, kerbs and specular spots show as single patches and drop out; the
patches' scatter gives the covariance.

A road is not flat to the millimetre. Its unevenness, estimated from the scatter that the pictures'
noise does not explain, is a height error shared within `uneven_length_m`; weighting by it makes the
plane the least-squares plane of the surface rather than of the image.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.config import DirectConfig
from stereocalib_core.geometry import DisparityPlane, Extrinsics, StereoCamera
from stereocalib_core.road.patches import align, lay_patches, offsets_of

Float = NDArray[np.float64]


@dataclass(frozen=True)
class PatchFit:
    """Patches (N,) with image centre u, v [px], road distance z [m], offset from the plane and its noise sigma [px].

    weight: (N,) 0...1 robust weight of the last fit; 0 = rejected.
    """

    u: Float
    v: Float
    z: Float
    offset_px: Float
    sigma_px: Float
    weight: Float


@dataclass(frozen=True)
class DirectFit:
    """extrinsics with (3, 3) covariance of height [m], pitch, roll [rad].

    unevenness_m: height scatter of the road that the noise does not explain, 1 sigma.
    agreement: share of the lane's patches within `agree_height_m` of the plane, 0...1.
    roughness_m: rms height of the lane's nearer part over the plane, over its surface, rejected patches included.
    """

    extrinsics: Extrinsics
    covariance: Float
    patches: PatchFit
    unevenness_m: float
    agreement: float
    roughness_m: float


def _tukey(residual: Float, limit: float) -> Float:
    return np.clip(1.0 - (residual / limit) ** 2, 0.0, None) ** 2


def _bends(x_m: Float, z_m: Float, config: DirectConfig) -> Float:
    """(N, 2) what a lane does besides being a plane: it is cambered and it twists; in units of 1 m of height.

    Both have mean zero and no slope over the lane from `near_m` to `far_m`, so that the plane that is left is
    the least-squares plane of the surface, however unevenly the picture samples it.
    """
    x = x_m / config.lane_half_width_m
    z = (z_m - 0.5 * (config.far_m + config.near_m)) / (0.5 * (config.far_m - config.near_m))
    return np.column_stack([x * x - 1.0 / 3.0, x * z])


def _solve(
    J: Float, offset: Float, variance: Float, prior_m: Float, config: DirectConfig
) -> tuple[Float, Float]:
    """Robust weighted least squares of (N, 5) plane and bends: (5,) solution, (N,) robust weights.

    prior_m: (2,) how large the bends may be [m], 1 sigma.
    """
    x = np.zeros(J.shape[1])
    prior = np.diag(np.concatenate([np.zeros(3), 1.0 / prior_m**2]))
    for _ in range(config.robust_rounds):
        residual = (offset - J @ x) / np.sqrt(variance)
        scale = max(1.4826 * float(np.median(np.abs(residual))), config.min_scale)
        robust = _tukey(residual, config.tukey * scale)
        w = robust / variance
        H = (J * w[:, None]).T @ J + prior
        x = np.asarray(np.linalg.solve(H, (J * w[:, None]).T @ offset), dtype=np.float64)
    return x, robust


def _bend_prior(x: Float, covariance: Float, config: DirectConfig) -> Float:
    """(2,) sizes [m] of the bends that the fit itself supports: what is not significant is held near zero."""
    excess = x[3:] ** 2 - config.bend_significance * np.diag(covariance)[3:]
    return np.clip(np.sqrt(np.maximum(excess, 0.0)), config.min_bend_m, config.max_bend_m)


def fit_direct(
    left: NDArray[np.uint8],
    right: NDArray[np.uint8],
    camera: StereoCamera,
    start: Extrinsics,
    allowed: NDArray[np.bool_],
    step_px: int,
    config: DirectConfig,
) -> DirectFit | None:
    """Align right (H, W) to left (H, W) over the road plane, from `start`; `allowed` (h, w) is the free map.

    None when too few patches have texture or the fit degenerates.
    """
    plane = start.disparity_plane(camera)
    parameters = np.array([plane.a, plane.b, plane.c_px])
    f, cx, cy, b = (float(x) for x in (camera.focal_px, camera.cx_px, camera.cy_px, camera.baseline_m))
    half_u, half_v = config.patch_half_width_px, config.patch_half_height_px
    us, vs, z = lay_patches(
        camera.height, camera.width, f, cx, cy, b, parameters, start.height_m, half_u, half_v,
        config.near_m, config.far_m, config.lane_half_width_m, allowed, step_px,
    )  # fmt: skip
    if len(us) < config.min_patches:
        return None
    J_all = np.column_stack([vs - cy, us - cx, np.ones(len(us))])
    height_per_px = start.height_m * z / (f * b)
    bends_all = _bends((us - cx) * z / f, z, config) / height_per_px[:, None]
    area = (2 * half_u + 1) * z / f * (2 * half_v + 1) * z**2 / (f * start.height_m)
    shared = np.maximum(config.uneven_length_m**2 / area, 1.0)
    sums, trust = np.empty((len(us), 6)), np.ones(len(us))
    pixels = (2 * half_u + 1) * (2 * half_v + 1)
    unevenness = config.initial_unevenness_m
    for iteration in range(config.iterations):
        align(left, right, cx, cy, camera.disparity_offset_px, parameters, us, vs, half_u, half_v, sums)
        offsets, sigmas = offsets_of(sums, us.astype(np.float64) - cx, trust, pixels)
        seen = np.isfinite(sigmas)
        if np.count_nonzero(seen) < config.min_patches:
            return None
        J, offset = np.hstack([J_all[seen], bends_all[seen]]), offsets[seen]
        noise = sigmas[seen] ** 2 + config.noise_floor_px**2
        road = (1.0 / height_per_px[seen]) ** 2
        variance = noise + unevenness**2 * road * shared[seen]
        try:
            open_prior = np.full(bends_all.shape[1], config.max_bend_m)
            x, robust = _solve(J, offset, variance, open_prior, config)
            spread = _covariance(J, offset - J @ x, variance, robust, open_prior)
            prior = _bend_prior(x, spread, config)
            x, robust = _solve(J, offset, variance, prior, config)
        except np.linalg.LinAlgError:
            return None
        parameters = parameters + x[:3]
        residual = offset - J @ x
        trust = np.zeros(len(us))
        trust[seen] = robust
        if iteration + 1 < config.iterations:
            unevenness = min(_unevenness(residual, noise, road, robust, config), config.max_unevenness_m)
    if not np.all(np.isfinite(parameters)) or parameters[0] <= 0:
        return None
    fitted = DisparityPlane(*(float(p) for p in parameters))
    extrinsics = fitted.extrinsics(camera)
    covariance = config.covariance_factor * _covariance(J, residual, variance, robust, prior)[:3, :3]
    to_extrinsics = np.linalg.inv(extrinsics.disparity_plane_jacobian(camera))
    surface = _surface_variance(x, unevenness, config)
    weight = trust
    patches = PatchFit(
        us.astype(np.float64), vs.astype(np.float64), z, offsets - J_all @ x[:3], sigmas, weight
    )
    over_plane = (offsets - J_all @ x[:3]) * height_per_px
    agreement = float(np.mean(np.abs(over_plane[np.isfinite(sigmas)]) < config.agree_height_m))
    roughness = _roughness(over_plane, z, np.isfinite(sigmas), config)
    return DirectFit(
        extrinsics,
        to_extrinsics @ covariance @ to_extrinsics.T + surface,
        patches,
        unevenness,
        agreement,
        roughness,
    )


def _roughness(over_plane: Float, z: Float, seen: NDArray[np.bool_], config: DirectConfig) -> float:
    """Rms height [m] over the plane up to `rough_range_m`; a patch stands for z^3 of surface."""
    near = seen & (z < config.rough_range_m)
    if not near.any():
        return 0.0
    return float(np.sqrt(np.average(np.minimum(over_plane[near] ** 2, 0.04), weights=z[near] ** 3)))


def _surface_variance(x: Float, unevenness_m: float, config: DirectConfig) -> Float:
    """(3, 3) of height, pitch, roll: a surface that bends so much also does what plane and bends do not describe.

    Along the lane no bend is fitted, so more is left there than across.
    """
    rough = float(np.sum(x[3:] ** 2)) + unevenness_m**2
    along = config.unmodelled_along**2 * rough
    across = config.unmodelled_across**2 * rough
    half_length = 0.5 * (config.far_m - config.near_m)
    return np.diag([along, along / half_length**2, across / config.lane_half_width_m**2])


def _unevenness(residual: Float, noise: Float, road: Float, robust: Float, config: DirectConfig) -> float:
    """1 sigma of road height [m] that explains the scatter beyond the noise, by moments of the kept patches."""
    keep = robust > 0
    excess = (residual[keep] ** 2 - noise[keep]) / road[keep]
    # weights by the precision of each patch's own excess
    w = 1.0 / (noise[keep] / road[keep] + config.initial_unevenness_m**2) ** 2
    mean = np.sum(w * excess) / np.sum(w)
    # What the noise alone would give is not unevenness: two standard errors are taken off.
    error = np.sqrt(np.sum(2.0 * (w * noise[keep] / road[keep]) ** 2)) / np.sum(w)
    return float(np.sqrt(max(mean - 2.0 * error, 0.0)))


def _covariance(J: Float, residual: Float, variance: Float, robust: Float, prior_m: Float) -> Float:
    """(5, 5) of plane and bends, from the residuals actually found."""
    w = robust / variance
    prior = np.diag(np.concatenate([np.zeros(3), 1.0 / prior_m**2]))
    chi2 = float(np.sum(w * residual**2) / np.sum(robust))
    H = (J * w[:, None]).T @ J
    H_inv = np.linalg.inv(H + prior)
    meat = max(chi2, 0.3) * ((J * (robust * w)[:, None]).T @ J) + prior
    return np.asarray(H_inv @ meat @ H_inv, dtype=np.float64)
