"""The planar motion of the paper: road points made metric by the extrinsics, moved in the plane of the road.

Points of the previous frame are placed on the road by eq. 13, 14 and 16 with the extrinsics as given, moved by
(x, z, heading), and projected into the current frame by eq. 3 with its own extrinsics; Gauss-Newton with Cauchy
weights on the reprojection error, because errors of the extrinsics grow with Z^2 in metres but not in pixels.

With a lever arm the motion is held to a vehicle whose rear axle does not slip sideways: the axle moves along an
arc and the camera sits the lever arm L ahead of it, to first order x = yaw z + z heading / 2 + L heading.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.small_algebra import FAST, solve_symmetric


@njit(cache=True, nogil=True, fastmath=FAST)
def _accumulate(
    rays: Array, first: int, last: int, e0: Array, e1: Array, motion: Array, scale: float, H: Array, g: Array
) -> tuple[float, float]:
    """Normal equations (H lower, overwritten) of the planar motion; e0, e1 (3,) height, pitch, roll."""
    cp0, sp0, cr0, sr0 = np.cos(e0[1]), np.sin(e0[1]), np.cos(e0[2]), np.sin(e0[2])
    cp1, sp1, cr1, sr1 = np.cos(e1[1]), np.sin(e1[1]), np.cos(e1[2]), np.sin(e1[2])
    h0, h1 = e0[0], e1[0]
    c, s, tx, tz = np.cos(motion[2]), np.sin(motion[2]), motion[0], motion[1]
    a = np.zeros(6)
    b = np.zeros(3)
    cost = 0.0
    total = 0.0
    for k in range(first, last):
        x, y = rays[0, k], rays[1, k]
        # eq. 16 divided by b / h: depth = h / drop
        drop = cr0 * cp0 * y - sr0 * x + cr0 * sp0
        if not drop > 1e-3:
            continue
        depth = h0 / drop
        X0 = depth * (cr0 * x + cp0 * sr0 * y + sp0 * sr0)
        Z0 = depth * (cp0 - sp0 * y)
        dx, dz = X0 - tx, Z0 - tz
        X1, Z1 = c * dx - s * dz, s * dx + c * dz
        qx = cr1 * X1 - sr1 * h1
        side = sr1 * X1 + cr1 * h1
        qy = cp1 * side - sp1 * Z1
        qz = sp1 * side + cp1 * Z1
        if not qz > 0.5:
            continue
        iz = 1.0 / qz
        px, py = qx * iz, qy * iz
        ru, rv = rays[3, k] - px, rays[4, k] - py
        e2 = ru * ru + rv * rv
        w = 1.0 / (1.0 + e2 * scale)
        cost += w * e2
        total += w
        # image motion per metre along X1 and Z1
        uX, uZ = iz * (cr1 - px * sp1 * sr1), -iz * px * cp1
        vX, vZ = iz * (cp1 * sr1 - py * sp1 * sr1), iz * (-sp1 - py * cp1)
        u0, u1, u2 = -c * uX - s * uZ, s * uX - c * uZ, -Z1 * uX + X1 * uZ
        v0, v1, v2 = -c * vX - s * vZ, s * vX - c * vZ, -Z1 * vX + X1 * vZ
        a[0] += w * (u0 * u0 + v0 * v0)
        a[1] += w * (u1 * u0 + v1 * v0)
        a[2] += w * (u1 * u1 + v1 * v1)
        a[3] += w * (u2 * u0 + v2 * v0)
        a[4] += w * (u2 * u1 + v2 * v1)
        a[5] += w * (u2 * u2 + v2 * v2)
        b[0] += w * (u0 * ru + v0 * rv)
        b[1] += w * (u1 * ru + v1 * rv)
        b[2] += w * (u2 * ru + v2 * rv)
    n = 0
    for i in range(3):
        g[i] = b[i]
        for j in range(i + 1):
            H[i, j] = a[n]
            n += 1
    return cost, total


@njit(cache=True, nogil=True)
def arc(distance: float, heading: float, yaw: float, lever: float, motion: Array, D: Array) -> None:
    """Motion (x, z, heading) of the camera when its rear axle moves `distance` along an arc, and D (3, 2) its
    derivative by distance and heading."""
    sh, ch = np.sin(heading), np.cos(heading)
    s2, c2 = np.sin(0.5 * heading), np.cos(0.5 * heading)
    x, z = distance * s2 + lever * sh, distance * c2 + lever * (ch - 1.0)
    xh, zh = 0.5 * distance * c2 + lever * ch, -0.5 * distance * s2 - lever * sh
    cy, sy = np.cos(yaw), np.sin(yaw)
    motion[0], motion[1], motion[2] = cy * x + sy * z, -sy * x + cy * z, heading
    D[0, 0], D[1, 0], D[2, 0] = cy * s2 + sy * c2, -sy * s2 + cy * c2, 0.0
    D[0, 1], D[1, 1], D[2, 1] = cy * xh + sy * zh, -sy * xh + cy * zh, 1.0


@njit(cache=True, nogil=True)
def planar_pair(
    rays: Array,
    first: int,
    last: int,
    e0: Array,
    e1: Array,
    lever: float,
    focal_px: float,
    cauchy_px: float,
    iterations: int,
    motion: Array,
    cov: Array,
) -> bool:
    """Planar motion (x [m], z [m], heading [rad]) of one pair; `motion` is start and result, `cov` (3, 3).

    e0, e1: (4,) height, pitch, roll, yaw of the two frames. `lever` NaN = free, else non-holonomic.
    """
    held = not np.isnan(lever)
    scale = (focal_px / cauchy_px) ** 2
    H = np.zeros((3, 3))
    g = np.zeros(3)
    D = np.zeros((3, 2))
    G = np.zeros((2, 2))
    d = np.zeros(2)
    step = np.zeros(3)
    yaw = e0[3]
    distance = motion[1] * np.cos(yaw) + motion[0] * np.sin(yaw)
    for _ in range(iterations):
        if held:
            arc(distance, motion[2], yaw, lever, motion, D)
        cost, total = _accumulate(rays, first, last, e0, e1, motion, scale, H, g)
        if total <= 0.0:
            return False
        for i in range(3):
            H[i, i] += 1e-9
            for j in range(i):
                H[j, i] = H[i, j]
        if held:
            G[:] = D.T @ H @ D
            d[:] = D.T @ g
            cov[:] = D @ np.linalg.inv(G) @ D.T * (0.5 * cost / total)
            if not solve_symmetric(G, d, 2, step):
                return False
            distance += step[0]
            motion[2] += step[1]
            largest = max(abs(step[0]), abs(step[1]))
        else:
            cov[:] = np.linalg.inv(H) * (0.5 * cost / total)
            if not solve_symmetric(H, g, 3, step):
                return False
            motion += step
            largest = max(abs(step[0]), abs(step[1]), abs(step[2]))
        if largest < 2e-6:
            break
    if held:
        arc(distance, motion[2], yaw, lever, motion, D)
    return True


@njit(cache=True, nogil=True)
def solve_planar(
    first: int,
    last: int,
    rays: Array,
    start: NDArray[np.int64],
    road_end: NDArray[np.int64],
    previous: NDArray[np.int64],
    active: NDArray[np.bool_],
    extrinsics: Array,
    initial: Array,
    lever: float,
    focal_px: float,
    cauchy_px: float,
    iterations: int,
    motions: Array,
    covariances: Array,
) -> None:
    """Every active pair of first ... last by `planar_pair`, in place.

    extrinsics: (N, 4) of every frame. initial: (N, 3). motions: (N, 4) x, z [m], heading [rad] of T_road0_road1,
    and 1 where it was solved. covariances: (N, 3, 3).
    """
    for i in range(first, last):
        if not active[i]:
            continue
        motion = initial[i].copy()
        e0, e1 = extrinsics[previous[i]], extrinsics[i]
        solved = planar_pair(
            rays,
            start[i],
            road_end[i],
            e0,
            e1,
            lever,
            focal_px,
            cauchy_px,
            iterations,
            motion,
            covariances[i],
        )
        if solved:
            motions[i, :3] = motion
            motions[i, 3] = 1.0
