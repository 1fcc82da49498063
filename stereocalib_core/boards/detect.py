"""From files to observations: every picture and cloud is looked at once, and never again.

The result is small. Solving it again with another choice of pairs touches no pixel and no cloud.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from stereocalib_core.boards.board_search import (
    BoardCandidate,
    candidate_of_cropped,
    edge_on_board,
    find_candidates,
)
from stereocalib_core.boards.camera import BoardCamera
from stereocalib_core.boards.chessboard import board_pose, find_corners, plane_of_board
from stereocalib_core.boards.cloud_files import read_cloud
from stereocalib_core.boards.consensus import Candidates, agree
from stereocalib_core.boards.extraction import board_at
from stereocalib_core.boards.folder import BoardFolder, read_picture
from stereocalib_core.boards.intrinsics import estimate_camera
from stereocalib_core.boards.memo import Memo, state_of
from stereocalib_core.boards.observability import edge_on_words
from stereocalib_core.boards.observation import BoardSpec, PairObservation, PlaneEstimate
from stereocalib_core.boards.pattern import true_pattern
from stereocalib_core.boards.planes import fit_plane
from stereocalib_core.config.boards_search import CHESSBOARD, CLOUD_SEARCH, CONSENSUS
from stereocalib_core.errors import SourceError
from stereocalib_core.geometry import invert_transform
from stereocalib_core.numeric.arrays import Array

WORKERS = 2
Progress = Callable[[str, int, int], None]
Item = TypeVar("Item")
Result = TypeVar("Result")


@dataclass(frozen=True)
class Detection:
    """All observations of a folder, the board, and the camera (given or estimated; rms [px] when estimated).

    notes: what was read otherwise than it was written. candidates: every board-like place of each pair's cloud.
    """

    board: BoardSpec
    camera: BoardCamera
    observations: tuple[PairObservation, ...]
    estimated_rms_px: float | None = None
    notes: tuple[str, ...] = ()
    candidates: tuple[tuple[BoardCandidate, ...], ...] = ()
    source: object = "boards"

    @property
    def camera_is_estimated(self) -> bool:
        """Whether the camera comes from these very pictures."""
        return self.estimated_rms_px is not None


@dataclass(frozen=True)
class _Loaded:
    observation: PairObservation
    points: Array
    size: tuple[int, int]


def detect(folder: BoardFolder, progress: Progress | None = None, memo: Memo | None = None) -> Detection:
    """Find the board in every picture and every cloud of a folder.

    A pair in which it cannot be found stays in the list with `status` "rejected" and its reason. Raises
    SourceError when no camera can be estimated. `progress` gets (stage, done, total). With the `memo` of an earlier
    look only files that are new or changed are searched.
    """
    memo = memo or Memo()
    folder, notes = _with_true_pattern(folder)

    def load(name: str) -> _Loaded:
        files = state_of(folder.images.get(name)), state_of(folder.clouds.get(name))
        size = None if folder.camera is None else (folder.camera.width, folder.camera.height)
        return memo.recall(("load", name, files, folder.board, size), lambda: _load(name, folder))

    loaded = in_parallel(load, list(folder.names), "reading pairs", progress)
    camera, rms = folder.camera, None
    if camera is None:
        camera, rms = _estimate(loaded, folder.board)
    posed = [_pose(each, camera, folder.board) for each in loaded]

    def search(each: _Loaded) -> list[BoardCandidate]:
        plane = each.observation.camera_plane
        if not each.observation.ok or plane is None:
            return []
        # In steps, so that a camera that is estimated anew with every picture asks for the same search.
        step = CLOUD_SEARCH.distance_step_m
        farthest = step * np.ceil((np.linalg.norm(plane.center) + CLOUD_SEARCH.farther_than_camera_m) / step)
        key = "search", state_of(folder.clouds.get(each.observation.name)), float(farthest), folder.board
        return memo.recall(key, lambda: _search(each, folder, float(farthest)))

    found = in_parallel(search, posed, "searching boards in clouds", progress)
    observations = _choose(posed, found, folder.board, progress)
    places = tuple(tuple(candidates) for candidates in found)
    return Detection(
        folder.board, camera, tuple(observations), rms, (*folder.notes, *notes), places, folder.path
    )


def _with_true_pattern(folder: BoardFolder) -> tuple[BoardFolder, tuple[str, ...]]:
    """The folder with the pattern that its pictures show, and what to say when that is another one."""
    names = [n for n in folder.names if n in folder.images]
    chosen = [
        names[i] for i in np.unique(np.linspace(0, len(names) - 1, CHESSBOARD.sampled_pictures).astype(int))
    ]
    pictures = []
    for name in chosen if names else []:
        try:
            pictures.append(read_picture(folder.images[name], folder.camera))
        except SourceError:
            continue  # named with its reason when its turn comes
    board, note = true_pattern(pictures, folder.board)
    return (replace(folder, board=board), (note,)) if note else (folder, ())


def in_parallel(
    work: Callable[[Item], Result], items: list[Item], stage: str, progress: Progress | None
) -> list[Result]:
    """Results in the order of the items, whichever finishes first; a `progress` that raises stops the rest."""
    results: list[Result] = []
    pool = ThreadPoolExecutor(WORKERS)
    try:
        for done, result in enumerate(pool.map(work, items), start=1):
            results.append(result)
            if progress is not None:
                progress(stage, done, len(items))
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
    return results


def _refused(observation: PairObservation, reason: str) -> PairObservation:
    return replace(observation, status="rejected", reason=reason)


def _load(name: str, folder: BoardFolder) -> _Loaded:
    """Corners and cloud of one pair, or the reason why not."""
    image, cloud = folder.images.get(name), folder.clouds.get(name)
    observation = PairObservation(name, image, cloud)
    nothing: Array = np.zeros((0, 3))
    if image is None or cloud is None:
        missing = "picture" if image is None else "cloud"
        return _Loaded(_refused(observation, f"no {missing} of this name"), nothing, (0, 0))
    size, reason = (0, 0), ""
    try:
        picture = read_picture(image, folder.camera)
        size = (picture.shape[1], picture.shape[0])
        corners = find_corners(picture, folder.board)
        if corners is None:
            reason = f"no board of {folder.board.columns}x{folder.board.rows} inner corners in the picture"
        observation = replace(observation, corners=corners)
        points = read_cloud(cloud)
    except SourceError as error:
        return _Loaded(_refused(observation, f"{error.what}: {error.remedy}"), nothing, size)
    if len(points) > CLOUD_SEARCH.most_kept_points:
        points = points[
            np.sort(
                np.random.default_rng(0).choice(len(points), CLOUD_SEARCH.most_kept_points, replace=False)
            )
        ]
    return _Loaded(_refused(observation, reason) if reason else observation, points, size)


def _estimate(loaded: list[_Loaded], board: BoardSpec) -> tuple[BoardCamera, float]:
    sizes = {each.size for each in loaded if each.observation.corners is not None}
    if len(sizes) > 1:
        raise SourceError(
            "pictures differ in size", sorted(sizes), "a camera can be estimated from one size only"
        )
    corners = [each.observation.corners for each in loaded if each.observation.corners is not None]
    return estimate_camera(corners, next(iter(sizes), (0, 0)), board)


def _pose(each: _Loaded, camera: BoardCamera, board: BoardSpec) -> _Loaded:
    """Where the picture shows the board."""
    observation = each.observation
    if observation.corners is None:
        return each
    posed = board_pose(camera, observation.corners, board)
    if posed is None or posed[2] > CHESSBOARD.worst_rms_px:
        why = (
            "no pose fits the corners"
            if posed is None
            else f"corners miss the board by {posed[2]:.1f} px rms"
        )
        return replace(each, observation=_refused(observation, f"{why}: check camera.yaml and board.yaml"))
    T, covariance, rms = posed
    plane = plane_of_board(T, covariance * max(rms, CHESSBOARD.least_rms_px) ** 2)
    return replace(
        each, observation=replace(observation, T_camera_board=T, camera_plane=plane, corner_rms_px=rms)
    )


def _search(each: _Loaded, folder: BoardFolder, farthest_m: float) -> list[BoardCandidate]:
    if folder.cropped:
        candidate = candidate_of_cropped(each.points, folder.board)
        return [] if candidate is None else [candidate]
    return find_candidates(each.points, folder.board, farthest_m)


def _flatten(posed: list[_Loaded], found: list[list[BoardCandidate]]) -> Candidates:
    rows = [(pair, c) for pair, candidates in enumerate(found) for c in candidates]
    planes: list[PlaneEstimate] = [
        p for pair, _ in rows if (p := posed[pair].observation.camera_plane) is not None
    ]
    return Candidates(
        np.array([pair for pair, _ in rows], dtype=np.int64),
        np.array([p.center for p in planes]).reshape(-1, 3),
        np.array([p.plane.normal for p in planes]).reshape(-1, 3),
        np.array([c.outline.center for _, c in rows]).reshape(-1, 3),
        np.array([c.plane.normal for _, c in rows]).reshape(-1, 3),
        np.array([c.outline.score for _, c in rows]),
    )


def _choose(
    posed: list[_Loaded], found: list[list[BoardCandidate]], board: BoardSpec, progress: Progress | None
) -> list[PairObservation]:
    """Pick each cloud's board by agreement, then look again where the agreement says it must be."""
    flat = _flatten(posed, found)
    observations = [each.observation for each in posed]
    agreement = agree(flat, len(posed), CONSENSUS.detection_share * board.short_side_m)
    if agreement is None:
        return [_without_board(each, "no board in the cloud", board) for each in posed]
    tolerance = float(np.median([c.tolerance_m for candidates in found for c in candidates]))
    T, chosen = agreement.T_camera_lidar, agreement.chosen
    for _ in range(2):
        T_now = T
        observations = in_parallel(
            lambda each, T_now=T_now: _extract(each, T_now, board, tolerance),  # type: ignore[misc]
            posed, "measuring boards in clouds", progress,
        )  # fmt: skip
        better = agree(
            _of_observations(observations), len(posed), CONSENSUS.detection_share * board.short_side_m
        )
        if better is None:
            break
        T = better.T_camera_lidar
    starts = np.searchsorted(flat.pair, np.arange(len(posed)))
    result = []
    for pair, (each, observation) in enumerate(zip(posed, observations, strict=True)):
        if observation.ok or not each.observation.ok:
            result.append(observation)
            continue
        lone = _lone_candidate(pair, int(chosen[pair] - starts[pair]), posed, found, T)
        if lone is None:
            result.append(_without_board(each, observation.reason, board))
        else:
            result.append(_measure_candidate(each, lone, board))
    return result


