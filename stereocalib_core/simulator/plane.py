"""A flat textured road of exactly known height, pitch and roll: the analytic case that tests rest on."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from stereocalib_core.geometry import Extrinsics, StereoCamera, rotation_x, rotation_y, rotation_z
from stereocalib_core.simulator.textures import Atlas, build_atlas, sample, tileable_noise

TEXEL_M = 0.008
"""Edge of one texel of the finest texture on the road."""
SHADE_TEXEL_M = 0.04
FAR_M = 150.0
"""Beyond this the plane shows haze: its texture is finer than any filter resolves."""
_BOX_TEXEL_M = 0.02
_OPTICS = np.array([0.11, 0.78, 0.11])
"""Share of light in a row of three pixels: a picture without any blur holds frequencies that no one can match."""


@lru_cache(maxsize=4)
def _plane_atlas(seed: int) -> Atlas:
    """Textures: 0 asphalt, 1 large patches, 2 shade, 3 box walls."""
    rng = np.random.default_rng([seed, 11])
    grain = tileable_noise((1024, 1024), [(3, 14), (8, 12), (24, 8), (90, 6)], rng)
    patches = tileable_noise((512, 512), [(12, 8), (48, 10), (200, 10)], rng)
    leaves = tileable_noise((512, 512), [(10, 0.6), (40, 1.0), (120, 1.0)], rng)
    walls = tileable_noise((512, 512), [(4, 12), (16, 22), (64, 30)], rng)
    shade = np.where(leaves > 0.0, 255.0, 90.0)
    return build_atlas(
        [
            np.clip(np.rint(128 + grain), 0, 255).astype(np.uint8),
            np.clip(np.rint(128 + patches), 0, 255).astype(np.uint8),
            shade.astype(np.uint8),
            np.clip(np.rint(110 + walls), 0, 255).astype(np.uint8),
        ]
    )


def clutter_boxes(seed: int) -> NDArray[np.float64]:
    """(N, 6) x0, x1, y0, y1, z0, z1 [m] of cars beside and on the road, in the road frame (Y down)."""
    rng = np.random.default_rng([seed, 12])
    boxes = []
    for lane in (-6.0, -3.2, 3.0, 5.8):
        z = rng.uniform(6.0, 9.0)
        while z < 60.0:
            length, width, height = rng.uniform(3.6, 4.8), rng.uniform(1.6, 1.9), rng.uniform(1.35, 2.0)
            x = lane + rng.uniform(-0.2, 0.2)
            boxes.append((x - width / 2, x + width / 2, -height, 0.0, z, z + length))
            z += length + rng.uniform(1.0, 5.0)
    boxes.append((-0.9, 0.9, -1.5, 0.0, 24.0, 28.5))
    return np.array(boxes)


@njit(cache=True, nogil=True)
def _cast(  # type: ignore[no-untyped-def]
    texels, table, levels, K, R, c, boxes, shaded, width, height, image, depth
):
    """Fill image and depth, (H, W) float32 (depth 0: none, boxes < 0), seen from c with R_road_camera."""
    f, cx, cy = K
    for v in range(height):
        for u in range(width):
            a, b = (u - cx) / f, (v - cy) / f
            dx = R[0, 0] * a + R[0, 1] * b + R[0, 2]
            dy = R[1, 0] * a + R[1, 1] * b + R[1, 2]
            dz = R[2, 0] * a + R[2, 1] * b + R[2, 2]
            best = -c[1] / dy if dy > 1e-9 else 1e9
            face = -1
            hit = -1
            for k in range(boxes.shape[0]):
                near, far, axis = 0.0, 1e9, -1
                for j in range(3):
                    d = dx if j == 0 else (dy if j == 1 else dz)
                    if abs(d) < 1e-12:
                        d = 1e-12
                    t0 = (boxes[k, 2 * j] - c[j]) / d
                    t1 = (boxes[k, 2 * j + 1] - c[j]) / d
                    if t0 > t1:
                        t0, t1 = t1, t0
                    if t0 > near:
                        near, axis = t0, j
                    far = min(far, t1)
                if near < far and axis >= 0 and near < best:
                    best, face, hit = near, axis, k
            x, y, z = c[0] + best * dx, c[1] + best * dy, c[2] + best * dz
            if hit >= 0:
                s, t = (x, z) if face == 1 else ((z, y) if face == 0 else (x, y))
                step = best / f / _BOX_TEXEL_M
                tone = 0.6 + 0.25 * face + 0.1 * (hit % 4)
                image[v, u] = tone * sample(
                    texels,
                    table,
                    levels,
                    3,
                    s / _BOX_TEXEL_M + 97.0 * hit,
                    t / _BOX_TEXEL_M,
                    step,
                    0.0,
                    0.0,
                    step,
                    2,
                )
                depth[v, u] = -best
                continue
            if best > FAR_M:
                image[v, u] = 200.0
                depth[v, u] = 0.0 if best > 1e8 else best
                continue
            # the point X = c - c_y d / d_y moves over the road by these steps per pixel
            k = best / (f * dy)
            ux, vx = k * (R[0, 0] * dy - dx * R[1, 0]), k * (R[2, 0] * dy - dz * R[1, 0])
            uy, vy = k * (R[0, 1] * dy - dx * R[1, 1]), k * (R[2, 1] * dy - dz * R[1, 1])
            g = 1.0 / TEXEL_M
            value = sample(texels, table, levels, 0, x * g, z * g, ux * g, vx * g, uy * g, vy * g, 16)
            g = 1.0 / SHADE_TEXEL_M
            value *= (
                sample(texels, table, levels, 1, x * g, z * g, ux * g, vx * g, uy * g, vy * g, 16) / 128.0
            )
            if shaded:
                value *= (
                    sample(texels, table, levels, 2, x * g, z * g, ux * g, vx * g, uy * g, vy * g, 16) / 200.0
                )
            haze = (best / FAR_M) ** 2
            image[v, u] = value + haze * (200.0 - value)
            depth[v, u] = best


def right_rotation(
    pitch_deg: float = 0.0, roll_deg: float = 0.0, yaw_deg: float = 0.0
) -> NDArray[np.float64]:
    """(3, 3) R_left_right of a right camera turned by these angles, signs as everywhere: P_right = Rx Rz Ry P_left.

    pitch > 0 looks down, roll > 0 lets the horizon fall to the right, in the right picture.
    """
    pitch, roll, yaw = np.deg2rad([pitch_deg, roll_deg, yaw_deg])
    return (rotation_x(pitch) @ rotation_z(roll) @ rotation_y(yaw)).T


def render_plane(
    camera: StereoCamera,
    extrinsics: Extrinsics,
    seed: int = 0,
    noise: float = 1.5,
    exposure_difference: float = 0.0,
    clutter: bool = False,
    position_xz_m: ArrayLike = (0.0, 0.0),
    heading_rad: float = 0.0,
    R_left_right: NDArray[np.float64] | None = None,
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """The left and right picture, (H, W) uint8 each, of a flat textured road.

    `noise` is the standard deviation in grey levels; the right picture is brighter by the fraction
    `exposure_difference`. `clutter` covers about half of the road by cars and shade. The camera stands over
    `position_xz_m` of the textured plane and looks along `heading_rad` (> 0 turns right), less the yaw of
    `extrinsics`. `R_left_right` (3, 3) turns the right camera out of rectification.
    """
    left, right, _ = render_plane_truth(
        camera,
        extrinsics,
        seed,
        noise,
        exposure_difference,
        clutter,
        position_xz_m,
        heading_rad,
        R_left_right,
    )
    return left, right


def render_plane_truth(
    camera: StereoCamera,
    extrinsics: Extrinsics,
    seed: int = 0,
    noise: float = 1.5,
    exposure_difference: float = 0.0,
    clutter: bool = False,
    position_xz_m: ArrayLike = (0.0, 0.0),
    heading_rad: float = 0.0,
    R_left_right: NDArray[np.float64] | None = None,
) -> tuple[NDArray[np.uint8], NDArray[np.uint8], NDArray[np.float32]]:
    """As `render_plane`, and the true geometric disparity, (H, W) float32 [px], NaN = none."""
    atlas = _plane_atlas(seed)
    x, z = np.asarray(position_xz_m, dtype=np.float64)
    R_world_road = rotation_y(heading_rad - extrinsics.yaw_rad)
    R = R_world_road @ extrinsics.R_camera_road.T
    center = np.array([x, -extrinsics.height_m, z])
    boxes = clutter_boxes(seed) if clutter else np.zeros((0, 6))
    views = []
    R_right = R if R_left_right is None else R @ R_left_right
    cx_right = camera.cx_px if camera.cx_right_px is None else camera.cx_right_px
    rng = np.random.default_rng([seed, 13])
    for rotation, origin, cx, gain in (
        (R, center, camera.cx_px, 1.0),
        (R_right, center + R[:, 0] * camera.baseline_m, cx_right, 1.0 + exposure_difference),
    ):
        image = np.empty((camera.height, camera.width), np.float32)
        depth = np.empty_like(image)
        K = (camera.focal_px, cx, camera.cy_px)
        _cast(
            *(atlas.texels, atlas.table, atlas.levels, K, np.ascontiguousarray(rotation), origin, boxes),
            *(clutter, camera.width, camera.height, image, depth),
        )
        image = np.asarray(
            cv2.sepFilter2D(image, cv2.CV_32F, _OPTICS, _OPTICS, borderType=cv2.BORDER_REPLICATE)
        )
        image *= gain
        if noise > 0:
            image += noise * rng.standard_normal(image.shape, dtype=np.float32)
        views.append((np.clip(np.rint(image), 0, 255).astype(np.uint8), depth))
    depth = np.abs(views[0][1])
    with np.errstate(divide="ignore"):
        disparity = np.where(depth > 0, camera.focal_px * camera.baseline_m / depth, np.nan)
    return views[0][0], views[1][0], disparity.astype(np.float32)


def warm_up() -> None:
    """Compile this renderer, which tests and experiments use."""
    camera = StereoCamera(64, 48, 60.0, 32.0, 20.0, 0.5)
    render_plane(camera, Extrinsics.from_degrees(1.65, 0.8, -0.4), clutter=True)
