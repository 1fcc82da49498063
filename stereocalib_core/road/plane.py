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
from numba import njit
from numpy.typing import NDArray

from stereocalib_core.config import DirectConfig
from stereocalib_core.geometry import DisparityPlane, Extrinsics, StereoCamera

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
    """

    extrinsics: Extrinsics
    covariance: Float
    patches: PatchFit
    unevenness_m: float
    agreement: float


@njit(cache=True, nogil=True)
def _lay_patches(
    height: int,
    width: int,
    f: float,
    cx: float,
    cy: float,
    b: float,
    plane: Float,
    camera_height: float,
    half_u: int,
    half_v: int,
    near: float,
    far: float,
    half_lane: float,
    allowed: NDArray[np.bool_],
    step: int,
) -> tuple[NDArray[np.int64], NDArray[np.int64], Float]:
    """Centres u, v (N,) and road distance (N,) of a tiling of the lane; `allowed` is on the disparity grid."""
    us, vs, zs = [], [], []
    rows, columns = allowed.shape
    for v in range(height - 3 - half_v, int(half_v) + 2, -(2 * half_v + 1)):
        middle = plane[0] * (v - cy) + plane[2]
        if middle <= 1.0:
            break
        if f * b / middle > 1.3 * far:
            break
        reach = int(half_lane / b * middle) + 1
        for k in range(-(reach // (2 * half_u + 1)), reach // (2 * half_u + 1) + 1):
            u = int(cx) + k * (2 * half_u + 1)
            d = plane[0] * (v - cy) + plane[1] * (u - cx) + plane[2]
            if d <= 1.0:
                continue
            z = f * b / d
            if z < near or z > far or abs((u - cx) * b / d) > half_lane:
                continue
            if u - half_u - 2 < 0 or u + half_u + 3 > width or u - d - half_u - 4 < 0:
                continue
            i, j = min(v // step, rows - 1), min(u // step, columns - 1)
            if allowed[i, j]:
                us.append(u)
                vs.append(v)
                zs.append(z)
    return np.array(us, np.int64), np.array(vs, np.int64), np.array(zs, np.float64)


@njit(cache=True, nogil=True)
def _align(
    left: NDArray[np.uint8],
    right: NDArray[np.uint8],
    cx: float,
    cy: float,
    shift: float,
    plane: Float,
    us: NDArray[np.int64],
    vs: NDArray[np.int64],
    half_u: int,
    half_v: int,
    sums: Float,
) -> None:
    """Per patch the sums of products of gradients and difference, (N, 6): uu, uv, vv, ur, vr, rr; uu = 0: nothing seen.

    The right image is read between its pixels by cubic convolution along the row. The gradient along u is
    the mean of left and warped right, which takes the noise of either out of the other's step; along v it
    is the left one.
    """
    n_u, n_v = 2 * half_u + 1, 2 * half_v + 1
    n = n_u * n_v
    warped = np.empty((n_v, n_u + 2))
    for p in range(len(us)):
        u0, v0 = us[p], vs[p]
        mean_l = mean_r = 0.0
        for a in range(n_v):
            v = v0 + a - half_v
            base = plane[0] * (v - cy) + plane[2] + shift
            for c in range(n_u + 2):
                u = u0 + c - half_u - 1
                x = u - (base + plane[1] * (u - cx))
                i = int(np.floor(x))
                t = x - i
                if i < 1 or i + 2 >= right.shape[1]:
                    i = min(max(i, 1), right.shape[1] - 3)
                p0, p1 = float(right[v, i - 1]), float(right[v, i])
                p2, p3 = float(right[v, i + 1]), float(right[v, i + 2])
                warped[a, c] = p1 + 0.5 * t * (
                    p2 - p0 + t * (2.0 * p0 - 5.0 * p1 + 4.0 * p2 - p3 + t * (3.0 * (p1 - p2) + p3 - p0))
                )
            for c in range(n_u):
                mean_l += left[v, u0 + c - half_u]
                mean_r += warped[a, c + 1]
        mean_l /= n
        mean_r /= n
        s_ll = s_rr = s_lr = 0.0
        for a in range(n_v):
            v = v0 + a - half_v
            for c in range(n_u):
                x_l = left[v, u0 + c - half_u] - mean_l
                x_r = warped[a, c + 1] - mean_r
                s_ll += x_l * x_l
                s_rr += x_r * x_r
                s_lr += x_l * x_r
        sums[p] = 0.0
        if s_ll < 2.0 * n or s_rr < 2.0 * n or s_lr < 0.3 * np.sqrt(s_ll * s_rr):
            continue
        gain = np.sqrt(s_ll / s_rr)
        m_u = m_v = uu = uv = vv = ur = vr = rr = 0.0
        for a in range(n_v):
            v = v0 + a - half_v
            for c in range(n_u):
                u = u0 + c - half_u
                g_l = float(left[v, u + 1]) - float(left[v, u - 1])
                g_u = 0.25 * (g_l + gain * (warped[a, c + 2] - warped[a, c]))
                g_v = 0.5 * (float(left[v + 1, u]) - float(left[v - 1, u]))
                r = (left[v, u] - mean_l) - gain * (warped[a, c + 1] - mean_r)
                m_u += g_u
                m_v += g_v
                uu += g_u * g_u
                uv += g_u * g_v
                vv += g_v * g_v
                ur += g_u * r
                vr += g_v * r
                rr += r * r
        sums[p, 0] = uu - m_u * m_u / n
        sums[p, 1] = uv - m_u * m_v / n
        sums[p, 2] = vv - m_v * m_v / n
        sums[p, 3] = ur
        sums[p, 4] = vr
        sums[p, 5] = rr


def _offsets(sums: Float, u: Float, trust: Float, pixels: int) -> tuple[Float, Float]:
    """Each patch's disparity offset [px] from the plane and its sigma (inf = nothing to see).

    The right image's rows may lie a little off: left - right = -offset g_u + dv g_v with one
    dv = dv_0 + dv_1 u for the lane, found from all patches with their own offsets eliminated. Without it an
    edge that runs nearly along the rows would turn dv into disparity.
    """
    uu, uv, vv, ur, vr, rr = sums.T
    seen = uu > 1e-6
    safe = np.where(seen, uu, 1.0)
    information = np.where(seen, np.maximum(vv - uv * uv / safe, 0.0), 0.0)
    pull = np.where(seen, vr - uv * ur / safe, 0.0)
    x = u / 100.0
    w = trust * information
    H = np.array([[w.sum(), (w * x).sum()], [(w * x).sum(), (w * x * x).sum()]])
    rows = np.zeros(len(u))
    if np.linalg.cond(H) < 1e8:
        a, b = np.linalg.solve(H, np.array([(trust * pull).sum(), (trust * pull * x).sum()]))
        rows = np.clip(a + b * x, -1.5, 1.5)
    offset = -(ur - rows * uv) / safe
    left_over = rr + offset**2 * uu + rows**2 * vv + 2 * offset * ur - 2 * rows * vr - 2 * offset * rows * uv
    sigma = np.sqrt((np.maximum(left_over, 0.0) / (pixels - 3) + 0.1) / safe)
    usable = seen & (np.abs(offset) <= 2.0)
    return np.where(usable, offset, 0.0), np.where(usable, sigma, np.inf)


def _tukey(residual: Float, limit: float) -> Float:
    return np.clip(1.0 - (residual / limit) ** 2, 0.0, None) ** 2


def _solve(
    J: Float, offset: Float, variance: Float, start: Float, config: DirectConfig
) -> tuple[Float, Float, float]:
    """Robust weighted least squares: (3,) update, (N,) robust weights, scale of the normalised residuals."""
    x = start
    for _ in range(config.robust_rounds):
        residual = (offset - J @ x) / np.sqrt(variance)
        scale = max(1.4826 * float(np.median(np.abs(residual))), config.min_scale)
        robust = _tukey(residual, config.tukey * scale)
        w = robust / variance
        H = (J * w[:, None]).T @ J
        x = np.asarray(np.linalg.solve(H, (J * w[:, None]).T @ offset), dtype=np.float64)
    return x, robust, scale


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
    us, vs, z = _lay_patches(
        camera.height, camera.width, f, cx, cy, b, parameters, start.height_m, half_u, half_v,
        config.near_m, config.far_m, config.lane_half_width_m, allowed, step_px,
    )  # fmt: skip
    if len(us) < config.min_patches:
        return None
    J_all = np.column_stack([vs - cy, us - cx, np.ones(len(us))])
    height_per_px = start.height_m * z / (f * b)
    area = (2 * half_u + 1) * z / f * (2 * half_v + 1) * z**2 / (f * start.height_m)
    shared = np.maximum(config.uneven_length_m**2 / area, 1.0)
    sums, trust = np.empty((len(us), 6)), np.ones(len(us))
    pixels = (2 * half_u + 1) * (2 * half_v + 1)
    unevenness = config.initial_unevenness_m
    for iteration in range(config.iterations):
        _align(left, right, cx, cy, camera.disparity_offset_px, parameters, us, vs, half_u, half_v, sums)
        offsets, sigmas = _offsets(sums, us - cx, trust, pixels)
        seen = np.isfinite(sigmas)
        if np.count_nonzero(seen) < config.min_patches:
            return None
        J, offset = J_all[seen], offsets[seen]
        noise = sigmas[seen] ** 2 + config.noise_floor_px**2
        road = (1.0 / height_per_px[seen]) ** 2
        variance = noise + unevenness**2 * road * shared[seen]
        try:
            x, robust, _ = _solve(J, offset, variance, np.zeros(3), config)
        except np.linalg.LinAlgError:
            return None
        parameters = parameters + x
        residual = offset - J @ x
        trust = np.zeros(len(us))
        trust[seen] = robust
        if iteration + 1 < config.iterations:
            unevenness = min(_unevenness(residual, noise, road, robust, config), config.max_unevenness_m)
    if not np.all(np.isfinite(parameters)) or parameters[0] <= 0:
        return None
    fitted = DisparityPlane(*(float(p) for p in parameters))
    extrinsics = fitted.extrinsics(camera)
    covariance = _covariance(J, residual, variance, robust, noise, road, shared[seen], unevenness, config)
    to_extrinsics = np.linalg.inv(extrinsics.disparity_plane_jacobian(camera))
    weight = trust
    patches = PatchFit(us.astype(np.float64), vs.astype(np.float64), z, offsets - J_all @ x, sigmas, weight)
    agreement = _agreement(offsets - J_all @ x, sigmas, height_per_px, area, config)
    return DirectFit(extrinsics, to_extrinsics @ covariance @ to_extrinsics.T, patches, unevenness, agreement)


def _agreement(
    residual: Float, sigmas: Float, height_per_px: Float, area: Float, config: DirectConfig
) -> float:
    """Share of the seen lane (by image area) that lies within `agree_height_m` of the plane."""
    seen = np.isfinite(sigmas)
    return float(np.mean(np.abs(residual[seen]) * height_per_px[seen] < config.agree_height_m))


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


def _covariance(
    J: Float,
    residual: Float,
    variance: Float,
    robust: Float,
    noise: Float,
    road: Float,
    shared: Float,
    unevenness: float,
    config: DirectConfig,
) -> Float:
    """(3, 3) of the plane's parameters from the residuals actually found."""
    keep = robust > 0
    w = robust / variance
    H_inv = np.linalg.inv((J * w[:, None]).T @ J)
    chi2 = float(np.sum(robust * residual**2 / (noise + unevenness**2 * road)) / np.sum(robust))
    true_variance = max(chi2, 0.3) * (noise + unevenness**2 * road * shared)
    meat = (J[keep] * (w[keep] ** 2 * true_variance[keep])[:, None]).T @ J[keep]
    return config.covariance_factor * H_inv @ meat @ H_inv