def _without_board(each: _Loaded, reason: str, board: BoardSpec) -> PairObservation:
    """Refused, unless it was before; a board held edge-on to the LiDAR is called that."""
    if not each.observation.ok:
        return each.observation
    return _refused(each.observation, edge_on_words("LiDAR") if edge_on_board(each.points, board) else reason)


def _of_observations(observations: list[PairObservation]) -> Candidates:
    rows = [(i, o.camera_plane, o.lidar_plane) for i, o in enumerate(observations) if o.ok]
    both = [(i, c, p) for i, c, p in rows if c is not None and p is not None]
    return Candidates(
        np.array([i for i, _, _ in both], dtype=np.int64),
        np.array([c.center for _, c, _ in both]).reshape(-1, 3),
        np.array([c.plane.normal for _, c, _ in both]).reshape(-1, 3),
        np.array([p.center for _, _, p in both]).reshape(-1, 3),
        np.array([p.plane.normal for _, _, p in both]).reshape(-1, 3),
        np.ones(len(both)),
    )


def _extract(each: _Loaded, T_camera_lidar: Array, board: BoardSpec, tolerance_m: float) -> PairObservation:
    observation = each.observation
    if not observation.ok or observation.T_camera_board is None:
        return observation
    expected = invert_transform(T_camera_lidar) @ observation.T_camera_board
    measured = board_at(each.points, expected, board, tolerance_m)
    if isinstance(measured, str):
        return _refused(observation, f"no board in the cloud where the picture has it: {measured}")
    return replace(observation, points_lidar=measured[0], lidar_plane=measured[1])


