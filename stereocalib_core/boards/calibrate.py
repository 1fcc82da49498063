"""From observations to a calibration: agree, solve, refuse wrong pairs, refine, check. Touches no file."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.boards.baselines import points_on_plane, unnikrishnan_hebert
from stereocalib_core.boards.beams import Beams, find_beams
from stereocalib_core.boards.between_pictures import weighed_by_lens
from stereocalib_core.boards.calibration import Calibration, HeldOut
from stereocalib_core.boards.camera import BoardCamera
from stereocalib_core.boards.centres import Centres
from stereocalib_core.boards.chessboard import posed_again
from stereocalib_core.boards.consensus import FORWARD_LEFT_UP, Candidates, agree
from stereocalib_core.boards.joint import Free, JointProblem, JointState, Noise
from stereocalib_core.boards.noise import estimate_noise, joint_problem
from stereocalib_core.boards.observability import (
    EDGE_ON,
    Observability,
    edge_on_words,
    is_edge_on,
    leave_open,
    observability,
    too_uncertain,
)
from stereocalib_core.boards.observation import BoardSpec, PairObservation, PlaneEstimate
from stereocalib_core.boards.outcome import held_out, pair_results, refused_result
from stereocalib_core.boards.refine import Refined, refine
from stereocalib_core.boards.rotations import angle_between, rigid
from stereocalib_core.boards.second_opinion import (
    BoardScale,
    Doubt,
    Solved,
    covariance_with_doubt,
    second_opinion,
)
from stereocalib_core.boards.solve import (
    PlanePairs,
    covariance_of,
    dual_space,
    mismatch,
    mismatch_covariance,
    split_covariance,
    weighted,
)
from stereocalib_core.boards.variance_components import (
    SCALE_IS_STATED,
    block_diagonal,
    plane_sigmas,
    solve_with_scale,
    with_plane_errors,
    with_scale,
)
from stereocalib_core.boards.wrong_pairs import wrong_pairs
from stereocalib_core.config.boards import REFINE, VARIANCE
from stereocalib_core.config.boards_search import CONSENSUS
from stereocalib_core.errors import SourceError
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
    prior = start if leave_open(pairs.normals_camera) else None
    # Where the planes leave a direction open, they cannot judge each other: agreement of the centres must do.
    wrong = {} if prior is not None else wrong_pairs(pairs, _dual_space(pairs, None), board.short_side_m)
    refused |= {kept[i].name: reason for i, reason in wrong.items()}
    kept = [o for i, o in enumerate(kept) if i not in wrong]
    return _finish(observations, kept, board, camera, noise, refused, edge_on, start, with_intrinsics)


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
    narrow = leave_open(pairs.normals_camera)
    linear = _dual_space(pairs, start if narrow else None)
    left_open = narrow and _lost(pairs, linear)
    doubt: Doubt | None = None
    beams: Beams | None = None
    if left_open:
        scale = BoardScale(1.0, float("nan"))
        problem = joint_problem(kept, board, camera, noise)
        boards = np.array([o.T_camera_board for o in kept])
        refined = refine(problem, JointState(linear, boards, camera), Free(extrinsics=False))
        # What beams and ruler leave open counts here most of all: these boards hardly see a direction.
        beams = _beams_of(kept, board, camera, noise, pairs, linear)
    else:
        problem, refined, scale, beams = _joint(kept, board, camera, noise, linear, with_intrinsics, narrow)
        if with_intrinsics:
            # Planes and their noise again, as the better camera sees them.
            kept = [posed_again(o, refined.state.camera, board) for o in kept]
            pairs = _plane_pairs(kept)
            problem, refined, scale, beams = _joint(
                kept,
                board,
                refined.state.camera,
                noise,
                refined.state.T_camera_lidar,
                with_intrinsics,
                narrow,
            )
            problem, refined = weighed_by_lens(problem, refined)
        doubt = second_opinion(problem, refined)
    state = refined.state
    uncertain = with_scale(with_plane_errors(pairs, *problem.plane_sigma), state.scale)
    scatter = _scatter(uncertain, state.T_camera_lidar, None if beams is None else beams.shared)
    solved = Solved(problem, refined, 1.0 if left_open else scatter, doubt, beams)
    covariance = covariance_with_doubt(solved)
    verdict = observability(pairs.normals_camera, covariance, edge_on, left_open)
    results, plane_rms, corner_rms = pair_results(observations, kept, uncertain, problem, state, refused)
    return Calibration(
        state.T_camera_lidar, covariance, linear,
        unnikrishnan_hebert(pairs.normals_camera, pairs.offsets_camera, pairs.normals_lidar, pairs.offsets_lidar),
        points_on_plane([o.points_lidar for o in kept], pairs.normals_camera, pairs.offsets_camera),
        results, verdict, refined.iterations, held_out(uncertain, problem, state), plane_rms, corner_rms,
        noise, scatter, state.camera, refined.intrinsic_sigma, scale, doubt, solved,
    )  # fmt: skip


def _lost(pairs: PlanePairs, T_camera_lidar: Array) -> bool:
    """Whether planes that are a little off as a whole leave some direction so uncertain that it counts as not seen."""
    usual = with_plane_errors(pairs, VARIANCE.first_tilt_rad, VARIANCE.first_offset_m)
    return too_uncertain(split_covariance(covariance_of(weighted(usual, T_camera_lidar)[1]), T_camera_lidar))


def _joint(
    kept: list[PairObservation], board: BoardSpec, camera: BoardCamera, noise: Noise, start: Array,
    with_intrinsics: bool, narrow: bool,
) -> tuple[JointProblem, Refined, BoardScale, Beams | None]:  # fmt: skip
    """How far whole planes are off, the board's scale, then everything together.

    The result is for the size that is stated, unless the LiDAR is sure of another. Where the normals are `narrow`, in
    one plane but for a few degrees, the planes alone speak: outlines would decide what they hardly see.
    """
    pairs = _plane_pairs(kept)
    beams = _beams_of(kept, board, camera, noise, pairs, start)
    plane_sigma = plane_sigmas(pairs, start, shared=None if beams is None else beams.shared)
    better, size, _ = solve_with_scale(
        with_plane_errors(pairs, *plane_sigma), start, VARIANCE.loose_scale_sigma
    )
    centres = None if narrow else Centres.of(kept, better, size)
    problem = joint_problem(kept, board, camera, noise, plane_sigma, centres)
    boards = np.array([o.T_camera_board for o in kept])
    boards[:, :3, 3] *= size
    loose = Free(True, with_intrinsics, True, VARIANCE.loose_scale_sigma)
    sized = refine(problem, JointState(better, boards, camera, size), loose)
    scale = BoardScale.judged(sized.state.scale, sized.scale_sigma)
    if scale.doubted:
        return problem, sized, scale, beams
    boards = np.array([o.T_camera_board for o in kept])
    stated = solve_with_scale(with_plane_errors(pairs, *plane_sigma), better, SCALE_IS_STATED)[0]
    free = Free(True, with_intrinsics, with_intrinsics, VARIANCE.scale_sigma)
    return problem, refine(problem, JointState(stated, boards, camera), free), scale, beams


def _beams_of(
    kept: list[PairObservation], board: BoardSpec, camera: BoardCamera, noise: Noise, pairs: PlanePairs, start: Array
) -> Beams | None:  # fmt: skip
    """The LiDAR's beams, if it has any to speak of."""
    problem = joint_problem(kept, board, camera, noise)
    state = JointState(start, np.array([o.T_camera_board for o in kept]), camera)
    return find_beams(problem, state, pairs.normals_camera)


