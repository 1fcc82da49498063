"""Joint refinement (Zheng et al., eq. 6-7): extrinsics, board poses and, on request, intrinsics and scale together.

Minimised is the sum of squared corner errors over sigma_corner and of LiDAR points' distances to their
board over the noise of their ray, by Levenberg-Marquardt with Huber's loss. The paper's kappa is the
ratio of the two sigmas. Each board touches only its own numbers, so these are eliminated first
(Schur complement) and a step costs a few 9 x 9 systems, whatever the number of points.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stereocalib_core.boards.joint import (
    Free,
    JointProblem,
    JointState,
    NormalEquations,
    cost,
    linearise,
)
from stereocalib_core.boards.rotations import apply_twist
from stereocalib_core.boards.solve import covariance_of, pseudo_inverse
from stereocalib_core.config.boards import REFINE
from stereocalib_core.numeric.arrays import Array


@dataclass(frozen=True)
class Iteration:
    """State after one step: robust cost (no unit) and corner reprojection rms [px]."""

    cost: float
    reprojection_rms_px: float


@dataclass(frozen=True)
class Refined:
    """Solution, covariance and history.

    joint_covariance: (6 + q, 6 + q) of the extrinsics' left twist, then of the intrinsics and the scale if free.
    """

    state: JointState
    joint_covariance: Array
    free: Free
    iterations: tuple[Iteration, ...]

    @property
    def covariance(self) -> Array:
        """(6, 6) of the extrinsics' left twist, whatever else was free taken into account."""
        return self.joint_covariance[:6, :6]

    @property
    def intrinsic_sigma(self) -> Array | None:
        """(4 + n,) of fx, fy, cx, cy [px] and the coefficients; None when they were held."""
        if not self.free.intrinsics:
            return None
        count = 4 + len(self.state.camera.D)
        return np.sqrt(np.maximum(np.diag(self.joint_covariance)[6 : 6 + count], 0.0))

    @property
    def scale_sigma(self) -> float:
        """Of the board's scale; 0 when it was held."""
        return float(np.sqrt(max(self.joint_covariance[-1, -1], 0.0))) if self.free.scale else 0.0


def refine(problem: JointProblem, start: JointState, free: Free | None = None) -> Refined:
    """Levenberg-Marquardt from `start`; what is not `free` (default: the extrinsics) stays, boards always move."""
    free = free or Free()
    state, damping = start, 1e-6
    value, rms = cost(problem, state, free)
    history = [Iteration(value, rms)]
    for _ in range(REFINE.most_iterations):
        system = linearise(problem, state, free)
        moved, moved_value, moved_rms = state, value, rms
        for _ in range(12):
            candidate = _step(system, state, damping, free)
            candidate_value, candidate_rms = cost(problem, candidate, free)
            if np.isfinite(candidate_value) and candidate_value <= value * (1.0 + REFINE.rounding):
                moved, moved_value, moved_rms = candidate, candidate_value, candidate_rms
                damping = max(damping / 10, 1e-15)
                break
            damping *= 10
        if moved is state:
            break
        gain, value, rms, state = value - moved_value, moved_value, moved_rms, moved
        history.append(Iteration(value, rms))
        if gain <= REFINE.settled * value:
            break
    covariance = covariance_of(linearise(problem, state, free).reduced())
    return Refined(state, covariance, free, tuple(history))


def _step(system: NormalEquations, state: JointState, damping: float, free: Free) -> JointState:
    """One damped step: boards eliminated, the rest solved, boards recovered."""
    diagonal = np.einsum("mbb->mb", system.H_bb)
    inverse = np.linalg.inv(system.H_bb + damping * diagonal[:, :, None] * np.eye(9))
    step_g = np.zeros(len(system.g_g))
    if free.extrinsics:
        carried = system.H_gb @ inverse
        reduced = system.H_gg + damping * np.diag(np.diag(system.H_gg))
        reduced = reduced - np.einsum("mgb,mhb->gh", carried, system.H_gb)
        rest = system.g_g - np.einsum("mgb,mb->g", carried, system.g_b)
        step_g = -pseudo_inverse(reduced) @ rest
    back = system.g_b + np.einsum("mgb,g->mb", system.H_gb, step_g)
    step_b = -np.einsum("mab,mb->ma", inverse, back)
    moved = replace(
        state,
        T_camera_lidar=apply_twist(step_g[:6], state.T_camera_lidar),
        T_camera_boards=apply_twist(step_b[:, :6], state.T_camera_boards),
        plane_errors=state.plane_errors + step_b[:, 6:],
    )
    if free.scale and free.extrinsics:
        moved = replace(moved, scale=max(state.scale + float(step_g[-1]), 1e-3))
        step_g = step_g[:-1]
    if free.intrinsics and free.extrinsics:
        moved = replace(moved, camera=state.camera.with_intrinsic_step(step_g[6:]))
    return moved
