"""The loops of `lidar_road`, compiled: one pass over a scan, one over its lane points per round."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.robust import SIGMA_PER_MAD


@njit(cache=True, nogil=True)
def gather(
    scan: NDArray[np.float32],
    T: Array,
    near: float,
    far: float,
    half_lane: float,
    offset: float,
    slope: float,
) -> Array:
    """(N, 4) points through (4, 4) T; those over the lane and within offset + slope Z of Y = 0, as (M, 3)."""
    found = np.empty((len(scan), 3))
    count = 0
    for i in range(len(scan)):
        x, y, z = float(scan[i, 0]), float(scan[i, 1]), float(scan[i, 2])
        ahead = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
        if not near < ahead < far:
            continue
        side = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]
        down = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]
        if abs(side) < half_lane and abs(down) < offset + slope * ahead:
            found[count, 0], found[count, 1], found[count, 2] = side, down, ahead
            count += 1
    return found[:count].copy()


@njit(cache=True, nogil=True)
def gather_on_tiles(
    scan: NDArray[np.float32],
    T: Array,
    T_camera_road: Array,
    lens: tuple[float, float, float],
    tiles: NDArray[np.int32],
    corner: Array,
    tile: Array,
    over: Array,
    offset: float,
    slope: float,
) -> Array:
    """(M, 3) X, Y, Z of the points (N, 4) of a scan over the tiles of the road, Y from the surface that the tiles show.

    T: (4, 4) to the road's frame. lens: focal length, cx, cy [px]. tiles: (h, w) index into `over` (K,) [m], negative =
    none; corner, tile: (2,) middle of the first tile and size [px]. A point belongs to the tile under its foot on the
    road's plane, so that a LiDAR that is tilted keeps its points; those farther than offset + slope Z from Y = 0 go.
    """
    found = np.empty((len(scan), 3))
    count = 0
    f, cx, cy = lens
    R = T_camera_road
    for i in range(len(scan)):
        x, y, z = float(scan[i, 0]), float(scan[i, 1]), float(scan[i, 2])
        ahead = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
        if ahead <= 0.0:
            continue
        down = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]
        if abs(down) > offset + slope * ahead:
            continue
        side = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]
        depth = R[2, 0] * side + R[2, 2] * ahead + R[2, 3]
        if depth <= 0.0:
            continue
        u = f * (R[0, 0] * side + R[0, 2] * ahead + R[0, 3]) / depth + cx
        v = f * (R[1, 0] * side + R[1, 2] * ahead + R[1, 3]) / depth + cy
        column = int(np.floor((u - corner[0]) / tile[0] + 0.5))
        row = int(np.floor((v - corner[1]) / tile[1] + 0.5))
        if not (0 <= row < tiles.shape[0] and 0 <= column < tiles.shape[1]) or tiles[row, column] < 0:
            continue
        found[count, 0], found[count, 2] = side, ahead
        found[count, 1] = down + over[tiles[row, column]]
        count += 1
    return found[:count].copy()


@njit(cache=True, nogil=True)
def without_obstacles(points: Array, cell: float, height: float) -> Array:
    """(M, 3) lane points without those of square cells in which they reach over more than `height`."""
    x_low, z_low = points[:, 0].min(), points[:, 2].min()
    columns = int((points[:, 0].max() - x_low) / cell) + 1
    rows = int((points[:, 2].max() - z_low) / cell) + 1
    low, high = np.full(rows * columns, np.inf), np.full(rows * columns, -np.inf)
    cells = np.empty(len(points), np.int64)
    for i in range(len(points)):
        k = int((points[i, 2] - z_low) / cell) * columns + int((points[i, 0] - x_low) / cell)
        cells[i] = k
        low[k], high[k] = min(low[k], points[i, 1]), max(high[k], points[i, 1])
    return points[(high - low)[cells] <= height]


@njit(cache=True, nogil=True)
def votes(points: Array, planes: Array, tolerance: float) -> Array:
    """(P,) how well (M, 3) points lie on each of (P, 3) planes Y = a + b Z + c X: 1 for a point on it, 0 from
    `tolerance` on. Points near a plane count more, so that no tilted plane wins by touching road and kerb."""
    counts = np.zeros(len(planes))
    for p in range(len(planes)):
        a, b, c = planes[p]
        for i in range(len(points)):
            off = (points[i, 1] - a - b * points[i, 2] - c * points[i, 0]) / tolerance
            counts[p] += max(1.0 - off * off, 0.0)
    return counts


@njit(cache=True, nogil=True)
def reweigh(residual: Array, limit: float) -> Array:
    """(M,) Tukey weights 0...1."""
    result = np.empty(len(residual))
    for i in range(len(residual)):
        result[i] = max(1.0 - (residual[i] / limit) ** 2, 0.0) ** 2
    return result


@njit(cache=True, nogil=True)
def residuals(points: Array, plane: Array) -> Array:
    """(M,) Y - a - b Z - c X."""
    result = np.empty(len(points))
    for i in range(len(points)):
        result[i] = points[i, 1] - plane[0] - plane[1] * points[i, 2] - plane[2] * points[i, 0]
    return result


@njit(cache=True, nogil=True)
def normal_equations(points: Array, weights: Array) -> tuple[Array, Array]:
    """(3, 3) and (3,) of the weighted least squares for a, b, c."""
    H, g = np.zeros((3, 3)), np.zeros(3)
    row = np.ones(3)
    for i in range(len(points)):
        row[1], row[2] = points[i, 2], points[i, 0]
        for k in range(3):
            g[k] += weights[i] * row[k] * points[i, 1]
            for m in range(3):
                H[k, m] += weights[i] * row[k] * row[m]
    return H, g


@njit(cache=True, nogil=True)
def refine(
    points: Array,
    weights: Array,
    start: Array,
    near: float,
    tukey: float,
    least_spread: float,
    rounds: int,
    least_change: float,
) -> tuple[Array, Array]:
    """(3,) plane by robust least squares from `start` (3,), and the (M,) Tukey weights it ends with.

    near: heights [m] below this tell the spread. tukey: spreads beyond which a point counts nothing. least_change: of
    the plane [m, m/m], else a round is the last.
    """
    plane, robust = start.copy(), weights.copy()
    size = np.empty(len(points))
    for _ in range(rounds):
        residual = residuals(points, plane)
        count = 0
        for i in range(len(residual)):
            if abs(residual[i]) < near:
                size[count] = abs(residual[i])
                count += 1
        spread = SIGMA_PER_MAD * np.median(size[:count]) if count > 0 else 0.0
        robust = reweigh(residual, tukey * max(spread, least_spread))
        H, g = normal_equations(points, weights * robust)
        before = plane
        plane = np.asarray(np.linalg.solve(H, g))
        if np.abs(plane - before).max() < least_change:
            break
    return plane, robust


@njit(cache=True, nogil=True)
def clustered_scores(points: Array, weighted: Array, cell: float) -> tuple[Array, int]:
    """(3, 3) sum over square cells of the outer product of the cell's score, and how many cells there are.

    weighted: (M,) weight times residual; points of weight 0 have none and make no cell.
    """
    x_low, z_low = points[:, 0].min(), points[:, 2].min()
    columns = int((points[:, 0].max() - x_low) / cell) + 1
    rows = int((points[:, 2].max() - z_low) / cell) + 1
    scores = np.zeros((rows * columns, 3))
    for i in range(len(points)):
        k = int((points[i, 2] - z_low) / cell) * columns + int((points[i, 0] - x_low) / cell)
        scores[k, 0] += weighted[i]
        scores[k, 1] += weighted[i] * points[i, 2]
        scores[k, 2] += weighted[i] * points[i, 0]
    total, count = np.zeros((3, 3)), 0
    for k in range(len(scores)):
        if scores[k, 0] == 0.0 and scores[k, 1] == 0.0:
            continue
        count += 1
        for p in range(3):
            for q in range(3):
                total[p, q] += scores[k, p] * scores[k, q]
    return total, count
