"""From triangles to which triangle each sample of a picture sees: transform, light, set up, fill.

A triangle in homogeneous coordinates needs no clipping: with its vertices as the columns of a matrix M, the
weights of the point seen along ray d = ((u - cx)/f, (v - cy)/f, 1) at depth Z are Z M^-1 d. So 1/Z and every
attribute over Z are linear in u, v, and exact. Pictures are sampled SAMPLES x SAMPLES times a pixel.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from stereocalib_core.numeric.wide import (
    FLOATS,
    as_floats,
    as_ints,
    as_longs,
    choose,
    counted,
    floats,
    gather,
    load,
    smallest,
    some,
    store,
)
from stereocalib_core.simulator.textures import INLINED, KERNEL

SAMPLES = 2
TILE = 32
"""Edge of the squares of samples of which is kept how far away the farthest is."""
NEAR_M = 0.15
PLANES = 24
"""Numbers kept of each visible triangle: coefficients of u, v and 1 for 1/Z, u/Z, v/Z, light/Z and three edges;
then, for each edge, minus the samples in a pixel over the first of its coefficients (0 where that is 0)."""

FLAG_TWO_SIDED, FLAG_ALPHA, FLAG_GROUND, FLAG_UNLIT = 1, 2, 4, 8


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def set_up(  # type: ignore[no-untyped-def]
    vertices, normals, coordinates, tones, flags, draws, poses, suns, gains, K, size, planes, source, boxes
):
    """Visible triangles of all draws.

    vertices, normals (T, 3, 3), coordinates (T, 3, 2) texture u, v, tones (T,), flags (T,); draws (D, 2) first
    and past-the-end triangle, poses (D, 3, 4) draw -> camera, suns (D, 3) the direction to the sun in the
    draw's own axes, gains (D, 2) ambient and sunlight; K (f, cx, cy), size (W, H).
    Fills planes (V, PLANES), source (V,) triangle, boxes (V, 4) in samples; returns V.
    """
    f, cx, cy = K
    width, height = size
    count = 0
    p = np.empty((3, 3))
    light = np.empty(3)
    for d in range(draws.shape[0]):
        T = poses[d]
        for k in range(draws[d, 0], draws[d, 1]):
            front = False
            for i in range(3):
                x, y, z = vertices[k, i, 0], vertices[k, i, 1], vertices[k, i, 2]
                for j in range(3):
                    p[j, i] = T[j, 0] * x + T[j, 1] * y + T[j, 2] * z + T[j, 3]
                if p[2, i] > NEAR_M:
                    front = True
            if not front:
                continue
            # rows of M^-1 times the determinant: cross products of the vertices
            a0 = p[1, 1] * p[2, 2] - p[2, 1] * p[1, 2]
            a1 = p[2, 1] * p[0, 2] - p[0, 1] * p[2, 2]
            a2 = p[0, 1] * p[1, 2] - p[1, 1] * p[0, 2]
            det = p[0, 0] * a0 + p[1, 0] * a1 + p[2, 0] * a2
            if abs(det) < 1e-12 or (det > 0.0 and not flags[k] & FLAG_TWO_SIDED):
                continue
            if count >= planes.shape[0]:
                return count
            # the box in the picture, by clipping the edges at the near plane
            u0, u1, v0, v1 = 1e9, -1e9, 1e9, -1e9
            for i in range(3):
                j = (i + 1) % 3
                zi, zj = p[2, i], p[2, j]
                if zi > NEAR_M:
                    u, v = p[0, i] / zi, p[1, i] / zi
                    u0, u1, v0, v1 = min(u0, u), max(u1, u), min(v0, v), max(v1, v)
                if (zi > NEAR_M) != (zj > NEAR_M):
                    t = (NEAR_M - zi) / (zj - zi)
                    u = (p[0, i] + t * (p[0, j] - p[0, i])) / NEAR_M
                    v = (p[1, i] + t * (p[1, j] - p[1, i])) / NEAR_M
                    u0, u1, v0, v1 = min(u0, u), max(u1, u), min(v0, v), max(v1, v)
            left = max(math.ceil((f * u0 + cx + 0.5) * SAMPLES - 0.5), 0)
            right = min(math.floor((f * u1 + cx + 0.5) * SAMPLES - 0.5), width * SAMPLES - 1)
            top = max(math.ceil((f * v0 + cy + 0.5) * SAMPLES - 0.5), 0)
            bottom = min(math.floor((f * v1 + cy + 0.5) * SAMPLES - 0.5), height * SAMPLES - 1)
            if left > right or top > bottom:
                continue
            b0 = p[1, 2] * p[2, 0] - p[2, 2] * p[1, 0]
            b1 = p[2, 2] * p[0, 0] - p[0, 2] * p[2, 0]
            b2 = p[0, 2] * p[1, 0] - p[1, 2] * p[0, 0]
            c0 = p[1, 0] * p[2, 1] - p[2, 0] * p[1, 1]
            c1 = p[2, 0] * p[0, 1] - p[0, 0] * p[2, 1]
            c2 = p[0, 0] * p[1, 1] - p[1, 0] * p[0, 1]
            for i in range(3):
                n = normals[k, i]
                glow = 1.0
                if not flags[k] & FLAG_UNLIT:
                    facing = n[0] * suns[d, 0] + n[1] * suns[d, 1] + n[2] * suns[d, 2]
                    if flags[k] & FLAG_ALPHA:
                        facing = 0.45 + 0.55 * facing
                    glow = gains[d, 0] * (0.75 - 0.25 * n[1]) + gains[d, 1] * max(facing, 0.0)
                light[i] = glow * tones[k]
            for row in range(4):
                if row == 0:
                    q0, q1, q2 = 1.0, 1.0, 1.0
                elif row == 3:
                    q0, q1, q2 = light[0], light[1], light[2]
                else:
                    q0, q1, q2 = (
                        coordinates[k, 0, row - 1],
                        coordinates[k, 1, row - 1],
                        coordinates[k, 2, row - 1],
                    )
                du = (q0 * a0 + q1 * b0 + q2 * c0) / (det * f)
                dv = (q0 * a1 + q1 * b1 + q2 * c1) / (det * f)
                planes[count, 3 * row] = du
                planes[count, 3 * row + 1] = dv
                planes[count, 3 * row + 2] = (q0 * a2 + q1 * b2 + q2 * c2) / det - du * cx - dv * cy
            source[count] = k
            boxes[count, 0], boxes[count, 1], boxes[count, 2], boxes[count, 3] = left, right, top, bottom
            for edge in range(3):
                if edge == 0:
                    e0, e1, e2 = a0, a1, a2
                elif edge == 1:
                    e0, e1, e2 = b0, b1, b2
                else:
                    e0, e1, e2 = c0, c1, c2
                row = 12 + 3 * edge
                du, dv = e0 / (det * f), e1 / (det * f)
                planes[count, row], planes[count, row + 1] = du, dv
                planes[count, row + 2] = e2 / det - du * cx - dv * cy
                planes[count, 21 + edge] = -SAMPLES / du if du != 0.0 else 0.0
            count += 1
    return count


@njit(**INLINED)
def _span(q, u_shift, v, low, high):  # type: ignore[no-untyped-def]
    """First and last column of the samples that a triangle covers in row v of the picture, within low...high."""
    left, right = low, high
    for edge in range(3):
        # the edge is crossed where slope u + h = 0
        slope, h = q[12 + 3 * edge], q[13 + 3 * edge] * v + q[14 + 3 * edge]
        if slope > 0.0:
            left = max(left, h * q[21 + edge] + u_shift)
        elif slope < 0.0:
            right = min(right, h * q[21 + edge] + u_shift)
        elif h < 0.0:
            return 1, 0
    if left > right:
        return 1, 0
    return int(math.ceil(left)), int(math.floor(right))


@njit(**KERNEL)
def _hidden(box, q, inverse_depth, farthest):  # type: ignore[no-untyped-def]
    """Whether everything in a triangle's box is nearer than the triangle: then nobody sees it.

    farthest: as in `fill`; what is not known of a tile is looked up.
    """
    step = 1.0 / SAMPLES
    u0, u1 = (box[0] + 0.5) * step - 0.5, (box[1] + 0.5) * step - 0.5
    v0, v1 = (box[2] + 0.5) * step - 0.5, (box[3] + 0.5) * step - 0.5
    # a little more than what is computed sample by sample, with fewer digits
    nearest = np.float32(1.0001 * (max(q[0] * u0, q[0] * u1) + max(q[1] * v0, q[1] * v1) + q[2]))
    rows, columns = inverse_depth.shape
    for j in range(box[2] // TILE, box[3] // TILE + 1):
        for i in range(box[0] // TILE, box[1] // TILE + 1):
            if farthest[j, i] < 0:
                # what a row has too much at its end belongs to the next one: no harm
                least = floats(1e30)
                for y in range(j * TILE, min(j * TILE + TILE, rows)):
                    place = y * columns + i * TILE
                    for part in range(0, TILE, FLOATS):
                        here = load(inverse_depth, place + part)
                        least = choose(here < least, here, least)
                farthest[j, i] = smallest(least)
            if farthest[j, i] < nearest:
                return False
    return True


@njit(**KERNEL)
def fill(  # type: ignore[no-untyped-def]
    count, planes, source, boxes, flags, textures, texels, table, levels, inverse_depth, ids, farthest
):
    """The nearest of the visible triangles in every sample.

    inverse_depth (H S, W S) float32 and ids (H S, W S) int32 come in as 0 and -1 and hold 1/Z and the index of
    the visible triangle; a register may be read and written beyond their ends. Triangles flagged ALPHA are holes
    where the texture after theirs is dark. farthest (tiles down, tiles across) float32 comes in as 0: the smallest
    1/Z of each tile, negative where somebody has drawn since.

    The loops over a row have no branch, so that they run on many samples at once; indices are unsigned, which
    spares numba's wrap-around of negative ones.
    """
    step = 1.0 / SAMPLES
    u_shift = 0.5 * SAMPLES - 0.5
    for k in range(count):
        q = planes[k]
        name = np.int32(k)
        low, high = float(boxes[k, 0]), float(boxes[k, 1])
        tri = source[k]
        alpha = flags[tri] & FLAG_ALPHA
        # a crown costs most, with its holes: those that are hidden are told in advance
        if alpha and _hidden(boxes[k], q, inverse_depth, farthest):
            continue
        for j in range(boxes[k, 2] // TILE, boxes[k, 3] // TILE + 1):
            for i in range(boxes[k, 0] // TILE, boxes[k, 1] // TILE + 1):
                farthest[j, i] = np.float32(-1.0)
        tex = textures[tri] + (1 if alpha else 0)
        level = 0
        if alpha:
            # one level for the triangle: how many texels a pixel spans at its middle
            u = 0.5 * (low + high + 1.0) * step - 0.5
            v = 0.5 * (boxes[k, 2] + boxes[k, 3] + 1.0) * step - 0.5
            z = 1.0 / max(q[0] * u + q[1] * v + q[2], 1e-6)
            s, t = (q[3] * u + q[4] * v + q[5]) * z, (q[6] * u + q[7] * v + q[8]) * z
            span = abs(q[3] - s * q[0]) + abs(q[4] - s * q[1]) + abs(q[6] - t * q[0]) + abs(q[7] - t * q[1])
            level = min(int(math.log2(max(span * z * 0.35, 1.0))), levels[tex] - 4)
        start, shift = np.uint64(table[tex, level, 0]), np.int32(table[tex, level, 1])
        scale = 1.0 / (1 << level)
        mask_w = np.int32((1 << table[tex, level, 1]) - 1)
        mask_h = np.int32((1 << table[tex, level, 2]) - 1)
        for row in range(boxes[k, 2], boxes[k, 3] + 1):
            v = (row + 0.5) * step - 0.5
            first, last = _span(q, u_shift, v, low, high)
            n = last - first + 1
            if n <= 0:
                continue
            u = (first + 0.5) * step - 0.5
            w, dw = np.float32(q[0] * u + q[1] * v + q[2]), np.float32(q[0] * step)
            x, y = np.uint64(first), np.uint64(row)
            if not alpha:
                for i in range(n):
                    far = inverse_depth[y, x + np.uint64(i)]
                    near = w + np.float32(i) * dw
                    hit = near > far
                    inverse_depth[y, x + np.uint64(i)] = near if hit else far
                    ids[y, x + np.uint64(i)] = name if hit else ids[y, x + np.uint64(i)]
                continue
            s = np.float32((q[3] * u + q[4] * v + q[5]) * scale)
            t = np.float32((q[6] * u + q[7] * v + q[8]) * scale)
            ds, dt = np.float32(q[3] * step * scale), np.float32(q[6] * step * scale)
            place = row * ids.shape[1] + first
            for i in range(0, n, FLOATS):
                lanes = counted() + i
                f = as_floats(lanes)
                near = w + f * dw
                far = load(inverse_depth, place + i)
                hit = (near > far) & (lanes < np.int32(n))
                if not some(hit):
                    continue
                z = np.float32(1.0) / near
                column = as_ints((s + f * ds) * z) & mask_w
                line = as_ints((t + f * dt) * z) & mask_h
                texel = gather(texels, as_longs((line << shift) + column) + start)
                hit = hit & ((texel & 255) > 127)
                store(inverse_depth, place + i, choose(hit, near, far))
                store(ids, place + i, choose(hit, name, load(ids, place + i)))
