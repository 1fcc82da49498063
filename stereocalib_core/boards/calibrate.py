"""From observations to a calibration: agree, solve, refuse wrong pairs, refine, check. Touches no file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.boards.baselines import points_on_plane, unnikrishnan_hebert
from stereocalib_core.boards.calibration import Calibration, HeldOut, PairResult
from stereocalib_core.boards.camera import BoardCamera
from stereocalib_core.boards.consensus import FORWARD_LEFT_UP, Candidates, agree
from stereocalib_core.boards.observability import (
    EDGE_ON,
    Observability,
    edge_on_words,
    is_edge_on,
    observability,
)
from stereocalib_core.boards.observation import BoardSpec, PairObservation, PlaneEstimate
from stereocalib_core.boards.refine import (
    JointProblem,
    JointState,
    Noise,
    Refined,
    corner_errors,
    plane_errors,
    refine,
)
from stereocalib_core.boards.rotations import angle_between, rigid
from stereocalib_core.boards.solve import (
    PlanePairs,
    dual_space,
    in_plane_offset,
    mismatch,
    mismatch_covariance,
    split_covariance,
    weighted,
    weights_of,
)
from stereocalib_core.boards.wrong_pairs import leave_one_out, wrong_pairs
from stereocalib_core.config.boards import CONSENSUS, OBSERVABILITY, PLANE, REFINE
from stereocalib_core.errors import SourceError
from stereocalib_core.geometry import invert_transform
from stereocalib_core.numeric.arrays import Array


def calibrate(
    observations: Sequence[PairObservation],
    board: BoardSpec,
    camera: BoardCamera,
    mask: Sequence[bool] | None = None,
    noise: Noise | None = None,
    with_intrinsics: bool = False,
) -> Calibration:
    """Solve for T_camera_lidar from the observations that are ok and, if given, ticked in `mask`.

    Quick enough to be called at every tick (tens of milliseconds for 20 pairs). `noise` None takes the sensors'
    sigmas from the data. Wrong pairs are refused and named; a set that cannot fix all six numbers gives a
    "degenerate" verdict, not an error. Raises SourceError when no pair shows a board to both sensors.
    """
    ticked = [True] * len(observations) if mask is None else [bool(m) for m in mask]
    refused = {o.name: o.reason for o in observations if not o.ok}
    refused |= {o.name: "left out" for o, on in zip(observations, ticked, strict=True) if o.ok and not on}
    usable = [o for o, on in zip(observations, ticked, strict=True) if o.ok and on]
    through = {o.name: sensor for o in usable if (sensor := _edge_on_sensor(o))}
    refused |= {name: edge_on_words(sensor) for name, sensor in through.items()}
    usable = [o for o in usable if o.name not in through]
    edge_on = tuple(through) + tuple(
        o.name for o in observations if not o.ok and o.reason.startswith(EDGE_ON)
    )
    if not usable and not edge_on:
        why = "; ".join(f"{name}: {reason}" for name, reason in list(refused.items())[:3])
        raise SourceError(
            "no pair shows the board to both sensors", why or "no pairs", "see the reason of each pair"
        )
    if not usable:
        return _nothing(observations, camera, refused, edge_on)
    noise = noise or estimate_noise(usable)
    kept, start = _agreeing(usable, board, refused)
    pairs = _plane_pairs(kept)
    prior = start if _open(pairs) else None
    # Where the planes leave a direction open, they cannot judge each other: agreement of the centres must do.
    wrong = {} if prior is not None else wrong_pairs(pairs, _dual_space(pairs, None), board.short_side_m)
    refused |= {kept[i].name: reason for i, reason in wrong.items()}
    kept = [o for i, o in enumerate(kept) if i not in wrong]
    return _finish(observations, kept, board, camera, noise, refused, edge_on, start, with_intrinsics)


def estimate_noise(observations: Sequence[PairObservation]) -> Noise:
    """The sensors' sigmas from how well single pictures and single clouds fit their own board (medians)."""
    corner = [
        o.corner_rms_px * np.sqrt(len(o.corners) / (2 * len(o.corners) - 6))
        for o in observations
        if o.corners is not None
    ]
    spans = []
    for o in observations:
        if o.lidar_plane is not None and len(o.points_lidar):
            rays = o.points_lidar / np.linalg.norm(o.points_lidar, axis=1, keepdims=True)
            slant = np.maximum(np.abs(rays @ o.lidar_plane.plane.normal), PLANE.slant_floor)
            spans.append(
                float(np.sqrt(np.mean((o.lidar_plane.plane.signed_distance(o.points_lidar) / slant) ** 2)))
            )
    return Noise(
        max(float(np.median(corner)) if corner else 0.0, REFINE.least_corner_sigma_px),
        max(float(np.median(spans)) if spans else 0.0, REFINE.least_range_sigma_m),
    )


