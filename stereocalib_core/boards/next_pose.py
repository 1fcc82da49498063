"""Which board to hold up next: the pose that would shrink the worst sigma most, from the covariance there is.

A grid of poses that both sensors can see is tried, and finer steps about the best: each is measured as the sensors of
this set would measure it, and the covariance of the set with it is the one that would be printed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stereocalib_core.boards.calibration import Calibration
from stereocalib_core.boards.camera import BoardCamera
from stereocalib_core.boards.centres import Centres
from stereocalib_core.boards.imagined_board import Scan, imagined, information_with
from stereocalib_core.boards.observability import leave_open
from stereocalib_core.boards.observation import BoardSpec, PairObservation
from stereocalib_core.boards.rotations import rotation_from_vector
from stereocalib_core.boards.second_opinion import Solved, covariance_with_doubt
from stereocalib_core.config.boards import NEXT_POSE, OBSERVABILITY
from stereocalib_core.geometry import invert_transform, transform
from stereocalib_core.numeric.arrays import Array

LIMITS = np.array([OBSERVABILITY.poor_rad] * 3 + [OBSERVABILITY.poor_m] * 3)
"""What a sigma is measured against, so that turns and shifts compare."""
AXES = (
    "the turn about camera x",
    "the turn about camera y",
    "the turn about camera z",
    "camera x",
    "camera y",
    "camera z",
)


@dataclass(frozen=True)
class NextPose:
    """T_camera_board (4, 4) of the board to add; distance [m], tilt [rad] and place (2,) [px] of its centre.

    sigma_before, sigma_after: (6,) turns about [rad] and shifts along [m] the camera's axes.
    """

    T_camera_board: Array
    distance_m: float
    tilt_rad: float
    place_px: Array
    picture: tuple[int, int]
    sigma_before: Array
    sigma_after: Array

    def words(self) -> str:
        """How to hold it, and what it would do."""
        worst = int(np.argmax(self.sigma_before / LIMITS))
        unit, factor = ("deg", 180 / np.pi) if worst < 3 else ("mm", 1000.0)
        before, after = factor * self.sigma_before[worst], factor * self.sigma_after[worst]
        return (
            f"hold a board {self.distance_m:.1f} m from the camera, {self._where()} of the picture, {self._how()}; "
            f"sigma of {AXES[worst]} would go from {before:.2g} to {after:.2g} {unit}"
        )

    def _where(self) -> str:
        across = ("left", "middle", "right")[int(np.clip(3 * self.place_px[0] / self.picture[0], 0, 2))]
        down = ("top", "middle", "bottom")[int(np.clip(3 * self.place_px[1] / self.picture[1], 0, 2))]
        if across == down:
            return "in the middle"
        return f"at the {down if across == 'middle' else across if down == 'middle' else f'{down} {across}'}"

    def _how(self) -> str:
        normal = self.T_camera_board[:3, 2]
        if self.tilt_rad < np.deg2rad(5.0):
            return "facing the camera"
        edges = []
        if abs(normal[1]) > 0.3 * np.hypot(normal[0], normal[1]):
            edges.append("lower" if normal[1] > 0 else "upper")
        if abs(normal[0]) > 0.3 * np.hypot(normal[0], normal[1]):
            edges.append("right" if normal[0] > 0 else "left")
        return f"tilted by {np.rad2deg(self.tilt_rad):.0f} deg, its {' and '.join(edges)} edge toward you"


def next_pose(
    observations: Sequence[PairObservation], result: Calibration, board: BoardSpec
) -> NextPose | None:
    """The pose to add, or None where nothing was solved or no pose fits into the picture."""
    solved = result.solved
    if solved is None or not np.isfinite(result.covariance).all():
        return None
    look = _Search(observations, result, solved, board)
    tried = [(look.score(T), T) for T in _poses(solved, board)]
    seen = [(score[0], score[1], T) for score, T in tried if score is not None]
    if not seen:
        return None
    best = min(seen, key=lambda each: each[0])
    for step in NEXT_POSE.finer:
        for T in _near(best[2], step):
            if _in_picture(T, result.camera, board) and (finer := look.score(T)) is not None:
                best = min(best, (*finer, T), key=lambda each: each[0])
    _, after, T = best
    before = np.concatenate([result.sigma_rotation_rad, result.sigma_translation_m])
    camera = result.camera
    tilt = float(np.arccos(np.clip(abs(T[2, 2]), 0.0, 1.0)))
    distance = float(np.linalg.norm(T[:3, 3]))
    return NextPose(T, distance, tilt, camera.project(T[:3, 3]), (camera.width, camera.height), before, after)


class _Search:
    """Scores poses for one set."""

    def __init__(
        self, observations: Sequence[PairObservation], result: Calibration, solved: Solved, board: BoardSpec
    ) -> None:
        ok = {p.name for p in result.pairs if p.ok}
        kept = [o for o in observations if o.name in ok]
        self._solved, self._board, self._scan = solved, board, Scan.of(solved)
        state = solved.refined.state
        self._normals = state.T_camera_boards[:, :3, 2]
        self._T, self._scale = state.T_camera_lidar, state.scale
        self._centres = solved.problem.centres or Centres.of(kept, self._T, self._scale)
        self._told = (
            np.zeros((7, 7))
            if solved.problem.centres is None
            else self._centres.equations(self._T, self._scale)[0]
        )

    def score(self, T_camera_board: Array) -> tuple[float, Array] | None:
        """How large the sigmas would be, the worst above all, and the (6,) sigmas; None for a board not seen."""
        added = imagined(T_camera_board, self._solved, self._board, self._scan)
        if added is None:
            return None
        information = information_with(self._solved, added, self._scan)
        own = information.own.copy()
        normals = np.vstack([self._normals, T_camera_board[:3, 2]])
        if not leave_open(normals):
            places = np.append(np.arange(6), -1)
            own[np.ix_(places, places)] += self._with_centre(T_camera_board) - self._told
        covariance = covariance_with_doubt(self._solved, replace(information, own=own))
        sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        return float(np.max(sigma / LIMITS) + NEXT_POSE.rest_weight * np.sum(sigma / LIMITS)), sigma

    def _with_centre(self, T_camera_board: Array) -> Array:
        """(7, 7) information of all outlines' centres, the new one's among them."""
        T_lidar = invert_transform(self._T) @ T_camera_board
        c = self._centres
        grown = replace(
            c,
            lidar=np.vstack([c.lidar, T_lidar[:3, 3]]),
            camera=np.vstack([c.camera, T_camera_board[:3, 3] / self._scale]),
            axes=np.concatenate([c.axes, T_camera_board[None, :3, :2].swapaxes(1, 2)]),
        )
        return grown.equations(self._T, self._scale)[0]


def _poses(solved: Solved, board: BoardSpec) -> Iterator[Array]:
    """T_camera_board over places, distances and tilts, the whole board in the picture."""
    camera = solved.refined.state.camera
    far = np.linalg.norm(solved.refined.state.T_camera_boards[:, :3, 3], axis=1)
    nearest = max(NEXT_POSE.nearest_m, NEXT_POSE.nearest_share * float(far.min()))
    distances = np.geomspace(nearest, max(float(far.max()), nearest), NEXT_POSE.distances)
    shares = np.array([[u, v] for v in NEXT_POSE.places for u in NEXT_POSE.places])
    rays = camera.normalise(shares * [camera.width - 1, camera.height - 1])
    for ray in rays:
        direction = np.append(ray, 1.0) / np.linalg.norm(np.append(ray, 1.0))
        for distance in distances:
            for tilt in NEXT_POSE.tilts_rad:
                directions = NEXT_POSE.directions if tilt > 0 else 1
                for around in np.arange(directions) * 2 * np.pi / NEXT_POSE.directions:
                    axis = tilt * np.array([np.cos(around), np.sin(around), 0.0])
                    T = transform(rotation_from_vector(axis), distance * direction)
                    if _in_picture(T, camera, board):
                        yield T


def _near(T: Array, step: float) -> Iterator[Array]:
    """Poses a share of the distance nearer, farther and to the sides; the tilt stays."""
    distance = float(np.linalg.norm(T[:3, 3]))
    way = T[:3, 3] / distance
    for shift in (way, -way, *np.eye(3)[:2], *-np.eye(3)[:2]):
        place = T[:3, 3] + step * distance * shift
        if np.linalg.norm(place) >= NEXT_POSE.nearest_m:
            yield transform(T[:3, :3], place)


def _in_picture(T: Array, camera: BoardCamera, board: BoardSpec) -> bool:
    """Whether all of the board is in the picture, with some margin."""
    outline = camera.project(board.outline_board @ T[:3, :3].T + T[:3, 3])
    margin = NEXT_POSE.margin_share * camera.width
    return bool(((outline > margin) & (outline < np.array([camera.width, camera.height]) - margin)).all())
