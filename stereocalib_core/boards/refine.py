"""Joint refinement (Zheng et al., eq. 6-7): extrinsics, board poses and, on request, intrinsics together.

Minimised is the sum of squared corner errors over sigma_corner and of LiDAR points' distances to their
board over the noise of their ray, by Levenberg-Marquardt with Huber's loss. The paper's kappa is the
ratio of the two sigmas. Each board touches only its own pose, so its six numbers are eliminated first
(Schur complement) and a step costs a few 6 x 6 systems, whatever the number of points.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.boards.camera import BoardCamera
from stereocalib_core.boards.rotations import apply_twist, skew
from stereocalib_core.boards.solve import covariance_of, pseudo_inverse
from stereocalib_core.config.boards import PLANE, REFINE
from stereocalib_core.numeric.arrays import Array


@dataclass(frozen=True)
class Noise:
    """Standard deviations of one corner coordinate [px] and of one range [m]."""

    corner_px: float
    range_m: float

    @property
    def kappa(self) -> float:
        """The paper's weight of e_L against e_C [px/m]."""
        return self.corner_px / self.range_m


@dataclass(frozen=True)
class Iteration:
    """State after one step: robust cost (no unit) and corner reprojection rms [px]."""

    cost: float
    reprojection_rms_px: float


@dataclass(frozen=True)
class JointProblem:
    """What is measured. corners: (M, N, 2) px; model: (N, 3) m, corners on the board; points: (P, 3) m in the
    LiDAR frame, those of board 0 first; counts: (M,) points of each board."""

    camera: BoardCamera
    corners: Array
    model: Array
    points: Array
    counts: NDArray[np.int64]
    noise: Noise


@dataclass(frozen=True)
class JointState:
    """What is sought: T_camera_lidar (4, 4), T_camera_boards (M, 4, 4), the camera."""

    T_camera_lidar: Array
    T_camera_boards: Array
    camera: BoardCamera


@dataclass(frozen=True)
class Refined:
    """Solution, (6, 6) covariance of the extrinsics' left twist, (4 + n,) intrinsic sigmas or None, history."""

    state: JointState
    covariance: Array
    intrinsic_sigma: Array | None
    iterations: tuple[Iteration, ...]


@dataclass(frozen=True)
class _System:
    """Normal equations. Global block first: extrinsics (6) and q intrinsics."""

    H_gg: Array
    H_gb: Array
    H_bb: Array
    g_g: Array
    g_b: Array


def refine(
    problem: JointProblem, start: JointState, with_intrinsics: bool = False, fixed: bool = False
) -> Refined:
    """Levenberg-Marquardt from `start`. `fixed` holds the extrinsics and moves only the boards."""
    state, damping = start, 1e-6
    cost, rms = _cost(problem, state)
    history = [Iteration(cost, rms)]
    for _ in range(REFINE.most_iterations):
        system = _linearise(problem, state, with_intrinsics)
        moved, moved_cost, moved_rms = state, cost, rms
        for _ in range(12):
            candidate = _step(system, state, damping, fixed)
            candidate_cost, candidate_rms = _cost(problem, candidate)
            if np.isfinite(candidate_cost) and candidate_cost <= cost * (1.0 + REFINE.rounding):
                moved, moved_cost, moved_rms = candidate, candidate_cost, candidate_rms
                damping = max(damping / 10, 1e-15)
                break
            damping *= 10
        if moved is state:
            break
        gain, cost, rms, state = cost - moved_cost, moved_cost, moved_rms, moved
        history.append(Iteration(cost, rms))
        if gain <= REFINE.settled * cost:
            break
    system = _linearise(problem, state, with_intrinsics)
    reduced = system.H_gg - np.einsum("mgb,mbc,mhc->gh", system.H_gb, np.linalg.inv(system.H_bb), system.H_gb)
    covariance = covariance_of(reduced)
    sigma = np.sqrt(np.maximum(np.diag(covariance)[6:], 0.0)) if with_intrinsics else None
    return Refined(state, covariance[:6, :6], sigma, tuple(history))


def corner_errors(problem: JointProblem, state: JointState) -> Array:
    """(M, N, 2) reprojection errors [px]."""
    return state.camera.project(_on_boards(problem, state)) - problem.corners


def plane_errors(problem: JointProblem, state: JointState) -> tuple[Array, Array]:
    """(P,) signed distances of the LiDAR points from their boards [m], and (P,) slants |n . u| of their rays."""
    R, t = state.T_camera_lidar[:3, :3], state.T_camera_lidar[:3, 3]
    rotated = problem.points @ R.T
    normals = np.repeat(state.T_camera_boards[:, :3, 2], problem.counts, axis=0)
    origins = np.repeat(state.T_camera_boards[:, :3, 3], problem.counts, axis=0)
    distance = np.sum(normals * (rotated + t - origins), axis=1)
    slant = np.abs(np.sum(normals * rotated, axis=1)) / np.linalg.norm(problem.points, axis=1)
    return distance, np.maximum(slant, PLANE.slant_floor)


def _on_boards(problem: JointProblem, state: JointState) -> Array:
    T = state.T_camera_boards
    return np.einsum("mab,nb->mna", T[:, :3, :3], problem.model) + T[:, None, :3, 3]


