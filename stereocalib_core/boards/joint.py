"""What the joint refinement measures and seeks: residuals, derivatives and normal equations.

Every board has its own block: six numbers of its pose and three of how far its LiDAR plane as a whole is off (two
tilts, one offset). The last three are what white noise leaves out: beams with a range error of their own, a bent
board, a hand that moved. They are held near zero by the variances that `variance_components` finds.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.boards.camera import BoardCamera
from stereocalib_core.boards.centres import Centres
from stereocalib_core.boards.point_sums import distances_and_places, huber_sums
from stereocalib_core.boards.rotations import cross, skew
from stereocalib_core.config.boards import PLANE, REFINE
from stereocalib_core.numeric.arrays import Array

NO_PLANE_SIGMA = (0.0, 0.0)


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
class JointProblem:
    """What is measured. corners: (M, N, 2) px; corner_sigma: (M,) px, that of each picture; model: (N, 3) m, corners on
    the board; points: (P, 3) m in the LiDAR frame, those of board 0 first; counts: (M,) points of each board.

    plane_sigma: standard deviations of a LiDAR plane as a whole, tilt [rad] and offset [m], beyond its points' noise.
    centres: the outlines' centres, or None where they are not to count.
    """

    camera: BoardCamera
    corners: Array
    corner_sigma: Array
    model: Array
    points: Array
    counts: NDArray[np.int64]
    noise: Noise
    plane_sigma: tuple[float, float] = NO_PLANE_SIGMA
    centres: Centres | None = None

    @cached_property
    def owner(self) -> NDArray[np.int64]:
        """(P,) the board of each point."""
        return np.repeat(np.arange(len(self.counts)), self.counts)

    @cached_property
    def rays(self) -> Array:
        """(P, 3) unit directions of the points from the LiDAR."""
        return np.asarray(self.points / np.linalg.norm(self.points, axis=1, keepdims=True))

    @cached_property
    def starts(self) -> NDArray[np.int64]:
        """(M,) index of each board's first point."""
        return np.cumsum(self.counts) - self.counts


@dataclass(frozen=True)
class Free:
    """What moves beside the boards. scale_sigma: how well the printed square is known, as a share (inf: not at all)."""

    extrinsics: bool = True
    intrinsics: bool = False
    scale: bool = False
    scale_sigma: float = float("inf")


@dataclass(frozen=True)
class JointState:
    """What is sought: T_camera_lidar (4, 4), T_camera_boards (M, 4, 4), the camera, and the board's true size over
    the stated one. plane_errors: (M, 3) tilt along the board's x and y [rad] and offset [m] of each LiDAR plane.
    """

    T_camera_lidar: Array
    T_camera_boards: Array
    camera: BoardCamera
    scale: float = 1.0
    plane_errors: Array = field(default_factory=lambda: np.zeros((0, 3)))

    def __post_init__(self) -> None:
        if len(self.plane_errors) != len(self.T_camera_boards):
            object.__setattr__(self, "plane_errors", np.zeros((len(self.T_camera_boards), 3)))


@dataclass(frozen=True)
class NormalEquations:
    """Global block first: extrinsics (6), then intrinsics and scale where they are free; boards have 9 each."""

    H_gg: Array
    H_gb: Array
    H_bb: Array
    g_g: Array
    g_b: Array

    def reduced(self) -> Array:
        """Information of the global block with the boards eliminated (Schur complement)."""
        return np.asarray(
            self.H_gg - np.einsum("mgb,mbc,mhc->gh", self.H_gb, np.linalg.inv(self.H_bb), self.H_gb)
        )


@dataclass(frozen=True)
class _LidarRows:
    """distance (P,) signed [m], whole plane errors taken off; slant (P,) |n . u|; along (P, 2) [m] on the board."""

    distance: Array
    slant: Array
    along: Array


def corner_errors(problem: JointProblem, state: JointState) -> Array:
    """(M, N, 2) reprojection errors [px]."""
    return state.camera.project(_on_boards(problem, state)) - problem.corners


def plane_distances(problem: JointProblem, state: JointState) -> tuple[Array, Array]:
    """(P,) signed distances of the LiDAR points from their boards [m], and (P,) slants |n . u| of their rays."""
    axes, places = _boards_in_lidar(problem, state)
    normals = axes[:, :, 2][problem.owner]
    distance = np.einsum("pa,pa->p", problem.points, normals) - places[problem.owner, 2]
    return distance, np.maximum(np.abs(np.einsum("pa,pa->p", problem.rays, normals)), PLANE.slant_floor)


def _boards_in_lidar(problem: JointProblem, state: JointState) -> tuple[Array, Array]:
    """(M, 3, 3) the boards' axes as columns and (M, 3) their origins along these axes [m], in the LiDAR frame."""
    R, t = state.T_camera_lidar[:3, :3], state.T_camera_lidar[:3, 3]
    poses = state.T_camera_boards
    return R.T @ poses[:, :3, :3], np.einsum("mak,ma->mk", poses[:, :3, :3], poses[:, :3, 3] - t)


