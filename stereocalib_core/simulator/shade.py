"""From visible triangles to grey: textures, light, haze and sky, once per pixel and triangle.

A pixel whose samples see several triangles has a part of each. The parts of a row of pixels are sorted by what they are
of, and eight of a kind are worked on at once.
"""

from __future__ import annotations

import math

from numba import njit

from stereocalib_core.numeric.wide import (
    DOUBLES,
    choose,
    doubles,
    gather,
    load,
    longs,
    size,
    some,
    store,
)
from stereocalib_core.simulator.raster import FLAG_ALPHA, FLAG_GROUND, PLANES, SAMPLES
from stereocalib_core.simulator.sampling import larger, sample_wide, smaller
from stereocalib_core.simulator.textures import INLINED, KERNEL

MAX_TAPS = 5
GRAIN_TAPS = 3
GRAIN_FAR_M = 36.0
HAZE_M = 900.0
UNKNOWN, ROAD, OBSTACLE = 0, 1, 2
ROAD_TEXEL_M = 0.025
"""Edge of one texel of the map painted along the road."""
GRAIN_TEXEL_M = 0.008
KINDS = 4
SKY, GROUND, PLAIN, FOLIAGE = range(KINDS)
_TURN = 0.5 / math.pi


@njit(**KERNEL)
def sort_kinds(count, source, flags, textures, kinds, texture_of):  # type: ignore[no-untyped-def]
    """Of each visible triangle its kind, kinds (V,) uint8, and its texture (V,) int64."""
    for k in range(count):
        flag = flags[source[k]]
        kind = PLAIN
        if flag & FLAG_GROUND:
            kind = GROUND
        elif flag & FLAG_ALPHA:
            kind = FOLIAGE
        kinds[k] = kind
        texture_of[k] = textures[source[k]]


@njit(**KERNEL)
def _surface(  # type: ignore[no-untyped-def]
    kind, planes, k, u, v, texels, starts, sizes, texture_of, drift, shadows, ground
):
    """Grey of the surfaces of eight triangles k at u, v. drift, shadows, ground: as in `shade`."""
    at = k * PLANES
    w0, w1 = gather(planes, at), gather(planes, at + 1)
    w = larger(w0 * u + w1 * v + gather(planes, at + 2), doubles(1e-7))
    z = 1.0 / w
    s0, s1, t0, t1 = (
        gather(planes, at + 3),
        gather(planes, at + 4),
        gather(planes, at + 6),
        gather(planes, at + 7),
    )
    s = (s0 * u + s1 * v + gather(planes, at + 5)) * z
    t = (t0 * u + t1 * v + gather(planes, at + 8)) * z
    light = (gather(planes, at + 9) * u + gather(planes, at + 10) * v + gather(planes, at + 11)) * z
    ux, uy = (s0 - s * w0) * z, (s1 - s * w1) * z
    vx, vy = (t0 - t * w0) * z, (t1 - t * w1) * z
    mu = drift[0] + w * (drift[1] + (u - drift[4]) * drift[2])
    mv = w * (drift[3] + (v - drift[5]) * drift[2])
    eu, ev = ux * mu + uy * mv, vx * mu + vy * mv
    # the exposure draws the footprint out along the motion
    steep = size(mv) > size(mu)
    along = choose(steep, eu * uy + ev * vy, eu * ux + ev * vx)
    eu, ev = choose(along > 0.0, eu, 0.0 - eu), choose(along > 0.0, ev, 0.0 - ev)
    ux, vx = choose(steep, ux, ux + eu), choose(steep, vx, vx + ev)
    uy, vy = choose(steep, uy + eu, uy), choose(steep, vy + ev, vy)
    if kind != GROUND:
        taps = 0 if kind == FOLIAGE else 4
        texture = gather(texture_of, k)
        value = sample_wide(texels, starts, sizes, texture, s, t, ux, vx, uy, vy, taps) * light
    else:
        value = light * _ground(texels, starts, sizes, s, t, ux, vx, uy, vy, z, shadows, ground)
    haze = z / (z + HAZE_M)
    return value + haze * (ground[4] - value)


