"""Which board to hold up next: the pose that would shrink the worst sigma most, from the covariance there is.

A grid of poses that both sensors can see is tried; each would add the information of one more plane, as noisy as
the planes of this set are.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from stereocalib_core.boards.beams import beams_of
from stereocalib_core.boards.calibration import Calibration
from stereocalib_core.boards.chessboard import corner_residuals, plane_of_board
from stereocalib_core.boards.observation import BoardSpec, PairObservation, PlaneEstimate
from stereocalib_core.boards.rotations import rotation_from_vector
from stereocalib_core.boards.solve import PlanePairs, mismatch, mismatch_covariance, split_jacobian
from stereocalib_core.boards.variance_components import with_plane_errors
from stereocalib_core.config.boards import NEXT_POSE, OBSERVABILITY
from stereocalib_core.geometry import Plane, invert_transform, transform
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
    ok = {p.name for p in result.pairs if p.ok}
    kept = [
        o for o in observations if o.name in ok and o.camera_plane is not None and o.lidar_plane is not None
    ]
    if not kept or not np.isfinite(result.covariance).all():
        return None
    J = split_jacobian(result.T_camera_lidar)
    information = np.linalg.pinv(result.covariance, hermitian=True)
    spread = _lidar_spread(kept)
    band, rows = _elevations(kept), _rows_at_one_metre(kept)
    best: tuple[float, Array, Array] | None = None
    for T in _poses(kept, result, board):
        seen = _as_seen(T, result, board, spread, band)
        if seen is None:
            continue
        whole = _plane_sigma(result, board, rows / float(np.linalg.norm(T[:3, 3])))
        pair = with_plane_errors(PlanePairs.of([seen[0]], [seen[1]]), *whole)
        z, D = mismatch(pair, result.T_camera_lidar)
        D = D[0] @ np.linalg.inv(J)
        added = D.T @ np.linalg.solve(mismatch_covariance(pair, result.T_camera_lidar)[0], D)
        sigma = np.sqrt(np.diag(np.linalg.inv(information + added)))
        score = float(np.max(sigma / LIMITS)) + NEXT_POSE.rest_weight * float(np.sum(sigma / LIMITS))
        if best is None or score < best[0]:
            best = score, T, sigma
    if best is None:
        return None
    _, T, after = best
    before = np.concatenate([result.sigma_rotation_rad, result.sigma_translation_m])
    tilt = float(np.arccos(np.clip(abs(T[2, 2]), 0.0, 1.0)))
    camera = result.camera
    place = camera.project(T[:3, 3])
    distance = float(np.linalg.norm(T[:3, 3]))
    return NextPose(T, distance, tilt, place, (camera.width, camera.height), before, after)


def _plane_sigma(result: Calibration, board: BoardSpec, rows: float) -> tuple[float, float]:
    """Tilt [rad] and offset [m] of a new board's whole plane, 1 sigma, when so many rows of a LiDAR meet it.

    It is trusted no better than a common one, even where this set shows no error of whole planes; each row brings its
    beam's own range error, which K rows evenly over a height h turn into a slope of sqrt(12 / K) / h and a mean of
    1 / sqrt(K) times as much.
    """
    tilt, offset = result.plane_sigma
    rows = max(rows, NEXT_POSE.least_rows)
    by_beams = result.beam_sigma_m / np.sqrt(rows)
    tilt = max(tilt, NEXT_POSE.least_tilt_rad)
    return (
        float(np.hypot(tilt, np.sqrt(12.0) * by_beams / board.short_side_m)),
        float(np.hypot(max(offset, NEXT_POSE.least_offset_m), by_beams)),
    )


def _rows_at_one_metre(kept: Sequence[PairObservation]) -> float:
    """How many rows would meet a board 1 m away; many, for a LiDAR whose points lie in none."""
    points = np.concatenate([o.points_lidar for o in kept])
    owner = beams_of(points / np.linalg.norm(points, axis=1, keepdims=True)) if len(points) else None
    if owner is None:
        return float(len(points))
    ends = np.cumsum([len(o.points_lidar) for o in kept])[:-1]
    rows = [
        len(np.unique(own)) * float(np.linalg.norm(o.lidar_plane.center))
        for o, own in zip(kept, np.split(owner, ends), strict=True)
        if o.lidar_plane is not None
    ]
    return float(np.median(rows))


def _poses(kept: Sequence[PairObservation], result: Calibration, board: BoardSpec) -> Iterator[Array]:
    """T_camera_board over places, distances and tilts, the whole board in the picture."""
    camera = result.camera
    far = np.array([np.linalg.norm(o.camera_plane.center) for o in kept if o.camera_plane is not None])
    distances = np.unique(np.round([far.min(), float(np.median(far)), far.max()], 2))
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
                    outline = camera.project(board.outline_board @ T[:3, :3].T + T[:3, 3])
                    margin = NEXT_POSE.margin_share * camera.width
                    inside = (outline > margin) & (outline < np.array([camera.width, camera.height]) - margin)
                    if inside.all():
                        yield T


def _as_seen(
    T: Array, result: Calibration, board: BoardSpec, spread: Array, band: tuple[float, float]
) -> tuple[PlaneEstimate, PlaneEstimate] | None:
    """Both sensors' planes of a board that stands at T; None when one of them would see it too flat or not at all."""
    T_lidar = invert_transform(result.T_camera_lidar) @ T
    center, normal = T_lidar[:3, 3], T_lidar[:3, 2]
    reach = float(np.linalg.norm(center))
    offset = float(normal @ center)
    if abs(offset) < NEXT_POSE.least_incidence * reach or abs(
        T[:3, 2] @ T[:3, 3]
    ) < NEXT_POSE.least_incidence * (np.linalg.norm(T[:3, 3])):
        return None
    if not band[0] <= np.arcsin(center[2] / reach) <= band[1]:
        return None
    camera = result.camera
    corners = camera.project(board.corners_board @ T[:3, :3].T + T[:3, 3])
    _, J = corner_residuals(camera, corners, board.corners_board, T)
    covariance = np.linalg.inv(J.T @ J) * result.noise.corner_px**2
    if offset < 0:
        normal, offset = -normal, -offset
    lidar = PlaneEstimate(Plane(normal, offset), center, np.zeros((4, 4)))
    tilt, shift = spread * reach
    noisy = with_plane_errors(PlanePairs.of([lidar], [lidar]), tilt, shift).covariances_lidar[0]
    return plane_of_board(T, np.asarray(covariance)), PlaneEstimate(Plane(normal, offset), center, noisy)


def _lidar_spread(kept: Sequence[PairObservation]) -> Array:
    """(2,) tilt [rad/m] and offset [m/m] sigmas of the points' own noise, over the distance: rings get fewer."""
    rows = []
    for o in kept:
        plane = o.lidar_plane
        assert plane is not None
        distance = float(np.linalg.norm(plane.center))
        tilt = np.sqrt(np.trace(plane.covariance[:3, :3]) / 2)
        # d at the board's centre: what is left of the offset when the tilt turns about it.
        at = np.append(-plane.center, 1.0)
        rows.append([tilt / distance, np.sqrt(max(float(at @ plane.covariance @ at), 0.0)) / distance])
    return np.asarray(np.median(rows, axis=0))


def _elevations(kept: Sequence[PairObservation]) -> tuple[float, float]:
    """Elevations of board centres that this LiDAR is known to see [rad]."""
    seen = [o.lidar_plane.center for o in kept if o.lidar_plane is not None]
    angles = [float(np.arcsin(c[2] / np.linalg.norm(c))) for c in seen]
    return min(angles) - NEXT_POSE.beyond_rad, max(angles) + NEXT_POSE.beyond_rad