def _edge_on_sensor(o: PairObservation) -> str:
    """The sensor through whose origin the board's plane passes, or nothing."""
    if o.lidar_plane is not None and is_edge_on(o.lidar_plane.incidence):
        return "LiDAR"
    if o.camera_plane is not None and is_edge_on(o.camera_plane.incidence):
        return "camera"
    return ""


def _camera_planes(observations: Sequence[PairObservation]) -> list[PlaneEstimate]:
    return [o.camera_plane for o in observations if o.camera_plane is not None]


def _lidar_planes(observations: Sequence[PairObservation]) -> list[PlaneEstimate]:
    return [o.lidar_plane for o in observations if o.lidar_plane is not None]


def _plane_pairs(observations: Sequence[PairObservation]) -> PlanePairs:
    return PlanePairs.of(_camera_planes(observations), _lidar_planes(observations))


def _agreeing(
    usable: list[PairObservation], board: BoardSpec, refused: dict[str, str]
) -> tuple[list[PairObservation], Array]:
    """The pairs that share one transform, and a rough one from their centres; the others are refused by name."""
    p = _plane_pairs(usable)
    candidates = Candidates(
        np.arange(len(p)),
        p.centers_camera,
        p.normals_camera,
        p.centers_lidar,
        p.normals_lidar,
        np.ones(len(p)),
    )
    agreement = agree(candidates, len(p), CONSENSUS.solution_share * board.short_side_m)
    assert agreement is not None, "there is at least one candidate"
    T = agreement.T_camera_lidar
    kept = [o for o, chosen in zip(usable, agreement.chosen, strict=True) if chosen >= 0]
    turned = np.rad2deg(angle_between(p.normals_lidar @ T[:3, :3].T, p.normals_camera))
    shifted = np.linalg.norm(p.centers_lidar @ T[:3, :3].T + T[:3, 3] - p.centers_camera, axis=1)
    for i, chosen in enumerate(agreement.chosen):
        if chosen < 0:
            refused[usable[i].name] = _wrong_words(i, usable, p, T, float(shifted[i]), float(turned[i]))
    return kept, T


def _wrong_words(
    i: int, usable: list[PairObservation], p: PlanePairs, T: Array, shifted_m: float, turned_deg: float
) -> str:
    """Why a pair is wrong, and whose picture its cloud fits, when it fits one."""
    place = T[:3, :3] @ p.centers_lidar[i] + T[:3, 3]
    near = np.linalg.norm(p.centers_camera - place, axis=1)
    turned = angle_between(p.normals_camera, T[:3, :3] @ p.normals_lidar[i])
    near = np.where((turned < CONSENSUS.fits_turn_rad) & (np.arange(len(near)) != i), near, np.inf)
    other = int(np.argmin(near))
    hint = f"; it fits the picture of {usable[other].name}" if near[other] < CONSENSUS.fits_near_m else ""
    return (
        f"wrong pair: the cloud has the board {shifted_m:.2f} m and {turned_deg:.0f} deg from where the "
        f"picture shows it{hint}"
    )


