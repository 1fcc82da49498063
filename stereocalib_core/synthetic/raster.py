"""From triangles to which triangle each sample of a picture sees: transform, light, set up, fill.

A triangle in homogeneous coordinates needs no clipping: with its vertices as the columns of a matrix M, the
weights of the point seen along ray d = ((u - cx)/f, (v - cy)/f, 1) at depth Z are Z M^-1 d. So 1/Z and every
attribute over Z are linear in u, v, and exact. Pictures are sampled SAMPLES x SAMPLES times a pixel.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from stereocalib_core.synthetic.textures import bilinear

SAMPLES = 2
NEAR_M = 0.15
PLANES = 18
"""Numbers kept of each visible triangle: coefficients of u, v and 1 for 1/Z, u/Z, v/Z, light/Z, two edges."""

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
            # two edges; the third is 1/Z less both
            planes[count, 12], planes[count, 13] = a0 / (det * f), a1 / (det * f)
            planes[count, 14] = a2 / det - planes[count, 12] * cx - planes[count, 13] * cy
            planes[count, 15], planes[count, 16] = b0 / (det * f), b1 / (det * f)
            planes[count, 17] = b2 / det - planes[count, 15] * cx - planes[count, 16] * cy
            count += 1
    return count


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def fill(  # type: ignore[no-untyped-def]
    count, planes, source, boxes, flags, textures, texels, table, levels, inverse_depth, ids
):
    """The nearest of the visible triangles in every sample.

    inverse_depth (H S, W S) float32 and ids (H S, W S) int32 come in as 0 and -1 and hold 1/Z and the index of
    the visible triangle. Triangles flagged ALPHA are holes where the texture after theirs is dark.
    """
    step = 1.0 / SAMPLES
    for k in range(count):
        q = planes[k]
        w0, w1, w2 = q[0], q[1], q[2]
        a0, a1, a2 = q[12], q[13], q[14]
        b0, b1, b2 = q[15], q[16], q[17]
        c0, c1, c2 = w0 - a0 - b0, w1 - a1 - b1, w2 - a2 - b2
        # where an edge is crossed in row v: column h(v) times these
        a3 = -SAMPLES / a0 if a0 != 0.0 else 0.0
        b3 = -SAMPLES / b0 if b0 != 0.0 else 0.0
        c3 = -SAMPLES / c0 if c0 != 0.0 else 0.0
        middle = 0.5 * SAMPLES - 0.5
        low, high = float(boxes[k, 0]), float(boxes[k, 1])
        tri = source[k]
        alpha = flags[tri] & FLAG_ALPHA
        tex = textures[tri] + 1
        level, magnified = 0, True
        if alpha:
            # one level for the triangle: how many texels a pixel spans at its middle
            u = 0.5 * (low + high + 1.0) * step - 0.5
            v = 0.5 * (boxes[k, 2] + boxes[k, 3] + 1.0) * step - 0.5
            z = 1.0 / max(w0 * u + w1 * v + w2, 1e-6)
            s, t = (q[3] * u + q[4] * v + q[5]) * z, (q[6] * u + q[7] * v + q[8]) * z
            span = abs(q[3] - s * w0) + abs(q[4] - s * w1) + abs(q[6] - t * w0) + abs(q[7] - t * w1)
            level = min(int(math.log2(max(span * z * 0.35, 1.0))), levels[tex] - 4)
            # interpolate only where a texel is larger than a sample
            magnified = span * z < 1.4
        offset, lw, lh = table[tex, level, 0], table[tex, level, 1], table[tex, level, 2]
        scale = 1.0 / (1 << level)
        one = np.uint64(1)
        mask_w, mask_h = (one << np.uint64(lw)) - one, (one << np.uint64(lh)) - one
        for row in range(boxes[k, 2], boxes[k, 3] + 1):
            v = (row + 0.5) * step - 0.5
            left, right = low, high
            h = a1 * v + a2
            if a0 > 0.0:
                left = max(left, h * a3 + middle)
            elif a0 < 0.0:
                right = min(right, h * a3 + middle)
            elif h < 0.0:
                continue
            h = b1 * v + b2
            if b0 > 0.0:
                left = max(left, h * b3 + middle)
            elif b0 < 0.0:
                right = min(right, h * b3 + middle)
            elif h < 0.0:
                continue
            h = c1 * v + c2
            if c0 > 0.0:
                left = max(left, h * c3 + middle)
            elif c0 < 0.0:
                right = min(right, h * c3 + middle)
            elif h < 0.0:
                continue
            if left > right:
                continue
            first, last = int(math.ceil(left)), int(math.floor(right))
            if first > last:
                continue
            u = (first + 0.5) * step - 0.5
            w = w0 * u + w1 * v + w2
            dw = w0 * step
            if not alpha:
                for x in range(first, last + 1):
                    if w > inverse_depth[row, x]:
                        inverse_depth[row, x] = w
                        ids[row, x] = k
                    w += dw
                continue
            s, t = q[3] * u + q[4] * v + q[5], q[6] * u + q[7] * v + q[8]
            ds, dt = q[3] * step, q[6] * step
            for x in range(first, last + 1):
                if w > inverse_depth[row, x]:
                    z = scale / w
                    if magnified:
                        opaque = bilinear(texels, offset, lw, lh, s * z, t * z) > 127.0
                    else:
                        column = np.uint64(np.int64(s * z)) & mask_w
                        line = np.uint64(np.int64(t * z)) & mask_h
                        opaque = texels[np.uint64(offset) + (line << np.uint64(lw)) + column] > 127
                    if opaque:
                        inverse_depth[row, x] = w
                        ids[row, x] = k
                w += dw
                s += ds
                t += dt
