"""How far LiDAR planes as a whole are off: restricted maximum likelihood (Patterson and Thompson 1971).

Points of one board share errors that no number of points removes: a beam's own range error, the reflectance of the
squares, a bent board, a hand that moved. Seen from outside it is a tilt and an offset of the whole plane, drawn anew
for every board. Their variances are those that make the boards' mismatches as likely as can be, with the transform
(and the board's scale) left free.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stereocalib_core.boards.planes import tangent_basis
from stereocalib_core.boards.rotations import apply_twist
from stereocalib_core.boards.solve import PlanePairs, mismatch, mismatch_covariance
from stereocalib_core.config.boards import VARIANCE
from stereocalib_core.numeric.arrays import Array

SCALE_IS_STATED = 1e-9
"""Sigma of a scale that is not to move."""


def with_plane_errors(pairs: PlanePairs, tilt_rad: float, offset_m: float) -> PlanePairs:
    """The same planes, each LiDAR plane less certain by a tilt about its board's centre and by an offset."""
    basis = tangent_basis(pairs.normals_lidar)
    J = np.zeros((len(pairs), 4, 3))
    J[:, :3, :2] = np.swapaxes(basis, 1, 2)
    J[:, 3, :2] = np.einsum("mka,ma->mk", basis, pairs.centers_lidar)
    J[:, 3, 2] = 1.0
    added = J @ np.diag([tilt_rad**2, tilt_rad**2, offset_m**2]) @ np.swapaxes(J, 1, 2)
    return replace(pairs, covariances_lidar=pairs.covariances_lidar + added)


def with_scale(pairs: PlanePairs, scale: float) -> PlanePairs:
    """The same boards, when a board is `scale` times as large as stated: the camera sees it so much farther away."""
    return replace(
        pairs, offsets_camera=pairs.offsets_camera * scale, centers_camera=pairs.centers_camera * scale
    )


def solve_with_scale(
    pairs: PlanePairs, start: Array, scale_sigma: float, scale: float = 1.0
) -> tuple[Array, float, float]:
    """T_camera_lidar (4, 4), the board's size over the stated one, and its sigma; Gauss-Newton on `mismatch`."""
    T, H = start, np.eye(7)
    for _ in range(VARIANCE.solve_rounds):
        scaled = with_scale(pairs, scale)
        z, J, V = _system(scaled, T, scale)
        JW = np.swapaxes(J, 1, 2) @ np.linalg.inv(V)
        H, g = (JW @ J).sum(axis=0), np.einsum("mka,ma->k", JW, z)
        H[6, 6] += scale_sigma**-2
        g[6] += (scale - 1.0) * scale_sigma**-2
        step = -np.linalg.solve(H, g)
        T, scale = apply_twist(step[:6], T), scale + float(step[6])
    return T, scale, float(np.sqrt(np.linalg.inv(H)[6, 6]))


def plane_sigmas(
    pairs: PlanePairs, T_camera_lidar: Array, scale: float = 1.0, shared: Array | None = None
) -> tuple[float, float]:
    """Standard deviations of a whole plane's tilt [rad] and offset [m] beyond what `pairs` say; (0, 0) for few boards.

    shared: (3 M, 3 M) covariance of what the boards' mismatches are known to have in common, or None.
    Fisher scoring on the restricted likelihood from moments; a variance that would turn negative is none.
    """
    if len(pairs) < VARIANCE.least_boards:
        return 0.0, 0.0
    count = 3 * len(pairs)
    T = T_camera_lidar
    kinds = np.tile([0, 0, 1], len(pairs))
    variances = np.array([VARIANCE.first_tilt_rad**2, VARIANCE.first_offset_m**2])
    for _ in range(VARIANCE.rounds):
        T, scale, _ = solve_with_scale(
            with_plane_errors(pairs, *np.sqrt(variances)), T, VARIANCE.loose_scale_sigma, scale
        )
        z, J, V = _system(with_scale(pairs, scale), T, scale)
        total = block_diagonal(V) + np.diag(variances[kinds])
        if shared is not None:
            total += shared
        W = np.linalg.inv(total)
        A = J.reshape(count, -1)
        P = W - W @ A @ np.linalg.solve(
            A.T @ W @ A + np.diag([0.0] * 6 + [VARIANCE.loose_scale_sigma**-2]), A.T @ W
        )
        Pz = P @ z.reshape(-1)
        score, information = np.zeros(2), np.zeros((2, 2))
        for a in (0, 1):
            mine = kinds == a
            score[a] = 0.5 * (np.sum(Pz[mine] ** 2) - np.trace(P[np.ix_(mine, mine)]))
            for b in (0, 1):
                other = kinds == b
                information[a, b] = 0.5 * np.sum(P[np.ix_(mine, other)] ** 2)
        step = np.linalg.solve(information, score)
        moved = np.maximum(variances + step, 0.0)
        settled = np.all(
            np.abs(np.sqrt(moved) - np.sqrt(variances)) <= VARIANCE.settled * np.sqrt(moved + 1e-16)
        )
        variances = moved
        if settled:
            break
    return float(np.sqrt(variances[0])), float(np.sqrt(variances[1]))


def block_diagonal(blocks: Array) -> Array:
    """(M, 3, 3) to (3 M, 3 M)."""
    count = len(blocks)
    total = np.zeros((count, 3, count, 3))
    total[np.arange(count), :, np.arange(count)] = blocks
    return total.reshape(3 * count, 3 * count)


def _system(scaled: PlanePairs, T: Array, scale: float) -> tuple[Array, Array, Array]:
    """Mismatches (M, 3), derivatives (M, 3, 7) by a left twist and the scale, covariances (M, 3, 3)."""
    z, J = mismatch(scaled, T)
    by_scale = np.zeros((len(scaled), 3, 1))
    by_scale[:, 2, 0] = -scaled.offsets_camera / scale
    V = mismatch_covariance(scaled, T) + np.diag([1e-12, 1e-12, 1e-12])
    return z, np.concatenate([J, by_scale], axis=2), V
