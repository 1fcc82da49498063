"""Mip-mapped grey textures in one flat array, and their anisotropic sampling.

A texture is a continuous function of its coordinates; both cameras sample the same function with nearly the
same footprint, so that left and right agree to a small fraction of a pixel and nothing shimmers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

KERNEL: dict[str, Any] = {
    "cache": True,
    "nogil": True,
    "fastmath": True,
    "error_model": "numpy",
    "_nrt": False,
}
"""How compiled functions that make no array are compiled. Without `_nrt` numba counts the references to every
array at every call in every pixel, which takes longer than the work itself."""
INLINED: dict[str, Any] = {**KERNEL, "forceinline": True}

MAX_LEVELS = 18
_HALVES = 0.5 ** np.arange(MAX_LEVELS + 1)
_INVERSE = 1.0 / np.maximum(np.arange(33), 1)


@dataclass(frozen=True)
class Atlas:
    """All textures with all their levels.

    texels: (T + 3,) uint8, every level of every texture, row by row.
    table: (N, MAX_LEVELS, 3) int64: offset, log2 width, log2 height of each level.
    levels: (N,) int64 number of levels.
    starts, sizes: the same as `sample_wide` takes it.
    """

    texels: NDArray[np.uint8]
    table: NDArray[np.int64]
    levels: NDArray[np.int64]

    @cached_property
    def starts(self) -> NDArray[np.int64]:
        """(N MAX_LEVELS,) where each level begins."""
        return np.ascontiguousarray(self.table[:, :, 0]).ravel()

    @cached_property
    def sizes(self) -> NDArray[np.int64]:
        """(N,) log2 width, 256 log2 height and 65536 levels of each texture."""
        return np.asarray(self.table[:, 0, 1] + 256 * self.table[:, 0, 2] + 65536 * self.levels)


def build_atlas(textures: Sequence[NDArray[np.uint8]]) -> Atlas:
    """Textures (h, w) uint8, sides powers of two, to an atlas with box-filtered levels down to one texel."""
    table = np.zeros((len(textures), MAX_LEVELS, 3), np.int64)
    levels = np.zeros(len(textures), np.int64)
    parts: list[NDArray[np.uint8]] = []
    offset = 0
    for k, texture in enumerate(textures):
        level = texture
        while True:
            height, width = level.shape
            table[k, levels[k]] = offset, width.bit_length() - 1, height.bit_length() - 1
            levels[k] += 1
            parts.append(level.ravel())
            offset += level.size
            if width == 1 and height == 1:
                break
            level = halve(level)
    # four texels are read at a time
    parts.append(np.zeros(3, np.uint8))
    return Atlas(np.concatenate(parts), table, levels)


def halve(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(h, w) uint8 to half size in every side longer than one texel, box filter, rounded."""
    if image.shape[0] > 1 and image.shape[1] > 1:
        quads = image.astype(np.uint16)
        total = quads[0::2, 0::2] + quads[0::2, 1::2]
        total += quads[1::2, 0::2]
        total += quads[1::2, 1::2]
        return ((total + 2) >> 2).astype(np.uint8)
    pairs = image.astype(np.uint16).reshape(-1, 2)
    half = ((pairs[:, 0] + pairs[:, 1] + 1) >> 1).astype(np.uint8)
    return half[:, None] if image.shape[1] == 1 else half[None, :]


def tileable_noise(
    size: tuple[int, int], octaves: Sequence[tuple[float, float]], rng: np.random.Generator
) -> NDArray[np.float32]:
    """(h, w) float32 periodic noise of zero mean: the sum of band-limited octaves.

    `octaves`: (wavelength in texels, standard deviation) each.
    """
    height, width = size
    fy = np.fft.fftfreq(height)[:, None]
    fx = np.fft.rfftfreq(width)[None, :]
    pitch = np.log2(np.maximum(np.hypot(fy, fx), 1e-9)).astype(np.float32)
    # how often each column of the half spectrum stands for one of the whole
    twice = np.full(fx.shape, 2.0, np.float32)
    twice[0, 0] = 1.0
    if width % 2 == 0:
        twice[0, -1] = 1.0
    total = np.zeros(pitch.shape, np.complex64)
    for wavelength, sigma in octaves:
        white = np.fft.rfft2(rng.standard_normal(size).astype(np.float32))
        band = white * np.exp((pitch + np.float32(np.log2(wavelength))) ** 2 * np.float32(-0.5 / 0.36))
        power = float(np.sum(twice * (band.real**2 + band.imag**2), dtype=np.float64))
        total += band * np.float32(sigma * height * width / max(math.sqrt(power), 1e-12))
    return np.fft.irfft2(total, s=size).astype(np.float32)