def _lone_candidate(
    pair: int, chosen: int, posed: list[_Loaded], found: list[list[BoardCandidate]], T_camera_lidar: Array
) -> BoardCandidate | None:
    """The board of a cloud that does not fit its own picture, when it fits another one: clouds were mixed up."""
    candidates = [c for c in found[pair] if c.outline.score >= CLOUD_SEARCH.lone_score]
    if chosen >= 0:
        return found[pair][chosen]
    places = [o.camera_plane for each in posed if (o := each.observation).ok and o.camera_plane is not None]
    for candidate in candidates:
        seen = T_camera_lidar[:3, :3] @ candidate.outline.center + T_camera_lidar[:3, 3]
        turned = T_camera_lidar[:3, :3] @ candidate.plane.normal
        if any(
            np.linalg.norm(p.center - seen) < CLOUD_SEARCH.lone_near_m
            and turned @ p.plane.normal > CLOUD_SEARCH.lone_facing
            for p in places
        ):
            return candidate
    return None


def _measure_candidate(each: _Loaded, candidate: BoardCandidate, board: BoardSpec) -> PairObservation:
    """The points and the plane of a candidate, whatever the picture says."""
    T = np.eye(4)
    T[:3, 0], T[:3, 1] = candidate.outline.axes
    T[:3, 2] = np.cross(*candidate.outline.axes)
    T[:3, 3] = candidate.outline.center
    measured = board_at(each.points, T, board, candidate.tolerance_m)
    if isinstance(measured, str):
        return _refused(each.observation, "no board in the cloud")
    points, plane = measured
    return replace(each.observation, points_lidar=points, lidar_plane=fit_plane(points, center=plane.center))