@njit(**KERNEL)
def _ground(texels, starts, sizes, s, t, ux, vx, uy, vy, z, shadows, ground):  # type: ignore[no-untyped-def]
    """What the ground reflects at s, t [m], shadows of what moves included."""
    contrast, grain, paint = ground[0], longs(int(ground[1])), longs(int(ground[2]))
    g, e = 1.0 / ROAD_TEXEL_M, 1.0 / ground[5]
    base = sample_wide(texels, starts, sizes, paint, s * e, t * g, ux * e, vx * g, uy * e, vy * g, MAX_TAPS)
    rough = doubles(0.0)
    if some(z < GRAIN_FAR_M):
        g = 1.0 / GRAIN_TEXEL_M
        rough = sample_wide(
            texels, starts, sizes, grain, s * g, t * g, ux * g, vx * g, uy * g, vy * g, GRAIN_TAPS
        )
        near = smaller(doubles(1.0), (GRAIN_FAR_M - z) / 15.0)
        rough = choose(z < GRAIN_FAR_M, (rough - 128.0) / 128.0 * near, 0.0)
    if contrast < 1.0:
        base = ground[3] + contrast * (base - ground[3])
    # grass and gardens beyond the pavements are rougher than asphalt
    amount = choose((t > -8.0) & (t < 6.6), 1.0, doubles(2.2))
    value = base * (1.0 + amount * contrast * rough)
    for n in range(shadows.shape[0]):
        a = size(s - shadows[n, 0]) - shadows[n, 2]
        b = size(t - shadows[n, 1]) - shadows[n, 3]
        inside = (a < 0.5) & (b < 0.5)
        if some(inside):
            edge = smaller(larger(larger(a, b) / 0.5, doubles(0.0)), doubles(1.0))
            value = value * choose(inside, 0.35 + 0.65 * edge, 1.0)
    return value


@njit(**KERNEL)
def _sky(u, v, K, R, sky, texels, starts, sizes, lanes):  # type: ignore[no-untyped-def]
    """Grey of the sky at eight points u, v, which come and go in lanes (2, DOUBLES)."""
    f, cx, cy = K
    around, tall = 1 << (sizes[sky] & 255), 1 << ((sizes[sky] >> 8) & 255)
    turn = around * _TURN
    store(lanes, 0, u)
    store(lanes, DOUBLES, v)
    for i in range(DOUBLES):
        a, b = (lanes[0, i] - cx) / f, (lanes[1, i] - cy) / f
        dx = R[0, 0] * a + R[0, 1] * b + R[0, 2]
        dy = R[1, 0] * a + R[1, 1] * b + R[1, 2]
        dz = R[2, 0] * a + R[2, 1] * b + R[2, 2]
        rise = -dy / math.sqrt(dx * dx + dz * dz)
        lanes[0, i] = math.atan2(dx, dz) * turn
        lanes[1, i] = min(max((0.55 - rise) * turn, 0.5), tall - 0.5)
    pixel, none = doubles(turn / f), doubles(0.0)
    u, v = load(lanes, 0), load(lanes, DOUBLES)
    return sample_wide(texels, starts, sizes, longs(sky), u, v, pixel, none, none, pixel, 1)


@njit(**INLINED)
def _add(parts, places, used, kind, k, x, u, v, count):  # type: ignore[no-untyped-def]
    """One more part of that kind."""
    n = used[kind]
    parts[kind, 0, n], parts[kind, 1, n], parts[kind, 2, n] = u, v, count
    places[kind, 0, n], places[kind, 1, n] = k, x
    used[kind] = n + 1


