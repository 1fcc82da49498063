"""Least squares whose last unknowns are small, nobody knows how small: averaged over sizes by their evidence."""

from __future__ import annotations

import numpy as np
from numba import njit

from stereocalib_core.numeric.arrays import Array


@njit(cache=True, nogil=True)
def average_over_sizes(
    A: Array, right: Array, free: int, sizes: Array, reluctance: float
) -> tuple[Array, Array, Array]:
    """Solution of A x = right, where the unknowns after the first `free` are zero within each of `sizes` (1 sigma)
    beforehand, averaged by their evidence.

    A: (K, K) information, right: (K,). reluctance: a size is expected beforehand in proportion to its inverse to this
    power. Gives the solution (K,), its covariance (K, K) over all sizes, and the average inverse of A (K, K).
    """
    unknowns = len(right)
    inverse = np.empty((len(sizes), unknowns, unknowns))
    solutions, log_evidence = np.empty((len(sizes), unknowns)), np.empty(len(sizes))
    for k in range(len(sizes)):
        information = A.copy()
        for small in range(free, unknowns):
            information[small, small] += sizes[k] ** -2.0
        inverse[k] = np.linalg.inv(information)
        solutions[k] = inverse[k] @ right
        log_evidence[k] = (
            0.5 * np.sum(solutions[k] * right)
            - 0.5 * np.linalg.slogdet(information)[1]
            - (unknowns - free + reluctance) * np.log(sizes[k])
        )
    share = np.exp(log_evidence - log_evidence.max())
    share /= share.sum()
    solution, average = np.zeros(unknowns), np.zeros((unknowns, unknowns))
    for k in range(len(sizes)):
        solution += share[k] * solutions[k]
        average += share[k] * inverse[k]
    covariance = average.copy()
    for k in range(len(sizes)):
        apart = solutions[k] - solution
        covariance += share[k] * np.outer(apart, apart)
    return solution, covariance, average
