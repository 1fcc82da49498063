"""From visible triangles to grey: textures, light, haze and sky, once per pixel and triangle."""

from __future__ import annotations

import math

from numba import njit

from stereocalib_core.simulator.raster import FLAG_ALPHA, FLAG_GROUND, SAMPLES
from stereocalib_core.simulator.textures import INLINED, KERNEL, sample

MAX_TAPS = 5
GRAIN_TAPS = 3
GRAIN_FAR_M = 36.0
HAZE_M = 900.0
UNKNOWN, ROAD, OBSTACLE = 0, 1, 2
ROAD_TEXEL_M = 0.025
"""Edge of one texel of the map painted along the road."""
GRAIN_TEXEL_M = 0.008


@njit(**INLINED)
def _surface(  # type: ignore[no-untyped-def]
    planes, k, flag, tex, u, v, texels, table, levels, drift, shadows, ground
):
    """Grey of one triangle's surface at u, v.

    drift (6,): image motion during the exposure, du = drift[0] + w (drift[1] + (u - cx) drift[2]) ... as in
    `shade`; shadows (N, 4) centre and half size in s, t [m]; ground: contrast, grain texture, map texture, grey
    of a road without contrast, grey of haze, texel of the map along s [m].
    """
    w = planes[k, 0] * u + planes[k, 1] * v + planes[k, 2]
    if w < 1e-7:
        w = 1e-7
    z = 1.0 / w
    s = (planes[k, 3] * u + planes[k, 4] * v + planes[k, 5]) * z
    t = (planes[k, 6] * u + planes[k, 7] * v + planes[k, 8]) * z
    light = (planes[k, 9] * u + planes[k, 10] * v + planes[k, 11]) * z
    ux, uy = (planes[k, 3] - s * planes[k, 0]) * z, (planes[k, 4] - s * planes[k, 1]) * z
    vx, vy = (planes[k, 6] - t * planes[k, 0]) * z, (planes[k, 7] - t * planes[k, 1]) * z
    mu = drift[0] + w * (drift[1] + (u - drift[4]) * drift[2])
    mv = w * (drift[3] + (v - drift[5]) * drift[2])
    eu, ev = ux * mu + uy * mv, vx * mu + vy * mv
    # the exposure draws the footprint out along the motion
    if abs(mv) > abs(mu):
        side = 1.0 if eu * uy + ev * vy > 0 else -1.0
        uy, vy = uy + side * eu, vy + side * ev
    else:
        side = 1.0 if eu * ux + ev * vx > 0 else -1.0
        ux, vx = ux + side * eu, vx + side * ev
    if not flag & FLAG_GROUND:
        taps = 0 if flag & FLAG_ALPHA else 4
        value = sample(texels, table, levels, tex, s, t, ux, vx, uy, vy, taps) * light
    else:
        contrast, grain, paint = ground[0], int(ground[1]), int(ground[2])
        g, e = 1.0 / ROAD_TEXEL_M, 1.0 / ground[5]
        base = sample(texels, table, levels, paint, s * e, t * g, ux * e, vx * g, uy * e, vy * g, MAX_TAPS)
        rough = 0.0
        if z < GRAIN_FAR_M:
            g = 1.0 / GRAIN_TEXEL_M
            rough = sample(
                texels, table, levels, grain, s * g, t * g, ux * g, vx * g, uy * g, vy * g, GRAIN_TAPS
            )
            rough = (rough - 128.0) / 128.0 * min(1.0, (GRAIN_FAR_M - z) / 15.0)
        if contrast < 1.0:
            base = ground[3] + contrast * (base - ground[3])
        # grass and gardens beyond the pavements are rougher than asphalt
        amount = 1.0 if -8.0 < t < 6.6 else 2.2
        value = base * (1.0 + amount * contrast * rough) * light
        for n in range(shadows.shape[0]):
            a = abs(s - shadows[n, 0]) - shadows[n, 2]
            b = abs(t - shadows[n, 1]) - shadows[n, 3]
            if a < 0.5 and b < 0.5:
                edge = min(max(max(a, b) / 0.5, 0.0), 1.0)
                value *= 0.35 + 0.65 * edge
    haze = z / (z + HAZE_M)
    return value + haze * (ground[4] - value), w