def _cost(problem: JointProblem, state: JointState) -> tuple[float, float]:
    """Huber cost and corner rms [px]."""
    with np.errstate(invalid="ignore"):
        error = corner_errors(problem, state)
        distance, slant = plane_errors(problem, state)
        total = _huber(error / problem.noise.corner_px) + _huber(distance / (slant * problem.noise.range_m))
    return total, float(np.sqrt(np.mean(np.sum(error**2, axis=-1))))


def _huber(residual: Array) -> float:
    size = np.abs(residual)
    return float(
        np.sum(np.where(size <= REFINE.huber, 0.5 * size**2, REFINE.huber * size - 0.5 * REFINE.huber**2))
    )


def _huber_weight(residual: Array) -> Array:
    return np.minimum(1.0, REFINE.huber / np.maximum(np.abs(residual), 1e-300))


def _linearise(problem: JointProblem, state: JointState, with_intrinsics: bool) -> _System:
    boards = len(problem.counts)
    points = _on_boards(problem, state)
    pixels, d_pixels = state.camera.project_with_jacobian(points)
    error = (pixels - problem.corners) / problem.noise.corner_px
    weight = _huber_weight(error).reshape(boards, -1)
    error = error.reshape(boards, -1)
    J_b = np.concatenate([-d_pixels @ skew(points), d_pixels], axis=-1).reshape(boards, -1, 6)
    J_b = J_b / problem.noise.corner_px
    WJ_b = weight[..., None] * J_b
    H_bb = np.swapaxes(J_b, 1, 2) @ WJ_b
    g_b = np.einsum("mrk,mr->mk", WJ_b, error)

    A, a = _lidar_blocks(problem, state)
    q = 4 + len(state.camera.D) if with_intrinsics else 0
    H_gg, g_g = np.zeros((6 + q, 6 + q)), np.zeros(6 + q)
    H_gb = np.zeros((boards, 6 + q, 6))
    # A point feels the extrinsics and its board's pose alike, with opposite signs.
    H_gg[:6, :6], g_g[:6] = A.sum(axis=0), a.sum(axis=0)
    H_gb[:, :6] = -A
    H_bb, g_b = H_bb + A, g_b - a
    if q:
        J_k = state.camera.intrinsic_jacobian(points).reshape(boards, -1, q) / problem.noise.corner_px
        H_gg[6:, 6:] = np.einsum("mrk,mr,mrl->kl", J_k, weight, J_k)
        g_g[6:] = np.einsum("mrk,mr,mr->k", J_k, weight, error)
        H_gb[:, 6:] = np.swapaxes(J_k, 1, 2) @ WJ_b
    return _System(H_gg, H_gb, H_bb, g_g, g_b)


def _lidar_blocks(problem: JointProblem, state: JointState) -> tuple[Array, Array]:
    """(M, 6, 6) and (M, 6): normal equations of the LiDAR points by a left twist of T_camera_lidar."""
    distance, slant = plane_errors(problem, state)
    sigma = slant * problem.noise.range_m
    residual = distance / sigma
    normals = np.repeat(state.T_camera_boards[:, :3, 2], problem.counts, axis=0)
    # The derivative is taken where the ray meets the board: at the measured point it would share that
    # point's noise, which biases the normals by some (sigma / range)^2 over the slant.
    rays = problem.points @ state.T_camera_lidar[:3, :3].T
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    overshoot = distance / (np.sign(np.sum(normals * rays, axis=1)) * slant)
    reach = np.linalg.norm(problem.points, axis=1) - overshoot
    in_camera = rays * reach[:, None] + state.T_camera_lidar[:3, 3]
    J = np.concatenate([np.cross(in_camera, normals), normals], axis=1) / sigma[:, None]
    WJ = _huber_weight(residual)[:, None] * J
    A, a = np.zeros((len(problem.counts), 6, 6)), np.zeros((len(problem.counts), 6))
    ends = np.cumsum(problem.counts)
    for board, (end, count) in enumerate(zip(ends, problem.counts, strict=True)):
        rows = slice(end - count, end)
        A[board], a[board] = WJ[rows].T @ J[rows], WJ[rows].T @ residual[rows]
    return A, a


def _step(system: _System, state: JointState, damping: float, fixed: bool) -> JointState:
    """One damped step: boards eliminated, the rest solved, boards recovered."""
    diagonal = np.einsum("mbb->mb", system.H_bb)
    H_bb = system.H_bb + damping * diagonal[:, :, None] * np.eye(6)
    inverse = np.linalg.inv(H_bb)
    step_g = np.zeros(len(system.g_g))
    if not fixed:
        carried = system.H_gb @ inverse
        reduced = system.H_gg + damping * np.diag(np.diag(system.H_gg))
        reduced = reduced - np.einsum("mgb,mhb->gh", carried, system.H_gb)
        rest = system.g_g - np.einsum("mgb,mb->g", carried, system.g_b)
        step_g = -pseudo_inverse(reduced) @ rest
    back = system.g_b + np.einsum("mgb,g->mb", system.H_gb, step_g)
    boards = apply_twist(-np.einsum("mab,mb->ma", inverse, back), state.T_camera_boards)
    moved = replace(
        state, T_camera_lidar=apply_twist(step_g[:6], state.T_camera_lidar), T_camera_boards=boards
    )
    return moved if len(step_g) == 6 else replace(moved, camera=state.camera.with_intrinsic_step(step_g[6:]))
