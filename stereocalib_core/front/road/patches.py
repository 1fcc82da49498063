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
    across: Array,
    slope: float,
    curvature: float,
    allowed: NDArray[np.bool_],
    solid_sums: NDArray[np.int32],
    step: int,
    min_solid: float,
) -> tuple[NDArray[np.int64], NDArray[np.int64], Array]:
    """Centres u, v (N,) and road distance (N,) of a tiling of the lane about the car's way (`Way`).

    `allowed` is on the disparity grid. across: (3,), as `plane.across_of` gives it.

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
            x = z * (across[0] * (u - cx) + across[1] * (v - cy) + across[2])
            if z < near or z > far or abs(x - slope * z - 0.5 * curvature * z * z) > half_lane:
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
    n = len(u)
    offset, sigma = np.zeros(n), np.full(n, np.inf)
    # element by element: whole arrays would take as long to compile as all the rest
    h_00 = h_01 = h_11 = t_0 = t_1 = 0.0
    for p in range(n):
        uu, uv, vv, ur, vr = sums[p, 0], sums[p, 1], sums[p, 2], sums[p, 3], sums[p, 4]
        if not uu > 1e-6:
            continue
        x = u[p] / 100.0
        w = trust[p] * max(vv - uv * uv / uu, 0.0)
        pull = trust[p] * (vr - uv * ur / uu)
        h_00 += w
        h_01 += w * x
        h_11 += w * x * x
        t_0 += pull
        t_1 += pull * x
    middle, half = 0.5 * (h_00 + h_11), np.sqrt((0.5 * (h_00 - h_11)) ** 2 + h_01 * h_01)
    a = b = 0.0
    if middle + half < 1e8 * (middle - half):
        determinant = h_00 * h_11 - h_01 * h_01
        a, b = (h_11 * t_0 - h_01 * t_1) / determinant, (h_00 * t_1 - h_01 * t_0) / determinant
    for p in range(n):
        uu, uv, vv, ur, vr, rr = sums[p, 0], sums[p, 1], sums[p, 2], sums[p, 3], sums[p, 4], sums[p, 5]
        if not uu > 1e-6:
            continue
        row = min(max(a + b * (u[p] / 100.0), -1.5), 1.5)
        own = -(ur - row * uv) / uu
        if not abs(own) <= 2.0:
            continue
        left_over = rr + own**2 * uu + row**2 * vv + 2 * own * ur - 2 * row * vr - 2 * own * row * uv
        offset[p], sigma[p] = own, np.sqrt((max(left_over, 0.0) / (pixels - 3) + 0.1) / uu)
    return offset, sigma
