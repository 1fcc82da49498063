"""Beams with a range error of their own: how large it is, and what it does to the transform.

Every beam of a spinning LiDAR has its own laser, detector and delay. What one reads too far it reads too far on every
board, so more boards do not remove it. Bent rows show how large such errors are; a part that looks like a tilt of all
boards shows nowhere, and is carried into the covariance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.boards.beam_variance import RowSums, beam_variance, row_sums
from stereocalib_core.boards.joint import (
    JointProblem,
    JointState,
    NormalEquations,
    beam_columns,
    board_moments,
    plane_distances,
)
from stereocalib_core.boards.planes import tangent_basis
from stereocalib_core.config.boards import BEAM
from stereocalib_core.numeric.arrays import Array


@dataclass(frozen=True)
class Beams:
    """owner: (P,) the beam of each point of a problem; count of beams; sigma_m: 1 sigma of their own range errors, the
    doubt in it included.

    shared: (3 M, 3 M) covariance that they give to the boards' mismatches (`solve.mismatch`), in common.
    """

    owner: NDArray[np.int64]
    count: int
    sigma_m: float
    shared: Array


def find_beams(problem: JointProblem, state: JointState, normals_camera: Array) -> Beams | None:
    """The beams that the points' elevations show, and the spread of their range errors; None for other LiDARs."""
    owner = beams_of(problem.rays)
    if owner is None:
        return None
    count = int(owner.max()) + 1
    variance = beam_variance(_rows(problem, state, owner, count))
    response = _plane_response(problem, state, owner, count, normals_camera)
    return Beams(owner, count, float(np.sqrt(variance)), variance * response @ response.T)


def beams_of(rays: Array) -> NDArray[np.int64] | None:
    """(P, 3) unit rays to the (P,) beam of each, by elevations that stand clearly apart; None when they do not."""
    elevation = np.arcsin(np.clip(rays[:, 2], -1.0, 1.0))
    order = np.argsort(elevation, kind="stable")
    sorted_up = elevation[order]
    breaks = np.flatnonzero(np.diff(sorted_up) > BEAM.least_gap_rad)
    starts, ends = np.concatenate([[0], breaks + 1]), np.concatenate([breaks, [len(sorted_up) - 1]])
    if not BEAM.least_beams <= len(starts) <= BEAM.most_beams:
        return None
    width = sorted_up[ends] - sorted_up[starts]
    gaps = np.diff((sorted_up[starts] + sorted_up[ends]) / 2)
    if float(np.quantile(width, 0.9)) > BEAM.most_width_share * float(np.median(gaps)):
        return None
    owner = np.empty(len(rays), dtype=np.int64)
    owner[order] = np.repeat(np.arange(len(starts)), ends - starts + 1)
    return owner


def _rows(problem: JointProblem, state: JointState, owner: NDArray[np.int64], count: int) -> RowSums:
    """What the rows with enough points say of the beams' errors."""
    along, miss = beam_columns(problem, state)
    cell = problem.owner * count + owner
    size = np.bincount(cell, minlength=len(problem.counts) * count)
    used = np.flatnonzero(size >= BEAM.least_points)

    def mean(values: Array) -> Array:
        return np.bincount(cell, values, len(size))[used] / size[used]

    places = np.column_stack([np.ones(len(used)), mean(along[:, 0]), mean(along[:, 1])])
    return row_sums(used // count, used % count, places, mean(miss), count)


def pull_of_beams(
    problem: JointProblem, state: JointState, system: NormalEquations, owner: NDArray[np.int64], count: int
) -> Array:
    """(G, K) what a unit range error of each beam adds to the right-hand side of the shared numbers."""
    pulls = board_moments(problem, state, owner, count)
    toward = np.zeros((len(system.g_g), count))
    toward[:6] = -pulls[:, :6].sum(axis=0)
    return toward - np.einsum("mgb,mbc,mck->gk", system.H_gb, np.linalg.inv(system.H_bb), pulls)


def _plane_response(
    problem: JointProblem, state: JointState, owner: NDArray[np.int64], count: int, normals_camera: Array
) -> Array:
    """(3 M, K) what a unit range error of each beam does to `solve.mismatch` of each board: two tilts, one offset."""
    along, _ = beam_columns(problem, state)
    q = np.column_stack([np.ones(len(along)), along])
    boards = len(problem.counts)
    squares = (q[:, :, None] * q[:, None, :]).reshape(-1, 9)
    S = np.add.reduceat(squares, problem.starts, axis=0).reshape(-1, 3, 3)
    cell = problem.owner * count + owner
    # A range longer by one metre moves its point this far along the board's outward normal.
    _, shift = plane_distances(problem, state)
    moments = np.stack([np.bincount(cell, q[:, k] * shift, boards * count) for k in range(3)], axis=-1)
    moments = np.swapaxes(moments.reshape(boards, count, 3), 1, 2)
    offset_and_tilts = np.linalg.pinv(S, hermitian=True) @ moments
    axes = state.T_camera_boards[:, :3, :3]
    basis = tangent_basis(normals_camera)
    to_mismatch = np.zeros((boards, 3, 3))
    to_mismatch[:, :2, 1] = -np.einsum("mka,ma->mk", basis, axes[:, :, 0])
    to_mismatch[:, :2, 2] = -np.einsum("mka,ma->mk", basis, axes[:, :, 1])
    to_mismatch[:, 2, 0] = 1.0
    return np.asarray((to_mismatch @ offset_and_tilts).reshape(3 * boards, count))