def _open(pairs: PlanePairs) -> bool:
    """Whether the planes alone leave some direction open."""
    values = np.linalg.svd(np.vstack([pairs.normals_camera, np.zeros((3, 3))]), compute_uv=False)
    return bool(len(pairs) < 3 or values[2] < OBSERVABILITY.degenerate * np.sqrt(len(pairs)))


def _dual_space(pairs: PlanePairs, prior: Array | None) -> Array:
    return dual_space(
        pairs.normals_camera, pairs.offsets_camera, pairs.normals_lidar, pairs.offsets_lidar, prior
    )


def _finish(
    observations: Sequence[PairObservation],
    kept: list[PairObservation],
    board: BoardSpec,
    camera: BoardCamera,
    noise: Noise,
    refused: dict[str, str],
    edge_on: tuple[str, ...],
    start: Array,
    with_intrinsics: bool,
) -> Calibration:
    """Solve, refine and check with the pairs that are left."""
    pairs = _plane_pairs(kept)
    left_open = _open(pairs)
    linear = _dual_space(pairs, start if left_open else None)
    better = linear if left_open else weighted(pairs, linear)[0]
    problem = joint_problem(kept, board, camera, noise)
    boards = np.array([o.T_camera_board for o in kept])
    refined = refine(
        problem, JointState(better, boards, camera), with_intrinsics and not left_open, fixed=left_open
    )
    state = refined.state
    scatter = _scatter(pairs, state.T_camera_lidar)
    covariance = split_covariance(refined.covariance * scatter, state.T_camera_lidar)
    verdict = observability(pairs.normals_camera, covariance, edge_on)
    results, plane_rms, corner_rms = _pair_results(observations, kept, pairs, problem, state, refused)
    return Calibration(
        state.T_camera_lidar, covariance, linear,
        unnikrishnan_hebert(pairs.normals_camera, pairs.offsets_camera, pairs.normals_lidar, pairs.offsets_lidar),
        points_on_plane([o.points_lidar for o in kept], pairs.normals_camera, pairs.offsets_camera),
        results, verdict, refined.iterations, _held_out(pairs, problem, refined), plane_rms, corner_rms,
        noise, scatter, state.camera, refined.intrinsic_sigma,
    )  # fmt: skip


def joint_problem(
    kept: Sequence[PairObservation], board: BoardSpec, camera: BoardCamera, noise: Noise
) -> JointProblem:
    """The measurements of these pairs for `refine`; very dense boards are thinned evenly."""
    clouds = [_thinned(o.points_lidar) for o in kept]
    corners = [o.corners for o in kept if o.corners is not None]
    counts = np.array([len(c) for c in clouds], dtype=np.int64)
    return JointProblem(camera, np.array(corners), board.corners_board, np.concatenate(clouds), counts, noise)


def _thinned(points: Array) -> Array:
    if len(points) <= REFINE.most_points:
        return points
    return points[np.sort(np.random.default_rng(0).choice(len(points), REFINE.most_points, replace=False))]


def _scatter(pairs: PlanePairs, T: Array) -> float:
    """Variance factor of the plane mismatches over what their covariances say; 1 unless clearly above."""
    freedom = 3 * len(pairs) - 6
    if freedom < 3:
        return 1.0
    z, _ = mismatch(pairs, T)
    W = weights_of(mismatch_covariance(pairs, T))
    factor = float(np.einsum("ma,mab,mb->", z, W, z)) / freedom
    return factor if factor > 1.0 + 2.0 * np.sqrt(2.0 / freedom) else 1.0


