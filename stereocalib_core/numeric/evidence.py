"""Least squares whose last unknowns are small, nobody knows how small: averaged over sizes by their evidence."""

from __future__ import annotations

import numpy as np
from numba import njit

from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.small_algebra import solve_square


@njit(cache=True, nogil=True)
def average_over_sizes(
    A: Array, right: Array, free: int, sizes: Array, reluctance: float, ratio: Array, least: Array
) -> tuple[Array, Array, Array]:
    """Solution of A x = right, where the unknowns after the first `free` are zero within each of `sizes` (1 sigma)
    beforehand, averaged by their evidence.

    A: (K, K) information, right: (K,). ratio, least: (K - free,) each of those unknowns is zero within so many sizes,
    and within so much at least, root sum of squares: 1 and 0 for the sizes themselves. reluctance: a size is expected
    beforehand in proportion to its inverse to this power. Gives the solution (K,), its covariance (K, K) over all
    sizes, and the average inverse of A (K, K); NaN where A does not fix the unknowns.
    """
    unknowns = len(right)
    information = np.empty((unknowns, unknowns))
    inverse = np.zeros((len(sizes), unknowns, unknowns))
    solutions, log_evidence = np.zeros((len(sizes), unknowns)), np.empty(len(sizes))
    for k in range(len(sizes)):
        log_prior = 0.0
        for i in range(unknowns):
            for j in range(unknowns):
                information[i, j] = A[i, j]
            inverse[k, i, i] = 1.0
            if i >= free:
                beforehand = (ratio[i - free] * sizes[k]) ** 2 + least[i - free] ** 2
                information[i, i] += 1.0 / beforehand
                log_prior += 0.5 * np.log(beforehand)
        determinant = solve_square(information, inverse[k])
        if determinant == 0.0:
            determinant = np.nan
        fits = 0.0
        for i in range(unknowns):
            for j in range(unknowns):
                solutions[k, i] += inverse[k, i, j] * right[j]
            fits += solutions[k, i] * right[i]
        log_evidence[k] = (
            0.5 * fits - 0.5 * np.log(abs(determinant)) - log_prior - reluctance * np.log(sizes[k])
        )
    solution, average = np.zeros(unknowns), np.zeros((unknowns, unknowns))
    share, most, total = np.empty(len(sizes)), log_evidence[0], 0.0
    for k in range(len(sizes)):
        most = max(most, log_evidence[k])
    for k in range(len(sizes)):
        share[k] = np.exp(log_evidence[k] - most)
        total += share[k]
    # element by element: whole arrays would take as long to compile as all the rest
    for k in range(len(sizes)):
        share[k] /= total
        for i in range(unknowns):
            solution[i] += share[k] * solutions[k, i]
            for j in range(unknowns):
                average[i, j] += share[k] * inverse[k, i, j]
    covariance = np.empty((unknowns, unknowns))
    for i in range(unknowns):
        for j in range(unknowns):
            covariance[i, j] = average[i, j]
            for k in range(len(sizes)):
                apart = (solutions[k, i] - solution[i]) * (solutions[k, j] - solution[j])
                covariance[i, j] += share[k] * apart
    return solution, covariance, average
