"""Which place in each cloud is the board? The one that agrees with the other pairs.

Two boards fix the whole transform when their centres and normals are known in both sensors. Every two
candidates of two different pairs that fit each other (distance, angle) propose a transform; the one
that explains most pairs wins. Pairs that it does not explain are left to be searched again or refused.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.boards.rotations import nearest_rotation, rigid
from stereocalib_core.config.boards_search import CONSENSUS
from stereocalib_core.numeric.arrays import Array

FORWARD_LEFT_UP = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
"""Rotation of a LiDAR with x forward, z up into a camera that looks along it: assumed where nothing else says."""


@dataclass(frozen=True)
class Candidates:
    """All candidates of all pairs, flat. pair: (F,) index of the pair; score: (F,) 0...1.

    cloud: (F,) index of the cloud where that is in question; one cloud is then one picture's.

    centers_*, normals_*: (F, 3), the board in the camera (repeated) and each place in the cloud.
    """

    pair: NDArray[np.int64]
    centers_camera: Array
    normals_camera: Array
    centers_lidar: Array
    normals_lidar: Array
    score: Array
    cloud: NDArray[np.int64] | None = None


@dataclass(frozen=True)
class Agreement:
    """The transform most pairs agree on, and the candidate chosen for each pair (-1 = none fits)."""

    T_camera_lidar: Array
    chosen: NDArray[np.int64]


def agree(candidates: Candidates, pairs: int, tolerance_m: float) -> Agreement | None:
    """The best common transform; `tolerance_m` is how far a board's centre may be off. None without candidates."""
    if len(candidates.pair) == 0:
        return None
    first, second = _fitting_couples(candidates, tolerance_m)
    if len(first) == 0:
        return _from_one_board(candidates, pairs)
    proposals = _transforms(candidates, first, second)
    support = _support(candidates, proposals, pairs, tolerance_m)[0]
    # Sensors of one rig rarely sit farther apart than this; it only decides between equals.
    reach = np.linalg.norm(proposals[:, :3, 3], axis=1)
    T = proposals[
        int(
            np.argmax(
                support
                - CONSENSUS.baseline_penalty * np.maximum(0.0, reach / CONSENSUS.usual_baseline_m - 1.0)
            )
        )
    ]
    for tightening in CONSENSUS.tightening:
        _, best = _support(candidates, T[None], pairs, tolerance_m * tightening)
        chosen = best[0]
        members = chosen[chosen >= 0]
        if len(members) < 2:
            break
        T = _kabsch(candidates, members)
    return Agreement(T, _support(candidates, T[None], pairs, tolerance_m)[1][0])


