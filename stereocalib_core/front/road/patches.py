"""Small patches of the lane, aligned from right to left over the current plane: sums, offsets, and their noise."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from stereocalib_core.numeric.arrays import Array


@njit(cache=True, nogil=True)
def lay_patches(
    height: int,
    width: int,
    f: float,
    cx: float,
    cy: float,
    b: float,
    plane: Array,
    half_u: int,
    half_v: int,
    near: float,
    far: float,
    half_lane: float,
    slope: float,
    curvature: float,
    allowed: NDArray[np.bool_],
    solid_sums: NDArray[np.int32],
    step: int,
    min_solid: float,
) -> tuple[NDArray[np.int64], NDArray[np.int64], Array]:
    """Centres u, v (N,) and road distance (N,) of a tiling of the lane about the car's way (`Way`).

    `allowed` is on the disparity grid.

    A patch's centre is allowed, and so is at least `min_solid` of it once pinholes are closed (`solid_sums`:
    sums of that mask), or it would hang over a kerb.
    """
    us, vs, zs = [], [], []
    rows, columns = allowed.shape
    sides = int(width / (2 * half_u + 1)) + 1
    for v in range(height - 3 - half_v, int(half_v) + 2, -(2 * half_v + 1)):
        for k in range(-sides, sides + 1):
            u = int(cx) + k * (2 * half_u + 1)
            d = plane[0] * (v - cy) + plane[1] * (u - cx) + plane[2]
            if d <= 1.0:
                continue
            z = f * b / d
            if z < near or z > far or abs((u - cx) * b / d - slope * z - 0.5 * curvature * z * z) > half_lane:
                continue
            if u - half_u - 2 < 0 or u + half_u + 3 > width or u - d - half_u - 4 < 0:
                continue
            i, j = min(v // step, rows - 1), min(u // step, columns - 1)
            top, bottom = (v - half_v) // step, min((v + half_v) // step + 1, rows)
            first, last = (u - half_u) // step, min((u + half_u) // step + 1, columns)
            solid = (
                solid_sums[bottom, last]
                - solid_sums[top, last]
                - solid_sums[bottom, first]
                + solid_sums[top, first]
            )
            if allowed[i, j] and solid >= min_solid * (bottom - top) * (last - first):
                us.append(u)
                vs.append(v)
                zs.append(z)
    return np.array(us, np.int64), np.array(vs, np.int64), np.array(zs, np.float64)


# Sums may be reordered, so that several pixels are taken at once.
@njit(cache=True, nogil=True, fastmath={"reassoc", "contract", "arcp", "nsz"})
def align(
    left: NDArray[np.uint8],
    right: NDArray[np.uint8],
    cx: float,
    cy: float,
    shift: float,
    plane: Array,
    above: Array,
    us: NDArray[np.int64],
    vs: NDArray[np.int64],
    half_u: int,
    half_v: int,
    sums: Array,
) -> None:
    """Right against left over the plane, patch p at `above[p]` [px] over it.

    Gives per patch the sums of products of gradients and difference, (N, 6): uu, uv, vv, ur, vr, rr; all 0:
    nothing seen.

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
            base = plane[0] * (v - cy) + plane[2] + above[p] + shift
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


@njit(cache=True, nogil=True)
def offsets_of(sums: Array, u: Array, trust: Array, pixels: int) -> tuple[Array, Array]:
    """Each patch's disparity offset [px] from the plane and its sigma (inf = nothing to see).

    The right image's rows may lie a little off: left - right = -offset g_u + dv g_v with one
    dv = dv_0 + dv_1 u for the lane, found from all patches with their own offsets eliminated. Without it an
    edge that runs nearly along the rows would turn dv into disparity.
    """
    uu, uv, vv, ur, vr, rr = sums[:, 0], sums[:, 1], sums[:, 2], sums[:, 3], sums[:, 4], sums[:, 5]
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