@njit(**KERNEL)
def shade(  # type: ignore[no-untyped-def]
    planes,
    source,
    flags,
    textures,
    labels,
    ids,
    texels,
    table,
    levels,
    K,
    R,
    sky,
    drift,
    shadows,
    ground,
    image,
    inverse_depth,
    label,
):
    """Fill image (H, W) float32 grey, and for the triangle that covers most of a pixel its 1/Z at the pixel's
    centre, inverse_depth (H, W) float32 (0 = none), and label (H, W) uint8.

    R (3, 3) camera -> world turns rays to the sky texture `sky` (azimuth along its width).
    drift (6,): the pixel at u, v with 1/Z = w moves by du = drift[0] + w (drift[1] + (u - drift[4]) drift[2]),
    dv = w (drift[3] + (v - drift[5]) drift[2]) during the exposure.
    """
    f, cx, cy = K
    height, width = image.shape
    n = SAMPLES * SAMPLES
    around = 1 << table[sky, 0, 1]
    tall = 1 << table[sky, 0, 2]
    turn = around / (2 * math.pi)
    for y in range(height):
        for x in range(width):
            grey = 0.0
            best, best_count, best_w = -1, 0, 0.0
            i = 0
            seen0, seen1, seen2 = -2, -2, -2
            first = ids[y * SAMPLES, x * SAMPLES]
            if (
                ids[y * SAMPLES, x * SAMPLES + 1] == first
                and ids[y * SAMPLES + 1, x * SAMPLES] == first
                and ids[y * SAMPLES + 1, x * SAMPLES + 1] == first
            ):
                whole = True
            else:
                whole = False
            while i < n:
                k = ids[y * SAMPLES + i // SAMPLES, x * SAMPLES + i % SAMPLES]
                if k in (seen0, seen1, seen2):
                    i += 1
                    continue
                seen2 = seen1
                seen1 = seen0
                seen0 = k
                count, mx, my = 0, 0, 0
                if whole:
                    count, mx, my = n, n // 2, n // 2
                    i = n
                for j in range(i, n):
                    if ids[y * SAMPLES + j // SAMPLES, x * SAMPLES + j % SAMPLES] == k:
                        count += 1
                        mx += j % SAMPLES
                        my += j // SAMPLES
                u = x + (mx / count + 0.5) / SAMPLES - 0.5
                v = y + (my / count + 0.5) / SAMPLES - 0.5
                if k < 0:
                    a, b = (u - cx) / f, (v - cy) / f
                    dx = R[0, 0] * a + R[0, 1] * b + R[0, 2]
                    dy = R[1, 0] * a + R[1, 1] * b + R[1, 2]
                    dz = R[2, 0] * a + R[2, 1] * b + R[2, 2]
                    azimuth = math.atan2(dx, dz)
                    rise = -dy / math.sqrt(dx * dx + dz * dz)
                    su = azimuth * turn
                    sv = min(max((0.55 - rise) * turn, 0.5), tall - 0.5)
                    grey += count * sample(
                        texels, table, levels, sky, su, sv, turn / f, 0.0, 0.0, turn / f, 1
                    )
                    w = 0.0
                else:
                    tri = source[k]
                    value, w = _surface(
                        planes,
                        k,
                        flags[tri],
                        textures[tri],
                        u,
                        v,
                        texels,
                        table,
                        levels,
                        drift,
                        shadows,
                        ground,
                    )
                    grey += count * value
                if count > best_count or (count == best_count and w > best_w):
                    best, best_count, best_w = k, count, w
                i += 1
            image[y, x] = grey / n
            if best >= 0:
                inverse_depth[y, x] = max(planes[best, 0] * x + planes[best, 1] * y + planes[best, 2], 1e-6)
                label[y, x] = labels[source[best]]
            else:
                inverse_depth[y, x] = 0.0
                label[y, x] = UNKNOWN
