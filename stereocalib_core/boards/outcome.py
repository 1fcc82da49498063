"""What became of every pair: its residuals under the result, under the other pairs' result, or why it was refused."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from stereocalib_core.boards.calibration import HeldOut, PairResult
from stereocalib_core.boards.joint import Free, JointProblem, JointState, corner_errors, plane_distances
from stereocalib_core.boards.observation import PairObservation
from stereocalib_core.boards.refine import refine
from stereocalib_core.boards.rotations import angle_between
from stereocalib_core.boards.solve import PlanePairs, in_plane_offset, mismatch
from stereocalib_core.boards.wrong_pairs import leave_one_out
from stereocalib_core.geometry import invert_transform
from stereocalib_core.numeric.arrays import Array


def held_out(pairs: PlanePairs, problem: JointProblem, state: JointState) -> HeldOut:
    """Each pair under the transform of the others; `pairs` in the scale of `state`."""
    if len(pairs) < 4:
        return HeldOut(float("nan"), float("nan"))
    T = state.T_camera_lidar
    others = leave_one_out(pairs, T)[0]
    # Points moved so that the common transform does to them what their own one would: one system for all.
    own = np.repeat(invert_transform(T) @ others, problem.counts, axis=0)
    points = np.einsum("pab,pb->pa", own[:, :3, :3], problem.points) + own[:, :3, 3]
    in_camera = points @ T[:3, :3].T + T[:3, 3]
    normals = pairs.normals_camera[problem.owner]
    distance = np.sum(in_camera * normals, axis=1) - pairs.offsets_camera[problem.owner]
    moved = replace(problem, points=points)
    start = replace(state, plane_errors=np.zeros((len(pairs), 3)))
    corners = corner_errors(moved, refine(moved, start, Free(extrinsics=False)).state)
    return HeldOut(float(np.sqrt(np.mean(distance**2))), float(np.sqrt(np.mean(np.sum(corners**2, axis=-1)))))


def pair_results(
    observations: Sequence[PairObservation],
    kept: Sequence[PairObservation],
    pairs: PlanePairs,
    problem: JointProblem,
    state: JointState,
    refused: dict[str, str],
) -> tuple[tuple[PairResult, ...], float, float]:
    """Every pair's result, and the rms over all points [m] and corners [px]; `pairs` in the scale of `state`."""
    T = state.T_camera_lidar
    distance, _ = plane_distances(problem, state)
    corner = np.sum(corner_errors(problem, state) ** 2, axis=-1)
    plane_rms = np.sqrt(np.bincount(problem.owner, distance**2, len(kept)) / problem.counts)
    index = {o.name: i for i, o in enumerate(kept)}
    results = []
    for o in observations:
        if o.name in index:
            i = index[o.name]
            angle, offset, aside = _against(pairs.select(np.array([i])), T)
            rms = float(np.sqrt(corner[i].mean()))
            pose = state.T_camera_boards[i]
            results.append(PairResult(o.name, "ok", "", float(plane_rms[i]), rms, angle, offset, aside, pose))
        else:
            results.append(refused_result(o, refused.get(o.name, ""), T))
    return tuple(results), float(np.sqrt(np.mean(distance**2))), float(np.sqrt(corner.mean()))


def _against(pair: PlanePairs, T: Array) -> tuple[float, float, float]:
    """Angle [deg], offset [m] and in-plane distance [m] of one board between the sensors."""
    angle = np.rad2deg(angle_between(pair.normals_lidar @ T[:3, :3].T, pair.normals_camera))
    return float(angle[0]), float(abs(mismatch(pair, T)[0][0, 2])), float(in_plane_offset(pair, T)[0])


def refused_result(o: PairObservation, reason: str, T: Array) -> PairResult:
    """A refused pair still shows how far off it is, when both sensors saw a board."""
    if o.camera_plane is None or o.lidar_plane is None:
        return PairResult(o.name, "rejected", reason, reprojection_rms_px=o.corner_rms_px)
    pair = PlanePairs.of([o.camera_plane], [o.lidar_plane])
    angle, offset, aside = _against(pair, T)
    distance = o.camera_plane.plane.signed_distance(o.points_lidar @ T[:3, :3].T + T[:3, 3])
    rms = float(np.sqrt(np.mean(distance**2))) if len(distance) else float("nan")
    return PairResult(
        o.name, "rejected", reason, rms, o.corner_rms_px, angle, offset, aside, o.T_camera_board
    )
