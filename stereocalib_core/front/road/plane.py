"""Direct road-plane alignment: left against right over the disparity plane of the road's own region.

The region about the car's way is tiled with small patches. Each patch is warped by the current plane, aligned by one
Gauss-Newton step in disparity (its own gain and bias, so exposure and shade do not matter), and the plane
is fitted robustly to the patches' offsets. Repeating this converges to the photometric optimum over the
plane's three parameters while cars, kerbs and specular spots show as single patches and drop out; the
patches' scatter gives the covariance.

A road is not flat to the millimetre. Its unevenness, estimated from the scatter that the pictures'
noise does not explain, is a height error shared within `uneven_length_m`; weighting by it makes the
plane the least-squares plane of the surface rather than of the image.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from stereocalib_core.config import DirectConfig
from stereocalib_core.front.matching import shrunk
from stereocalib_core.front.road.patches import align, lay_patches, offsets_of
from stereocalib_core.front.road.region import Region
from stereocalib_core.front.road.surface import (
    SLOTS,
    bends,
    beside,
    fit_lane,
    further_bends,
    left_roughness,
    own_unevenness,
    row_covariance,
    unmodelled_covariance,
    unseen_share,
)
from stereocalib_core.geometry import DisparityPlane, Extrinsics, StereoCamera
from stereocalib_core.numeric.arrays import Array, Grey

LANE_LENGTH_M = DirectConfig().far_m - DirectConfig().near_m
"""Of the lane that `uneven_length_m` is told for."""


@dataclass(frozen=True)
class PatchFit:
    """Patches (N,) with image centre u, v [px], road distance z [m], offset from the plane and its noise sigma [px].

    weight: (N,) 0...1 robust weight of the last fit; 0 = rejected.
    """

    u: Array
    v: Array
    z: Array
    offset_px: Array
    sigma_px: Array
    weight: Array


@dataclass(frozen=True)
class DirectFit:
    """extrinsics with (3, 3) covariance of height [m], pitch, roll [rad].

    unevenness_m: height scatter of the road that the noise does not explain, 1 sigma.
    agreement: share of the lane's patches within `agree_height_m` of the plane, 0...1.
    roughness_m: rms height of the lane's nearer part over the plane, over its surface, rejected patches included.
    """

    extrinsics: Extrinsics
    covariance: Array
    patches: PatchFit
    unevenness_m: float
    agreement: float
    roughness_m: float


def fit_direct(
    left: NDArray[np.uint8],
    right: NDArray[np.uint8],
    camera: StereoCamera,
    region: Region,
    step_px: int,
    config: DirectConfig,
) -> DirectFit | None:
    """Align right (H, W) to left (H, W) over the road's region on the disparity grid, from its plane.

    The plane is meant over the lane about the car's way, from the region's nearest to `far_m` of `config`; only
    what the region covers is looked at, and the road beside the lane where the lane itself is hardly seen.

    None when too few patches have texture or the fit degenerates.
    """
    left, right, camera, grid = _alike_kitti(left, right, camera, step_px)
    start, way = region.plane_at(camera), region.strip
    wide = region.share < config.wide_below
    as_seen = wide or way.curvature_per_m != 0.0
    parameters = np.array([start.a, start.b, start.c_px])
    f, cx, cy, b = (float(x) for x in (camera.focal_px, camera.cx_px, camera.cy_px, camera.baseline_m))
    half_u, half_v = config.patch_half_width_px, config.patch_half_height_px
    # Roads are rough at every scale alike (ISO 8608): what plane and bends leave of a shorter stretch is shorter too.
    alike_m = config.uneven_length_m * min((config.far_m - config.near_m) / LANE_LENGTH_M, 1.0)
    half_m = config.wide_half_width_m if wide else config.fit_half_width_m
    rig = start.extrinsics(camera)
    height_m, across = rig.height_m, across_of(rig, f)
    us, vs, z = lay_patches(
        camera.height, camera.width, f, cx, cy, b, parameters, half_u, half_v, *region.range_m, half_m, across,
        way.slope, way.curvature_per_m, *_solid(region.cells, config), grid, config.min_solid,
    )  # fmt: skip
    if len(us) < config.min_patches:
        return None
    J_plane = np.column_stack([vs - cy, us - cx, np.ones(len(us))])
    x_m = z * (J_plane @ across[[1, 0, 2]]) - way.slope * z - 0.5 * way.curvature_per_m * z**2
    px_per_m = f * b / (height_m * z)
    if as_seen:
        x_m, config = _over_region(x_m, z, config)
    shapes = bends(x_m, z, config)
    if as_seen:
        shapes[:, 2] = 0.0  # what bends along the car is another road's crossfall there, and told as such
    J_bends = shapes * px_per_m[:, None]
    J = np.hstack([J_plane, J_bends])
    further = further_bends(x_m, z, config)
    if as_seen:
        further[:, 0] = 0.0
    J_further = further * px_per_m[:, None]
    area = (2 * half_u + 1) * z / f * (2 * half_v + 1) * z**2 / (f * height_m)
    shared = np.maximum(alike_m**2 / area, 1.0)
    beside_m = beside(x_m, config)
    J_beside = beside_m * px_per_m[:, None]
    off_lane = config.uneven_beside * beside_m.sum(axis=1)
    sums, trust = np.empty((len(us), 6)), np.ones(len(us))
    pixels = (2 * half_u + 1) * (2 * half_v + 1)
    unevenness = config.initial_unevenness_m
    bent = np.zeros(len(us))
    for iteration in range(config.iterations):
        align(
            left, right, camera.cx_px, camera.cy_px, camera.disparity_offset_px, parameters, bent, us, vs,
            half_u, half_v, sums,
        )  # fmt: skip
        offsets, sigmas = offsets_of(sums, us.astype(np.float64) - cx, trust, pixels)
        offsets = offsets + bent
        seen = np.isfinite(sigmas)
        if np.count_nonzero(seen) < config.min_patches:
            return None
        noise = sigmas[seen] ** 2 + config.noise_floor_px**2
        road = px_per_m[seen] ** 2
        variance = noise + (unevenness**2 * shared[seen] + off_lane[seen] ** 2) * road
        try:
            unseen = unseen_share(x_m[seen], z[seen], config)
            fit = fit_lane(J[seen], offsets[seen], variance, config, J_further[seen], unseen, J_beside[seen])
        except np.linalg.LinAlgError:
            return None
        parameters = parameters + fit.solution[:SLOTS]
        bent = J_bends @ fit.solution[SLOTS:]
        held_unevenness = unevenness
        trust = np.zeros(len(us))
        trust[seen] = fit.robust
        if iteration + 1 < config.iterations:
            # A camber that was held small for the unevenness it was taken for must not prove that unevenness.
            unevenness = min(
                _unevenness(fit.beyond_shape, noise, road, fit.robust, config), config.max_unevenness_m
            )
    if not np.all(np.isfinite(parameters)) or parameters[0] <= 0:
        return None
    extrinsics = DisparityPlane(*(float(p) for p in parameters)).extrinsics(camera)
    over_plane_m = (offsets - J_plane @ fit.solution[:SLOTS]) / px_per_m
    # Where the whole region is meant, camber and twist are its own shape and no roughness.
    rough_m = over_plane_m - (shapes @ fit.solution[SLOTS:] if as_seen else 0.0)
    judged = seen if as_seen else seen & (np.abs(x_m) <= config.lane_half_width_m)
    if not judged.any():
        return None
    uneven_px = held_unevenness * np.sqrt(shared[seen]) * px_per_m[seen]
    lane = area[seen] * (fit.robust > 0.0) * (np.abs(x_m[seen]) <= config.lane_half_width_m)
    enough = np.count_nonzero(lane) >= config.min_patches
    own = own_unevenness(fit, J[seen], px_per_m[seen], lane, uneven_px) if enough else 0.0
    if as_seen:
        own = region.share * own  # the rest of the way ahead is out of sight, and as uneven as any road
    covariance = fit.covariance + own + unmodelled_covariance(
        fit, px_per_m[seen], further_bends(x_m[seen], z[seen], config),
        left_roughness(sigmas[seen] / px_per_m[seen], fit.residual / px_per_m[seen]),
        unseen, config,
    ) + row_covariance(fit, vs[seen], config.noise_shared_px)  # fmt: skip
    to_extrinsics = np.linalg.inv(extrinsics.disparity_plane_jacobian(camera))
    return DirectFit(
        extrinsics,
        to_extrinsics @ covariance[:SLOTS, :SLOTS] @ to_extrinsics.T,
        PatchFit(us.astype(np.float64), vs.astype(np.float64), z, over_plane_m * px_per_m, sigmas, trust),
        unevenness,
        float(np.mean(np.abs(rough_m[judged]) < config.agree_height_m)),
        _roughness(rough_m, z, judged, config),
    )


def across_of(rig: Extrinsics, focal_px: float) -> Array:
    """(3,) of u and v from the principal point, and 1: X of a road point per metre of its depth (eq. 13).

    From under the camera, which a rolled one has beside its picture's middle.
    """
    sin_roll = np.sin(rig.roll_rad)
    along = np.array([np.cos(rig.roll_rad), sin_roll * np.cos(rig.pitch_rad), 0.0]) / focal_px
    along[2] = sin_roll * np.sin(rig.pitch_rad)
    return along


def _over_region(x_m: Array, z_m: Array, config: DirectConfig) -> tuple[Array, DirectConfig]:
    """Patches' place across, from the middle of the region, and the settings with the region in the lane's place."""
    area = z_m**3
    middle = np.average(x_m, weights=area)
    # a strip of even width spreads by its half width over the root of three
    half = np.sqrt(3.0 * np.average((x_m - middle) ** 2, weights=area))
    return x_m - middle, dataclasses.replace(
        config,
        near_m=float(z_m.min()),
        far_m=float(z_m.max()),
        lane_half_width_m=float(half),
        max_unevenness_m=config.max_unevenness_wide_m,
    )


def shrink_of(step_px: int) -> int:
    """By how much pictures are shrunk for the patches, whose disparity grid has this step."""
    return max(step_px // 2, 1)


def _alike_kitti(
    left: Grey, right: Grey, camera: StereoCamera, step_px: int
) -> tuple[Grey, Grey, StereoCamera, int]:
    """Pictures, camera and the disparity grid's step in them, at the size at which a grid of two pixels is theirs.

    Finer pictures would show patches nothing but their own unevenness, at many times the work.
    """
    by = shrink_of(step_px)
    if by == 1:
        return left, right, camera, step_px
    return shrunk(left, by), shrunk(right, by), camera.shrunk(by), step_px // by


def _solid(allowed: NDArray[np.bool_], config: DirectConfig) -> tuple[NDArray[np.bool_], NDArray[np.int32]]:
    """The mask and the (h + 1, w + 1) sums of it with its pinholes closed: what tells an edge from a hole."""
    hole = np.ones((config.pinhole_cells, config.pinhole_cells), np.uint8)
    closed = cv2.morphologyEx(allowed.view(np.uint8), cv2.MORPH_CLOSE, hole)
    return allowed, np.asarray(cv2.integral(closed), dtype=np.int32)


def _roughness(over_plane: Array, z: Array, seen: NDArray[np.bool_], config: DirectConfig) -> float:
    """Rms height [m] over the plane up to `rough_range_m`; a patch stands for z^3 of surface."""
    near = seen & (z < config.rough_range_m)
    if not near.any():
        return 0.0
    return float(np.sqrt(np.average(np.minimum(over_plane[near] ** 2, 0.04), weights=z[near] ** 3)))


def _unevenness(residual: Array, noise: Array, road: Array, robust: Array, config: DirectConfig) -> float:
    """1 sigma of road height [m] that explains the scatter beyond the noise, by moments of the kept patches."""
    keep = robust > 0
    excess = (residual[keep] ** 2 - noise[keep]) / road[keep]
    # weights by the precision of each patch's own excess
    w = 1.0 / (noise[keep] / road[keep] + config.initial_unevenness_m**2) ** 2
    mean = np.sum(w * excess) / np.sum(w)
    # What the noise alone would give is not unevenness: two standard errors are taken off.
    error = np.sqrt(np.sum(2.0 * (w * noise[keep] / road[keep]) ** 2)) / np.sum(w)
    return float(np.sqrt(max(mean - 2.0 * error, 0.0)))