def _lidar_rows(problem: JointProblem, state: JointState) -> _LidarRows:
    """The places along the board are those where the rays meet it: at the measured points they would share those
    points' noise, which biases tilts by (sigma / half the board)^2 over the slant, a tenth of a degree."""
    axes, places = _boards_in_lidar(problem, state)
    return _LidarRows(
        *distances_and_places(
            problem.points, problem.rays, problem.owner, axes, places, state.plane_errors, PLANE.slant_floor
        )
    )


def _lidar_sums(problem: JointProblem, state: JointState) -> tuple[float, Array, Array]:
    """Half the sum of the points' squares under Huber's loss, and per board the moments and pulls of (1, x, y)."""
    rows = _lidar_rows(problem, state)
    return huber_sums(
        rows.distance,
        rows.slant,
        rows.along,
        problem.owner,
        len(problem.counts),
        problem.noise.range_m,
        REFINE.huber,
    )


def cost(problem: JointProblem, state: JointState, free: Free) -> tuple[float, float]:
    """Half the sum of squares under Huber's loss, priors included, and the corners' rms [px]."""
    with np.errstate(invalid="ignore"):
        error = corner_errors(problem, state)
        total = _huber(error / problem.corner_sigma[:, None, None])
        total += _lidar_sums(problem, state)[0]
        total += 0.5 * float(np.sum(state.plane_errors**2 * _plane_precision(problem)))
        if problem.centres is not None:
            total += problem.centres.cost(state.T_camera_lidar, state.scale)
        if free.scale:
            total += 0.5 * ((state.scale - 1.0) / free.scale_sigma) ** 2
    return total, float(np.sqrt(np.mean(np.sum(error**2, axis=-1))))


def linearise(problem: JointProblem, state: JointState, free: Free) -> NormalEquations:
    """Normal equations at `state`: corners into board poses, intrinsics and scale; points into everything else."""
    boards = len(problem.counts)
    H_gg, g_g, H_gb, H_bb, g_b = _lidar_equations(problem, state)
    error, J_b, points, d_pixels = corner_rows(problem, state)
    weight = _huber_weight(error.reshape(boards, -1, 2)).reshape(boards, -1)
    WJ_b = weight[..., None] * J_b
    H_bb[:, :6, :6] += np.swapaxes(J_b, 1, 2) @ WJ_b
    g_b[:, :6] += np.einsum("mrk,mr->mk", WJ_b, error)
    by_centres, toward_centres = np.zeros((7, 7)), np.zeros(7)
    if problem.centres is not None:
        by_centres, toward_centres = problem.centres.equations(state.T_camera_lidar, state.scale)
        H_gg, g_g = H_gg + by_centres[:6, :6], g_g + toward_centres[:6]
    J_k = shared_columns(problem, state, free, points, d_pixels)
    if J_k is None:
        return NormalEquations(H_gg, H_gb, H_bb, g_g, g_b)
    q = J_k.shape[-1]
    grown, grown_g = np.zeros((6 + q, 6 + q)), np.zeros(6 + q)
    grown[:6, :6], grown_g[:6] = H_gg, g_g
    grown[6:, 6:] = np.einsum("mrk,mr,mrl->kl", J_k, weight, J_k)
    grown_g[6:] = np.einsum("mrk,mr,mr->k", J_k, weight, error)
    grown_b = np.zeros((boards, 6 + q, 9))
    grown_b[:, :6] = H_gb
    grown_b[:, 6:, :6] = np.swapaxes(J_k, 1, 2) @ WJ_b
    if free.scale:
        grown[-1, -1] += by_centres[6, 6] + 1.0 / free.scale_sigma**2
        grown[:6, -1] += by_centres[:6, 6]
        grown[-1, :6] += by_centres[:6, 6]
        grown_g[-1] += toward_centres[6] + (state.scale - 1.0) / free.scale_sigma**2
    return NormalEquations(grown, grown_b, H_bb, grown_g, g_b)


def corner_rows(problem: JointProblem, state: JointState) -> tuple[Array, Array, Array, Array]:
    """(M, 2N) errors over their sigma, (M, 2N, 6) derivatives by the boards' twists, points (M, N, 3) in the camera's
    frame and (M, N, 2, 3) derivatives of their pixels."""
    boards = len(problem.counts)
    points = _on_boards(problem, state)
    pixels, d_pixels = state.camera.project_with_jacobian(points)
    sigma = problem.corner_sigma[:, None, None]
    error = ((pixels - problem.corners) / sigma).reshape(boards, -1)
    J_b = np.concatenate([-d_pixels @ skew(points), d_pixels], axis=-1).reshape(boards, -1, 6)
    return error, J_b / sigma, points, d_pixels