def _scatter(pairs: PlanePairs, T: Array, shared: Array | None) -> float:
    """Variance factor of the plane mismatches over what their covariances say; 1 unless clearly above."""
    freedom = 3 * len(pairs) - 7
    if freedom < 3:
        return 1.0
    z, J = mismatch(pairs, T)
    total = block_diagonal(mismatch_covariance(pairs, T)) + (0.0 if shared is None else shared)
    total = total + 1e-12 * np.eye(len(total))
    # What a step of the transform, or a square of another size than stated, can mend is not the boards' own: the
    # transform here is that of points and corners, and need not be the one these planes would choose.
    by_scale = np.zeros((len(pairs), 3, 1))
    by_scale[:, 2, 0] = -pairs.offsets_camera
    A = np.concatenate([J, by_scale], axis=2).reshape(len(total), -1)
    W = np.linalg.inv(total)
    pull = A.T @ W @ z.reshape(-1)
    left = float(z.reshape(-1) @ W @ z.reshape(-1)) - float(pull @ np.linalg.pinv(A.T @ W @ A) @ pull)
    factor = left / freedom
    return factor if factor > 1.0 + 2.0 * np.sqrt(2.0 / freedom) else 1.0


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
    results = tuple(refused_result(o, refused.get(o.name, ""), T) for o in observations)
    return Calibration(
        T, np.eye(6), T, T, T, results, verdict, (), HeldOut(nan, nan), nan, nan,
        Noise(REFINE.least_corner_sigma_px, REFINE.least_range_sigma_m), 1.0, camera,
    )  # fmt: skip


def ticked_mask(observations: Sequence[PairObservation], exclude: Sequence[str]) -> NDArray[np.bool_]:
    """(M,) bool for `calibrate`: every pair but those named."""
    return np.array([o.name not in exclude for o in observations], dtype=bool)