def _held_out(pairs: PlanePairs, problem: JointProblem, refined: Refined) -> HeldOut:
    """Each pair under the transform of the others."""
    if len(pairs) < 4:
        return HeldOut(float("nan"), float("nan"))
    T = refined.state.T_camera_lidar
    others = leave_one_out(pairs, T)[0]
    # Points moved so that the common transform does to them what their own one would: one system for all.
    own = np.repeat(invert_transform(T) @ others, problem.counts, axis=0)
    points = np.einsum("pab,pb->pa", own[:, :3, :3], problem.points) + own[:, :3, 3]
    in_camera = points @ T[:3, :3].T + T[:3, 3]
    normals = np.repeat(pairs.normals_camera, problem.counts, axis=0)
    distance = np.sum(in_camera * normals, axis=1) - np.repeat(pairs.offsets_camera, problem.counts)
    moved = replace(problem, points=points)
    corners = corner_errors(moved, refine(moved, refined.state, fixed=True).state)
    return HeldOut(float(np.sqrt(np.mean(distance**2))), float(np.sqrt(np.mean(np.sum(corners**2, axis=-1)))))


def _pair_results(
    observations: Sequence[PairObservation],
    kept: list[PairObservation],
    pairs: PlanePairs,
    problem: JointProblem,
    state: JointState,
    refused: dict[str, str],
) -> tuple[tuple[PairResult, ...], float, float]:
    T = state.T_camera_lidar
    distance, _ = plane_errors(problem, state)
    corner = np.sum(corner_errors(problem, state) ** 2, axis=-1)
    owner = np.repeat(np.arange(len(kept)), problem.counts)
    plane_rms = np.sqrt(np.bincount(owner, distance**2, len(kept)) / problem.counts)
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
            results.append(_refused_result(o, refused.get(o.name, ""), T))
    return tuple(results), float(np.sqrt(np.mean(distance**2))), float(np.sqrt(corner.mean()))


def _against(pair: PlanePairs, T: Array) -> tuple[float, float, float]:
    """Angle [deg], offset [m] and in-plane distance [m] of one board between the sensors."""
    angle = np.rad2deg(angle_between(pair.normals_lidar @ T[:3, :3].T, pair.normals_camera))
    return float(angle[0]), float(abs(mismatch(pair, T)[0][0, 2])), float(in_plane_offset(pair, T)[0])


def _refused_result(o: PairObservation, reason: str, T: Array) -> PairResult:
    """A refused pair still shows how far off it is, when both sensors saw a board."""
    if o.camera_plane is None or o.lidar_plane is None:
        return PairResult(o.name, "rejected", reason, reprojection_rms_px=o.corner_rms_px)
    pair = _plane_pairs([o])
    angle, offset, aside = _against(pair, T)
    distance = o.camera_plane.plane.signed_distance(o.points_lidar @ T[:3, :3].T + T[:3, 3])
    rms = float(np.sqrt(np.mean(distance**2))) if len(distance) else float("nan")
    return PairResult(
        o.name, "rejected", reason, rms, o.corner_rms_px, angle, offset, aside, o.T_camera_board
    )


def _nothing(
    observations: Sequence[PairObservation],
    camera: BoardCamera,
    refused: dict[str, str],
    edge_on: tuple[str, ...],
) -> Calibration:
    """The degenerate result of a set of which no board can be used."""
    T = rigid(FORWARD_LEFT_UP, np.zeros(3))
    nan = float("nan")
    verdict: Observability = observability(np.zeros((0, 3)), np.zeros((6, 6)), edge_on)
    results = tuple(_refused_result(o, refused.get(o.name, ""), T) for o in observations)
    return Calibration(
        T, np.eye(6), T, T, T, results, verdict, (), HeldOut(nan, nan), nan, nan,
        Noise(REFINE.least_corner_sigma_px, REFINE.least_range_sigma_m), 1.0, camera,
    )  # fmt: skip


def ticked_mask(observations: Sequence[PairObservation], exclude: Sequence[str]) -> NDArray[np.bool_]:
    """(M,) bool for `calibrate`: every pair but those named."""
    return np.array([o.name not in exclude for o in observations], dtype=bool)