def shared_columns(
    problem: JointProblem, state: JointState, free: Free, points: Array, d_pixels: Array
) -> Array | None:
    """(M, 2N, q) derivatives of all corners by what they share: intrinsics, then the board's scale."""
    boards, columns = len(problem.counts), []
    if free.intrinsics:
        count = 4 + len(state.camera.D)
        columns.append(state.camera.intrinsic_jacobian(points).reshape(boards, -1, count))
    if free.scale:
        arms = np.einsum("mab,nb->mna", state.T_camera_boards[:, :3, :3], problem.model)
        columns.append(np.einsum("mnij,mnj->mni", d_pixels, arms).reshape(boards, -1, 1))
    return np.concatenate(columns, axis=-1) / problem.corner_sigma[:, None, None] if columns else None


def _lidar_equations(problem: JointProblem, state: JointState) -> tuple[Array, Array, Array, Array, Array]:
    """H_gg (6, 6), g_g (6,), H_gb (M, 6, 9), H_bb (M, 9, 9), g_b (M, 9) of points and prior."""
    # A point tells of three numbers of its board, the shift along its normal and two tilts: q = (1, x, y).
    _, moments, pulls = _lidar_sums(problem, state)
    C = _board_columns(state)
    H_bb = C @ moments @ np.swapaxes(C, 1, 2)
    g_b = np.einsum("mki,mi->mk", C, pulls)
    H_gg, g_g, H_gb = H_bb[:, :6, :6].sum(axis=0), -g_b[:, :6].sum(axis=0), -H_bb[:, :6].copy()
    precision = _plane_precision(problem)
    H_bb[:, [6, 7, 8], [6, 7, 8]] += precision
    g_b[:, 6:] += precision * state.plane_errors
    return H_gg, g_g, H_gb, H_bb, g_b


def _board_columns(state: JointState) -> Array:
    """(M, 9, 3) what a board's nine numbers do to its points' distances, in terms of q = (1, x, y) on the board."""
    poses = state.T_camera_boards
    normals = poses[:, :3, 2]
    C = np.zeros((len(poses), 9, 3))
    # The extrinsics' twist moves the point, the board's own twist the board: the same with opposite signs.
    C[:, :3, 0] = -cross(poses[:, :3, 3], normals)
    C[:, :3, 1] = -cross(poses[:, :3, 0], normals)
    C[:, :3, 2] = -cross(poses[:, :3, 1], normals)
    C[:, 3:6, 0] = -normals
    C[:, 6, 1] = C[:, 7, 2] = C[:, 8, 0] = -1.0
    return C


def beam_columns(problem: JointProblem, state: JointState) -> tuple[Array, Array]:
    """(P, 2) places on the board where the rays meet it [m], and (P,) how much too far each range is [m]."""
    rows = _lidar_rows(problem, state)
    return rows.along, rows.distance / rows.slant * _facing(problem, state)


def board_moments(problem: JointProblem, state: JointState, beam: NDArray[np.int64], count: int) -> Array:
    """(M, 9, K) right-hand sides of the boards' normal equations for a unit range error of each beam [1/m]."""
    rows = _lidar_rows(problem, state)
    sigma = rows.slant * problem.noise.range_m
    weight = _huber_weight(rows.distance / sigma)
    pull = weight * _facing(problem, state) / problem.noise.range_m / sigma
    cell = problem.owner * count + beam
    size = len(problem.counts) * count
    q = np.column_stack([np.ones(len(sigma)), rows.along])
    moments = np.stack([np.bincount(cell, q[:, k] * pull, size) for k in range(3)], axis=-1)
    return np.asarray(np.einsum("mik,mbk->mib", _board_columns(state), moments.reshape(-1, count, 3)))


def _facing(problem: JointProblem, state: JointState) -> Array:
    """(P,) +1 where a board's normal points away from the LiDAR: a longer range is then a larger distance."""
    axes, _ = _boards_in_lidar(problem, state)
    return np.sign(np.einsum("pa,pa->p", problem.rays, axes[:, :, 2][problem.owner]))


def _plane_precision(problem: JointProblem) -> Array:
    """(3,) one over the variances of a plane's tilt, tilt and offset; floors keep "none" finite."""
    tilt, offset = problem.plane_sigma
    floor_rad, floor_m = REFINE.plane_sigma_floor_rad, REFINE.plane_sigma_floor_m
    return np.array([max(tilt, floor_rad), max(tilt, floor_rad), max(offset, floor_m)]) ** -2


def _on_boards(problem: JointProblem, state: JointState) -> Array:
    T = state.T_camera_boards
    return np.einsum("mab,nb->mna", T[:, :3, :3], state.scale * problem.model) + T[:, None, :3, 3]


def _huber(residual: Array) -> float:
    size = np.abs(residual)
    return float(
        np.sum(np.where(size <= REFINE.huber, 0.5 * size**2, REFINE.huber * size - 0.5 * REFINE.huber**2))
    )


def _huber_weight(residual: Array) -> Array:
    return np.minimum(1.0, REFINE.huber / np.maximum(np.abs(residual), 1e-300))
