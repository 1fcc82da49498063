"""How large the range errors are that beams have of their own: a posterior, since few rows may hardly tell.

Rows of points against their boards' planes, each plane left free. What the planes leave is a mixture of the beams'
errors and of what every row has for itself; its likelihood is integrated over both variances. Before any row is seen
the beams' variance is thought to be a scaled inverse chi^2 (Gelman et al., Bayesian Data Analysis, section 2.6), so a
set whose rows tell nothing is given the beams of other LiDARs, and not none.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.config.boards import BEAM
from stereocalib_core.numeric.arrays import Array


@dataclass(frozen=True)
class RowSums:
    """What R rows, planes taken off, say of K beams: A (K, K) = Z'PZ, c (K,) = Z'Py [m], left = y'Py [m^2], with y the
    rows' mean range errors, Z the beam of each and P what is left beside the planes; freedom: rank of P."""

    A: Array
    c: Array
    left: float
    freedom: int


def row_sums(
    board: NDArray[np.int64], beam: NDArray[np.int64], places: Array, means: Array, count: int
) -> RowSums:
    """Rows (R,) with the board and beam of each, its place (R, 3) as (1, x, y) and its mean range error (R,) [m]."""
    A, c, left, freedom = np.zeros((count, count)), np.zeros(count), 0.0, 0
    for i in np.unique(board):
        mine = np.flatnonzero(board == i)
        if len(mine) <= 3:
            continue
        q = places[mine]
        project = np.eye(len(q)) - q @ np.linalg.pinv(q)
        Z = np.zeros((len(q), count))
        Z[np.arange(len(q)), beam[mine]] = 1.0
        A += Z.T @ project @ Z
        c += Z.T @ project @ means[mine]
        left += float(means[mine] @ project @ means[mine])
        freedom += len(q) - 3
    return RowSums(A, c, left, freedom)


def beam_variance(sums: RowSums) -> float:
    """The beams' variance [m^2], as the geometric mean of its posterior: with so little known of it errors follow
    Student's t, and this is the Gaussian that has two of three within one sigma as t has (the mean would have more).

    Py is Gaussian with covariance s P + v PZZ'P (v: beams, s: rows), of which A has the eigenvalues beside s.
    """
    v = np.square(np.geomspace(*BEAM.sigma_range_m, BEAM.grid))[:, None]
    log_prior = -0.5 * BEAM.usual_freedom * (np.log(v) + BEAM.usual_sigma_m**2 / v)
    log_posterior = log_prior[:, 0]
    if sums.freedom > 0 and sums.left > 0.0:
        values, vectors = np.linalg.eigh(sums.A)
        told = values > 1e-9 * max(float(values[-1]), 1e-300)
        values = values[told]
        pulled = (vectors[:, told].T @ sums.c) ** 2 / values
        alone = max(sums.left - float(pulled.sum()), 0.0)
        s = sums.left / sums.freedom * np.geomspace(*BEAM.row_share, BEAM.grid)[None, :]
        spread = s[..., None] + v[..., None] * values
        likelihood = (sums.freedom - len(values)) * np.log(s) + alone / s
        likelihood = likelihood + (np.log(spread) + pulled / spread).sum(axis=-1)
        rows = -0.5 * likelihood
        top = rows.max(axis=1)
        log_posterior = log_posterior + top + np.log(np.exp(rows - top[:, None]).sum(axis=1))
    weight = np.exp(log_posterior - log_posterior.max())
    return float(np.exp(weight @ np.log(v[:, 0]) / weight.sum()))
