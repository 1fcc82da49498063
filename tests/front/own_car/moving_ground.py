"""A rolling picture of a textured ground, and things that stand still in it: quick to make, and known to the pixel."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from stereocalib_core.geometry import Extrinsics, StereoCamera
from stereocalib_core.numeric.arrays import Array, Grey, Mask

CAMERA = StereoCamera(320, 160, 185.0, 159.5, 55.0, 0.5)
ROAD = Extrinsics(1.65, 0.02, -0.01)
BONNET_PX = 45.0
"""Disparity of a bonnet 2 m ahead: more than twice that of the nearest road."""
CELL_M = 0.04
AHEAD = np.array([0.0, -ROAD.plane().normal[2] / ROAD.plane().normal[1], 1.0])
"""One metre along the optical axis, on the road."""


@cache
def ground(contrast: float, seed: int = 5) -> NDArray[np.float32]:
    """A texture of 41 x 41 m, grey levels about 110; it repeats."""
    rng = np.random.default_rng(seed)
    fine = cv2.GaussianBlur(rng.normal(size=(1024, 1024)).astype(np.float32), (0, 0), 1.5)
    coarse = cv2.GaussianBlur(rng.normal(size=(1024, 1024)).astype(np.float32), (0, 0), 8.0)
    return np.asarray(110.0 + contrast * (fine / fine.std() + coarse / coarse.std()), dtype=np.float32)


@cache
def _rays(right: bool) -> tuple[Array, Array, Array, Array]:
    """(H, W) column, row, and x and depth [m] of the ground, NaN above it; from the left camera."""
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width].astype(np.float64)
    x, y = (u - CAMERA.cx_px) / CAMERA.focal_px, (v - CAMERA.cy_px) / CAMERA.focal_px
    plane = ROAD.plane()
    down = plane.normal[0] * x + plane.normal[1] * y + plane.normal[2]
    depth = np.where(down > 0.01, plane.offset_m / np.maximum(down, 0.01), np.nan)
    return u, v, depth * x + (CAMERA.baseline_m if right else 0.0), depth


def seen(texture: NDArray[np.float32], z_m: float, right: bool) -> Array:
    """(H, W) the ground from `z_m` along the way, sky above it."""
    _, _, x, depth = _rays(right)
    at = [np.nan_to_num(np.mod(w / CELL_M, 1024.0)).astype(np.float32) for w in (x, depth + z_m)]
    near = cv2.remap(texture, at[0], at[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    # what is far is blurred by the pixels' own size
    blurred = np.clip(30.0 / np.nan_to_num(depth, nan=1e9), 0.0, 1.0)
    return np.asarray(np.where(np.isnan(depth), 190.0, 110.0 + blurred * (near - 110.0)))


def shape(kind: str, right: bool) -> Mask:
    """(H, W) where a bonnet is; in the right picture farther to the left."""
    mask = np.zeros((CAMERA.height, CAMERA.width), np.uint8)
    shift, (h, w) = (BONNET_PX if right else 0.0), mask.shape
    if kind == "flat":
        mask[-22:] = 1
    elif kind == "corner":
        cv2.ellipse(mask, (round(60 - shift), h + 8), (55, 45), 0, 0, 360, 1, -1)
    else:
        cv2.ellipse(mask, (round(w / 2 - shift), h + 15), (130, 50), 0, 0, 360, 1, -1)
    return mask.astype(np.bool_)


def paint(kind: str, right: bool, frame: int) -> Array:
    """(H, W) its grey levels."""
    h, w = CAMERA.height, CAMERA.width
    down = np.linspace(0.0, 1.0, h)[:, None]
    if kind == "dark":
        return np.full((h, w), 12.0)
    if kind == "glossy":
        # the sky's gradient, and houses and trees that pass by in the paint
        passing = np.random.default_rng(100 + frame + 50 * right).normal(size=(h, w)).astype(np.float32)
        passing = cv2.GaussianBlur(passing, (0, 0), 4.0)
        return np.asarray(90.0 + 90.0 * (down - 0.6) + 10.0 * passing / passing.std())
    lacquer = np.random.default_rng(3).normal(size=(h, 2 * w)).astype(np.float32)
    lacquer = cv2.GaussianBlur(lacquer, (0, 0), 2.0)
    first = round(BONNET_PX) if right else 0
    return np.asarray((70.0 + 40.0 * down + 6.0 * lacquer / lacquer.std())[:, first : first + w])


def pair(kind: str, texture: NDArray[np.float32], z_m: float, frame: int) -> tuple[Grey, Grey]:
    """Left and right picture with a bonnet, black borders, the car's own shadow or lamps, or nothing (`""`)."""
    both = []
    for right in (False, True):
        grey = seen(texture, z_m, right)
        u, v, _, _ = _rays(right)
        shift = ROAD.disparity_plane(CAMERA).disparity(CAMERA, u, v) if right else 0.0
        if kind == "shadow":
            grey = np.where((v > 135) & (np.abs(u + shift - 160) < 70), 0.5 * grey, grey)
        elif kind == "lamps":
            grey *= 0.4 + 0.6 * np.exp(-(((v - 125) / 12) ** 2) - ((u + shift - 160) / 60) ** 2)
        elif kind == "fog":
            grey = 0.15 * grey + 0.85 * 170.0
        elif kind == "night":
            grey *= 0.15
        elif kind in ("flat", "corner", "curved", "dark", "glossy"):
            mask = cv2.GaussianBlur(shape(kind, right).astype(np.float64), (0, 0), 0.7)
            grey = mask * paint(kind, right, frame) + (1.0 - mask) * grey
        grey = grey + np.random.default_rng(2 * frame + right).normal(0.0, 1.0, grey.shape)
        if kind == "borders":
            grey[-14:], grey[:, :20], grey[:, -12:] = 0.0, 0.0, 0.0
        both.append(grey.round().clip(0, 255).astype(np.uint8))
    return both[0], both[1]