@njit(**INLINED)
def bilinear(texels, offset, log_w, log_h, u, v):  # type: ignore[no-untyped-def]
    """Grey level at u, v [texels of this level, centres at half-integers], repeating."""
    u -= 0.5
    v -= 0.5
    fu = math.floor(u)
    fv = math.floor(v)
    a = np.float32(u - fu)
    b = np.float32(v - fv)
    # unsigned indices spare numba's wrap-around of negative ones
    one, shift = np.uint64(1), np.uint64(log_w)
    mask_w = (one << shift) - one
    mask_h = (one << np.uint64(log_h)) - one
    column, line, start = np.uint64(np.int64(fu)), np.uint64(np.int64(fv)), np.uint64(offset)
    x0 = column & mask_w
    x1 = (column + one) & mask_w
    y0 = start + ((line & mask_h) << shift)
    y1 = start + (((line + one) & mask_h) << shift)
    p, q = np.float32(texels[y0 + x0]), np.float32(texels[y0 + x1])
    r, s = np.float32(texels[y1 + x0]), np.float32(texels[y1 + x1])
    top = p + (q - p) * a
    return top + (r + (s - r) * a - top) * b


@njit(**INLINED)
def sample(texels, table, levels, tex, u, v, ux, vx, uy, vy, max_taps):  # type: ignore[no-untyped-def]
    """Filtered grey level of texture `tex` at u, v [texels of level 0].

    (ux, vx) and (uy, vy) are the steps of u, v over one pixel of the image in x and in y. Up to `max_taps`
    taps (at most 32) lie along the longer axis of that footprint; 0 = one tap of one level, for foliage.
    """
    x2 = ux * ux + vx * vx
    y2 = uy * uy + vy * vy
    if x2 > y2:
        major2, au, av = x2, ux, vx
    else:
        major2, au, av = y2, uy, vy
    # the minor axis of the footprint parallelogram is its area over its major axis
    area = abs(ux * vy - uy * vx) + 1e-12
    ratio = major2 / area
    taps = 1
    if ratio > 1.2 and max_taps > 1:
        taps = min(int(ratio + 0.8), max_taps)
    size2 = max(major2 * _INVERSE[taps] * _INVERSE[taps], area / ratio)
    low = 0
    while size2 >= 4.0:
        size2 *= 0.25
        low += 1
    # the level between two, log2 of the square root of what is left, to 0.003
    blend = 0.0
    if size2 > 1.0:
        x = size2 - 1.0
        blend = x * (0.6951 + x * (-0.2537 + x * (0.06757 - 0.00776 * x)))
    top = levels[tex] - 1
    if low >= top:
        low = top - 1
        blend = 1.0
    if max_taps == 0:
        # one tap of the nearer level: for foliage, where no one sees levels change
        low = low + 1 if blend > 0.5 else low
        o0, w0, h0 = table[tex, low, 0], table[tex, low, 1], table[tex, low, 2]
        return bilinear(
            texels, o0, w0, h0, u * _HALVES[table[tex, 0, 1] - w0], v * _HALVES[table[tex, 0, 2] - h0]
        )
    w_full, h_full = table[tex, 0, 1], table[tex, 0, 2]
    o0, w0, h0 = table[tex, low, 0], table[tex, low, 1], table[tex, low, 2]
    o1, w1, h1 = table[tex, low + 1, 0], table[tex, low + 1, 1], table[tex, low + 1, 2]
    su0, sv0 = _HALVES[w_full - w0], _HALVES[h_full - h0]
    if taps == 1:
        value = bilinear(texels, o0, w0, h0, u * su0, v * sv0)
        if blend > 0.02:
            su1, sv1 = _HALVES[w_full - w1], _HALVES[h_full - h1]
            value += blend * (bilinear(texels, o1, w1, h1, u * su1, v * sv1) - value)
        return value
    su1, sv1 = _HALVES[w_full - w1], _HALVES[h_full - h1]
    total = 0.0
    step = _INVERSE[taps]
    shift = 0.5 * step - 0.5
    # Taps take turns between the two levels, in the proportion of the blend, and alike to both sides of the middle: the
    # coarser level weighs less where texture is fine, and a tap of it on one side only would move the texture.
    for k in range(taps):
        pu = u + shift * au
        pv = v + shift * av
        n = min(k, taps - 1 - k)
        if math.floor(n * blend + blend + 0.5) > math.floor(n * blend + 0.5):
            total += bilinear(texels, o1, w1, h1, pu * su1, pv * sv1)
        else:
            total += bilinear(texels, o0, w0, h0, pu * su0, pv * sv0)
        shift += step
    return total * step
