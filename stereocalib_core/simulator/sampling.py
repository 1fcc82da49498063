"""Anisotropic sampling of mip-mapped textures, eight pixels at once: `textures.sample`, side by side."""

from __future__ import annotations

from numba import njit

from stereocalib_core.numeric.wide import (
    as_doubles,
    as_floats,
    as_longs,
    bits,
    choose,
    doubles,
    doubles_of_bits,
    down,
    fused,
    gather,
    longs,
    size,
    some,
)
from stereocalib_core.simulator.textures import INLINED, KERNEL, MAX_LEVELS


@njit(**INLINED)
def larger(a, b):  # type: ignore[no-untyped-def]
    return choose(a > b, a, b)


@njit(**INLINED)
def smaller(a, b):  # type: ignore[no-untyped-def]
    return choose(a < b, a, b)


@njit(**INLINED)
def power_of_half(n):  # type: ignore[no-untyped-def]
    """0.5 to the n."""
    return doubles_of_bits((longs(1023) - n) << 52)


@njit(**INLINED)
def _bilinear(texels, start, log_w, log_h, u, v, alone):  # type: ignore[no-untyped-def]
    """Grey levels at u, v [texels of the level that begins at `start`, centres at half-integers], repeating.

    alone: the lanes of which this is the only tap, or the first of one in each level.
    """
    u, v = u - 0.5, v - 0.5
    fu, fv = down(u), down(v)
    a, b = as_floats(u - fu), as_floats(v - fv)
    mask_w, mask_h = (longs(1) << log_w) - 1, (longs(1) << log_h) - 1
    x = as_longs(fu) & mask_w
    line = as_longs(fv)
    y0, y1 = start + ((line & mask_h) << log_w), start + (((line + 1) & mask_h) << log_w)
    above, below = gather(texels, y0 + x), gather(texels, y1 + x)
    p, r = as_floats(above & 255), as_floats(below & 255)
    q, s = as_floats((above >> 8) & 255), as_floats((below >> 8) & 255)
    last = x == mask_w
    if some(last):
        q = choose(last, as_floats(gather(texels, y0) & 255), q)
        s = choose(last, as_floats(gather(texels, y1) & 255), s)
    top = fused(q - p, a, p)
    # rounded as `textures.sample` is once it is compiled
    drop = choose(alone, fused(s - r, a, r) - top, fused(s - r, a, r - top))
    return as_doubles(fused(drop, b, top))


@njit(**KERNEL)
def sample_wide(texels, starts, sizes, texture, u, v, ux, vx, uy, vy, max_taps):  # type: ignore[no-untyped-def]
    """Filtered grey levels of `texture` at u, v [texels of level 0], a lane each; arguments as of `textures.sample`.

    starts: (N MAX_LEVELS,) int64, where in `texels` each level begins; sizes (N,) int64: log2 width, 256 log2 height,
    65536 levels.
    """
    x2, y2 = ux * ux + vx * vx, uy * uy + vy * vy
    wider = x2 > y2
    major2, au, av = choose(wider, x2, y2), choose(wider, ux, uy), choose(wider, vx, vy)
    # the minor axis of the footprint parallelogram is its area over its major axis
    area = size(ux * vy - uy * vx) + 1e-12
    ratio = major2 / area
    taps = doubles(1.0)
    if max_taps > 1:
        taps = choose(ratio > 1.2, down(smaller(ratio + 0.8, doubles(max_taps))), 1.0)
    step = 1.0 / taps
    size2 = larger(major2 * step * step, area / ratio)
    # each level halves both sides: half the exponent, and what is left lies between 1 and 4
    low = (bits(size2) >> 52) - 1023
    low = choose(low > 0, low >> 1, 0)
    size2 = doubles_of_bits(bits(size2) - (low << 53))
    # the level between two, log2 of the square root of what is left, to 0.003
    x = size2 - 1.0
    blend = choose(x > 0.0, x * (0.6951 + x * (-0.2537 + x * (0.06757 - 0.00776 * x))), 0.0)
    shape = gather(sizes, texture)
    full_w, full_h, top = shape & 255, (shape >> 8) & 255, (shape >> 16) - 1
    beyond = low >= top
    low, blend = choose(beyond, top - 1, low), choose(beyond, 1.0, blend)
    if max_taps == 0:
        # one tap of the nearer level: for foliage, where no one sees levels change
        low = choose(blend > 0.5, low + 1, low)
        start = gather(starts, texture * MAX_LEVELS + low)
        lw, lh = smaller(low, full_w), smaller(low, full_h)
        u, v = u * power_of_half(lw), v * power_of_half(lh)
        return _bilinear(texels, start, full_w - lw, full_h - lh, u, v, taps < 0.0)
    single = taps < 1.5
    # one tap is one of each level; several take turns between the two levels, alike to both sides of the middle
    blend = choose(single & (blend < 0.02), 0.0, blend)
    pitch, shift = choose(single, 0.0, step), choose(single, 0.0, 0.5 * step - 0.5)
    count = choose(single, choose(blend > 0.0, 2.0, 1.0), taps)
    place = texture * MAX_LEVELS + low
    start0, start1 = gather(starts, place), gather(starts, place + 1)
    total, before, done = doubles(0.0), doubles(0.0), 0.0
    while some(count > done):
        aside = smaller(doubles(done), count - 1.0 - done) * blend + 0.5
        upper = choose(single, doubles(done), down(aside + blend) - down(aside)) > 0.5
        level = choose(upper, low + 1, low)
        lw, lh = smaller(level, full_w), smaller(level, full_h)
        value = _bilinear(
            texels,
            choose(upper, start1, start0),
            full_w - lw,
            full_h - lh,
            (u + shift * au) * power_of_half(lw),
            (v + shift * av) * power_of_half(lh),
            single & (level == low),
        )
        more = choose(single & upper, blend * (value - before), value)
        total = total + choose(count > done, more, 0.0)
        shift, before = shift + pitch, value
        done += 1.0
    return total * step
