"""Rotations, small linear systems and a median for compiled loops."""

from __future__ import annotations

import numpy as np
from numba import njit

from stereocalib_core.numeric.arrays import Array

FAST = {"reassoc", "contract", "arcp", "nsz"}
"""Fast arithmetic for inner loops that keeps NaN and infinity what they are: points are told by them."""


@njit(cache=True, nogil=True)
def rotation_from_vector(w: Array) -> Array:
    """(3,) rotation vector [rad] to (3, 3), Rodrigues' formula."""
    R = np.eye(3)
    angle2 = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
    angle = np.sqrt(angle2)
    if angle < 1e-6:
        a, b = 1.0 - angle2 / 6.0, 0.5 - angle2 / 24.0
    else:
        a, b = np.sin(angle) / angle, (1.0 - np.cos(angle)) / angle2
    for i in range(3):
        for j in range(3):
            R[i, j] += b * (w[i] * w[j] - (angle2 if i == j else 0.0))
    R[0, 1] -= a * w[2]
    R[1, 0] += a * w[2]
    R[0, 2] += a * w[1]
    R[2, 0] -= a * w[1]
    R[1, 2] -= a * w[0]
    R[2, 1] += a * w[0]
    return R


@njit(cache=True, nogil=True)
def vector_from_rotation(R: Array) -> Array:
    """(3, 3) to (3,) rotation vector [rad], for angles well below pi."""
    w = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) * 0.5
    s = np.sqrt(w[0] ** 2 + w[1] ** 2 + w[2] ** 2)
    c = 0.5 * (R[0, 0] + R[1, 1] + R[2, 2] - 1.0)
    if s > 1e-9:
        w *= np.arctan2(s, c) / s
    return w


@njit(cache=True, nogil=True)
def solve_symmetric(H: Array, g: Array, size: int, out: Array) -> bool:
    """Solve H[:size, :size] out = g by Cholesky; False where H is not positive definite. H is overwritten."""
    for i in range(size):
        for j in range(i + 1):
            s = H[i, j]
            for k in range(j):
                s -= H[i, k] * H[j, k]
            if i == j:
                if not s > 0.0:
                    return False
                H[i, i] = np.sqrt(s)
            else:
                H[i, j] = s / H[j, j]
    for i in range(size):
        s = g[i]
        for k in range(i):
            s -= H[i, k] * out[k]
        out[i] = s / H[i, i]
    for i in range(size - 1, -1, -1):
        s = out[i]
        for k in range(i + 1, size):
            s -= H[k, i] * out[k]
        out[i] = s / H[i, i]
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def solve_square(H: Array, R: Array) -> float:
    """Solve H X = R by Gauss's elimination, the largest pivot of a column first; gives the determinant of H.

    H: (K, K), overwritten. R: (K, M), overwritten by X; of no use where the determinant is 0. The same as
    `np.linalg.solve`, which alone takes as long to compile as a kernel around it.
    """
    n, sides, determinant = H.shape[0], R.shape[1], 1.0
    for k in range(n):
        largest = k
        for i in range(k + 1, n):
            if abs(H[i, k]) > abs(H[largest, k]):
                largest = i
        pivot = H[largest, k]
        if pivot == 0.0:
            return 0.0
        if largest != k:
            determinant = -determinant
            for j in range(k, n):
                H[k, j], H[largest, j] = H[largest, j], H[k, j]
            for j in range(sides):
                R[k, j], R[largest, j] = R[largest, j], R[k, j]
        determinant *= pivot
        for i in range(k + 1, n):
            factor = H[i, k] / pivot
            for j in range(k + 1, n):
                H[i, j] -= factor * H[k, j]
            for j in range(sides):
                R[i, j] -= factor * R[k, j]
    for i in range(n - 1, -1, -1):
        for j in range(sides):
            for k in range(i + 1, n):
                R[i, j] -= H[i, k] * R[k, j]
            R[i, j] /= H[i, i]
    return determinant


@njit(cache=True, nogil=True)
def median_size(values: Array) -> float:
    """Median of the absolute values of (N,), NaN where there are none or one of them is NaN, by Hoare's selection."""
    n = len(values)
    sizes = np.empty(n)
    for i in range(n):
        sizes[i] = abs(values[i])
        if np.isnan(sizes[i]):
            return np.nan
    if n == 0:
        return np.nan
    middle, low, high = n // 2, 0, n - 1
    while low < high:
        pivot, i, j = sizes[(low + high) // 2], low, high
        while i <= j:
            while sizes[i] < pivot:
                i += 1
            while sizes[j] > pivot:
                j -= 1
            if i <= j:
                sizes[i], sizes[j] = sizes[j], sizes[i]
                i += 1
                j -= 1
        if middle <= j:
            high = j
        elif middle >= i:
            low = i
        else:
            break
    if n % 2:
        return sizes[middle]
    below = sizes[0]
    for i in range(1, middle):
        below = max(below, sizes[i])
    return 0.5 * (below + sizes[middle])