@njit(**KERNEL)
def _take_apart(ids, y, width, kinds, parts, places, used):  # type: ignore[no-untyped-def]
    """The parts of the pixels of row y."""
    n = SAMPLES * SAMPLES
    for kind in range(KINDS):
        used[kind] = 0
    for x in range(width):
        first = ids[y * SAMPLES, x * SAMPLES]
        if (
            ids[y * SAMPLES, x * SAMPLES + 1] == first
            and ids[y * SAMPLES + 1, x * SAMPLES] == first
            and ids[y * SAMPLES + 1, x * SAMPLES + 1] == first
        ):
            kind = kinds[first] if first >= 0 else SKY
            _add(parts, places, used, kind, max(first, 0), x, float(x), float(y), n)
            continue
        seen = 0
        for i in range(n):
            if seen >> i & 1:
                continue
            k = ids[y * SAMPLES + i // SAMPLES, x * SAMPLES + i % SAMPLES]
            count, mx, my = 0, 0, 0
            for j in range(i, n):
                if ids[y * SAMPLES + j // SAMPLES, x * SAMPLES + j % SAMPLES] == k:
                    seen |= 1 << j
                    count += 1
                    mx += j % SAMPLES
                    my += j // SAMPLES
            u = x + (mx / count + 0.5) / SAMPLES - 0.5
            v = y + (my / count + 0.5) / SAMPLES - 0.5
            kind = kinds[k] if k >= 0 else SKY
            _add(parts, places, used, kind, max(k, 0), x, u, v, count)


@njit(**KERNEL)
def shade(  # type: ignore[no-untyped-def]
    planes, kinds, texture_of, ids, texels, starts, sizes, K, R, sky, drift, shadows, ground, image, scratch
):
    """Fill image (H, W) float32 grey.

    R (3, 3) camera -> world turns rays to the sky texture `sky` (azimuth along its width).
    drift (6,): the pixel at u, v with 1/Z = w moves by du = drift[0] + w (drift[1] + (u - drift[4]) drift[2]),
    dv = w (drift[3] + (v - drift[5]) drift[2]) during the exposure. shadows (N, 4): centre and half size in s, t [m].
    ground: contrast, grain texture, map texture, grey of a road without contrast, grey of haze, texel of the map along
    s [m]. scratch: as `shade_scratch` makes it.
    """
    parts, places, used, row, lanes = scratch
    height, width = image.shape
    pitch = parts.shape[2]
    for y in range(height):
        _take_apart(ids, y, width, kinds, parts, places, used)
        for x in range(width):
            row[x] = 0.0
        for kind in range(KINDS):
            n = used[kind]
            for _ in range(n, (n + DOUBLES - 1) & ~(DOUBLES - 1)):
                _add(parts, places, used, kind, places[kind, 0, n - 1], 0, float(0), float(y), 0)
            for i in range(0, n, DOUBLES):
                at = kind * 3 * pitch + i
                k, u, v = load(places, kind * 2 * pitch + i), load(parts, at), load(parts, at + pitch)
                if kind == SKY:
                    value = _sky(u, v, K, R, sky, texels, starts, sizes, lanes)
                else:
                    value = _surface(
                        kind, planes, k, u, v, texels, starts, sizes, texture_of, drift, shadows, ground
                    )
                store(parts, at, value * load(parts, at + 2 * pitch))
            for i in range(n):
                row[places[kind, 1, i]] += parts[kind, 0, i]
        for x in range(width):
            image[y, x] = row[x] / (SAMPLES * SAMPLES)


@njit(**KERNEL)
def measure(planes, source, labels, ids, inverse_depth, label):  # type: ignore[no-untyped-def]
    """For the triangle that covers most of a pixel, the nearest of several: its 1/Z at the pixel's centre,
    inverse_depth (H, W) float32 (0 = none), and label (H, W) uint8."""
    n = SAMPLES * SAMPLES
    height, width = label.shape
    for y in range(height):
        for x in range(width):
            best, best_count, best_w = -1, 0, 0.0
            for i in range(n):
                k = ids[y * SAMPLES + i // SAMPLES, x * SAMPLES + i % SAMPLES]
                count, mx, my = 0, 0, 0
                for j in range(n):
                    if ids[y * SAMPLES + j // SAMPLES, x * SAMPLES + j % SAMPLES] == k:
                        count += 1
                        mx += j % SAMPLES
                        my += j // SAMPLES
                u = x + (mx / count + 0.5) / SAMPLES - 0.5
                v = y + (my / count + 0.5) / SAMPLES - 0.5
                w = 0.0
                if k >= 0:
                    w = max(planes[k, 0] * u + planes[k, 1] * v + planes[k, 2], 1e-7)
                if count > best_count or (count == best_count and w > best_w):
                    best, best_count, best_w = k, count, w
            inverse_depth[y, x] = 0.0
            label[y, x] = UNKNOWN
            if best >= 0:
                inverse_depth[y, x] = max(planes[best, 0] * x + planes[best, 1] * y + planes[best, 2], 1e-6)
                label[y, x] = labels[source[best]]