def _fitting_couples(c: Candidates, tolerance_m: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Indices (P,), (P,) of candidates of different pairs whose mutual geometry is the same in both sensors."""
    i, j = np.triu_indices(len(c.pair), 1)
    different = c.pair[i] != c.pair[j]
    if c.cloud is not None:
        different &= c.cloud[i] != c.cloud[j]
    i, j = i[different], j[different]
    step_c, step_l = c.centers_camera[j] - c.centers_camera[i], c.centers_lidar[j] - c.centers_lidar[i]
    fits = np.abs(np.linalg.norm(step_c, axis=1) - np.linalg.norm(step_l, axis=1)) < tolerance_m
    for k in (i, j):
        along_c = np.sum(c.normals_camera[k] * step_c, axis=1)
        along_l = np.sum(c.normals_lidar[k] * step_l, axis=1)
        fits &= np.abs(along_c - along_l) < tolerance_m
    cosine_c = np.sum(c.normals_camera[i] * c.normals_camera[j], axis=1)
    cosine_l = np.sum(c.normals_lidar[i] * c.normals_lidar[j], axis=1)
    fits &= (
        np.abs(np.arccos(np.clip(cosine_c, -1, 1)) - np.arccos(np.clip(cosine_l, -1, 1)))
        < CONSENSUS.most_turn_rad
    )
    i, j = i[fits], j[fits]
    if len(i) > CONSENSUS.most_proposals:
        keep = np.argsort(-(c.score[i] + c.score[j]), kind="stable")[: CONSENSUS.most_proposals]
        i, j = i[keep], j[keep]
    return i, j


def _transforms(c: Candidates, i: NDArray[np.int64], j: NDArray[np.int64]) -> Array:
    """(P, 4, 4) T_camera_lidar from two boards each: their centres and the tips of their normals."""
    from_points = np.stack([c.centers_lidar[i], c.centers_lidar[j]], axis=1)
    to_points = np.stack([c.centers_camera[i], c.centers_camera[j]], axis=1)
    middle_from, middle_to = from_points.mean(axis=1), to_points.mean(axis=1)
    M = np.einsum("pka,pkb->pab", to_points - middle_to[:, None], from_points - middle_from[:, None])
    for k in (i, j):
        M = M + np.einsum("pa,pb->pab", c.normals_camera[k], c.normals_lidar[k])
    R = nearest_rotation(M)
    return rigid(R, middle_to - np.einsum("pab,pb->pa", R, middle_from))


def _kabsch(c: Candidates, members: NDArray[np.int64]) -> Array:
    """(4, 4) from all chosen boards' centres and normals."""
    start, end = c.centers_lidar[members], c.centers_camera[members]
    M = (end - end.mean(axis=0)).T @ (start - start.mean(axis=0)) + c.normals_camera[
        members
    ].T @ c.normals_lidar[members]
    R = nearest_rotation(M)
    return rigid(R, end.mean(axis=0) - R @ start.mean(axis=0))


def _support(c: Candidates, T: Array, pairs: int, tolerance_m: float) -> tuple[Array, NDArray[np.int64]]:
    """(P,) summed agreement of P transforms and (P, pairs) the best candidate of each pair, -1 = none."""
    moved = np.einsum("pab,fb->pfa", T[:, :3, :3], c.centers_lidar) + T[:, None, :3, 3]
    turned = np.einsum("pab,fb->pfa", T[:, :3, :3], c.normals_lidar)
    offset = np.linalg.norm(moved - c.centers_camera, axis=2) / tolerance_m
    cosine = np.sum(turned * c.normals_camera, axis=2)
    angle = np.arccos(np.clip(cosine, -1.0, 1.0)) / CONSENSUS.most_turn_rad
    gain = np.where((offset < 1) & (angle < 1), c.score * (1.5 - 0.5 * offset**2 - 0.5 * angle**2), 0.0)
    value, best = np.zeros((len(T), pairs)), np.full((len(T), pairs), -1, dtype=np.int64)
    for pair in range(pairs):
        members = np.flatnonzero(c.pair == pair)
        if len(members):
            top = np.argmax(gain[:, members], axis=1)
            value[:, pair] = gain[np.arange(len(T)), members[top]]
            best[:, pair] = np.where(value[:, pair] > 0, members[top], -1)
    return value.sum(axis=1), best


def _from_one_board(c: Candidates, pairs: int) -> Agreement:
    """No two candidates fit each other: trust the best single one, and the usual axes for what it leaves open."""
    best = int(np.argmax(c.score))
    turned = FORWARD_LEFT_UP @ c.normals_lidar[best]
    axis = np.cross(turned, c.normals_camera[best])
    cosine = float(turned @ c.normals_camera[best])
    K = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    align = np.eye(3) + K + K @ K / (1 + cosine) if cosine > -0.99 else np.diag([-1.0, 1.0, -1.0])
    R = nearest_rotation(align @ FORWARD_LEFT_UP)
    T = rigid(R, c.centers_camera[best] - R @ c.centers_lidar[best])
    chosen = np.full(pairs, -1, dtype=np.int64)
    chosen[c.pair[best]] = best
    return Agreement(T, chosen)
