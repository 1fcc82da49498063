"""A board that nobody holds yet, as camera and LiDAR would see it: the measurements that it would add to a set.

The LiDAR is known from the boards it has seen: its beams and their step round, or how dense its points lie.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.boards.joint import JointProblem, JointState
from stereocalib_core.boards.observation import BoardSpec
from stereocalib_core.boards.second_opinion import Information, Solved
from stereocalib_core.config.boards import NEXT_POSE
from stereocalib_core.config.boards_search import EXTRACTION
from stereocalib_core.geometry import invert_transform
from stereocalib_core.numeric.arrays import Array


@dataclass(frozen=True)
class Scan:
    """elevations: (E,) [rad] of rows, ascending; beams: (E,) the beam of each, those that no board has met yet counted
    on; known: how many beams boards have met (0: no beams); step_rad: between the points of a row."""

    elevations: Array
    beams: NDArray[np.int64]
    known: int
    step_rad: float

    @classmethod
    def of(cls, solved: Solved) -> Scan:
        """From the points on the boards of a set."""
        problem = solved.problem
        up = np.arcsin(np.clip(problem.rays[:, 2], -1.0, 1.0))
        around = np.arctan2(problem.rays[:, 1], problem.rays[:, 0])
        if solved.beams is None:
            step = _spacing(problem)
            beyond = NEXT_POSE.beyond_rad
            elevations: Array = np.arange(up.min() - beyond, up.max() + beyond, step)
            return cls(elevations, np.zeros(len(elevations), np.int64), 0, step)
        owner, known = solved.beams.owner, solved.beams.count
        elevations = np.bincount(owner, up, known) / np.bincount(owner, minlength=known)
        gap = float(np.median(np.diff(elevations)))
        more = np.arange(1, int(NEXT_POSE.beyond_rad / gap) + 1)
        row = problem.owner * known + owner
        order = np.lexsort((around, row))
        steps = np.diff(around[order])[np.diff(row[order]) == 0]
        return cls(
            np.concatenate([elevations[0] - gap * more[::-1], elevations, elevations[-1] + gap * more]),
            np.concatenate([known + more[::-1] - 1, np.arange(known), known + len(more) + more - 1]),
            known,
            float(np.median(steps)) if len(steps) else gap,
        )

    @property
    def beam_count(self) -> int:
        """Beams in all; 0 where there are none."""
        return int(self.beams.max()) + 1 if self.known else 0

    def points_on(
        self, T_lidar_board: Array, board: BoardSpec
    ) -> tuple[Array, NDArray[np.int64], int] | None:
        """(P, 3) points [m], their rows, and how many points each stands for; None for a board beyond the rows."""
        outline = board.outline_board @ T_lidar_board[:3, :3].T + T_lidar_board[:3, 3]
        up = np.arcsin(outline[:, 2] / np.linalg.norm(outline, axis=1))
        middle = np.arctan2(T_lidar_board[1, 3], T_lidar_board[0, 3])
        c, s = np.cos(middle), np.sin(middle)
        around = np.arctan2(c * outline[:, 1] - s * outline[:, 0], c * outline[:, 0] + s * outline[:, 1])
        seen = min(up.max(), self.elevations[-1]) - max(up.min(), self.elevations[0])
        if seen < NEXT_POSE.least_scanned * np.ptp(up):
            return None
        rows = np.flatnonzero((self.elevations > up.min()) & (self.elevations < up.max()))
        count = len(rows) * np.ptp(around) / self.step_rad
        every = max(1, round(count / NEXT_POSE.imagined_points))
        # Without beams rows are as close as points: both are thinned.
        row_every = 1 if self.known else max(1, round(np.sqrt(every)))
        every, rows = max(1, every // row_every), rows[::row_every]
        azimuth = np.arange(around.min(), around.max(), every * self.step_rad) + middle
        e, a = (grid.ravel() for grid in np.meshgrid(self.elevations[rows], azimuth, indexing="ij"))
        rays = np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=1)
        normal, center = T_lidar_board[:3, 2], T_lidar_board[:3, 3]
        points = rays * ((normal @ center) / (rays @ normal))[:, None]
        places = np.abs((points - center) @ T_lidar_board[:3, :2])
        edge = max(EXTRACTION.edge_m, EXTRACTION.edge_share * board.short_side_m)
        inside = (places < np.array([board.width_m, board.height_m]) / 2 - edge).all(axis=1)
        return points[inside], np.repeat(rows, len(azimuth))[inside], every * row_every


def _spacing(problem: JointProblem) -> float:
    """Angle between neighbouring points of a LiDAR without beams [rad]: what a board covers, over its points."""
    spacings = []
    for points in np.split(problem.rays, problem.starts[1:]):
        values = np.linalg.eigvalsh(np.cov(points.T))
        # A rectangle's variances along its sides are their squares over twelve.
        spacings.append(np.sqrt(12.0 * np.sqrt(max(values[1] * values[2], 1e-12)) / len(points)))
    return float(np.median(spacings))


def imagined(
    T_camera_board: Array, solved: Solved, board: BoardSpec, scan: Scan
) -> tuple[JointProblem, JointState, NDArray[np.int64]] | None:
    """What the board would add, its state, and the beam of each point; None when a sensor would see it badly."""
    problem, state = solved.problem, solved.refined.state
    T_lidar = invert_transform(state.T_camera_lidar) @ T_camera_board
    for T in (T_lidar, T_camera_board):
        if abs(T[:3, 2] @ T[:3, 3]) < NEXT_POSE.least_incidence * np.linalg.norm(T[:3, 3]):
            return None
    met = scan.points_on(T_lidar, board)
    if met is None:
        return None
    points, rows, every = met
    if len(np.unique(rows)) < NEXT_POSE.least_rows or len(points) < EXTRACTION.least_points:
        return None
    corners = state.camera.project(problem.model @ T_camera_board[:3, :3].T + T_camera_board[:3, 3])
    tilt, offset = problem.plane_sigma
    one = replace(
        problem,
        corners=corners[None],
        corner_sigma=np.array([problem.noise.corner_px]),
        points=points,
        counts=np.array([len(points)]),
        noise=replace(problem.noise, range_m=problem.noise.range_m / np.sqrt(every)),
        # A new board is trusted no better than a common one, even where this set shows no error of whole planes.
        plane_sigma=(max(tilt, NEXT_POSE.least_tilt_rad), max(offset, NEXT_POSE.least_offset_m)),
        centres=None,
    )
    alone = JointState(state.T_camera_lidar, T_camera_board[None], state.camera)
    return one, alone, scan.beams[rows]


def information_with(
    solved: Solved, added: tuple[JointProblem, JointState, NDArray[np.int64]], scan: Scan
) -> Information:
    """What a set and one more board say together."""
    problem, state, owner = added
    # The ruler has spoken already.
    free = replace(solved.free, scale_sigma=np.inf)
    more = Information.of(problem, state, free, owner if scan.known else None, scan.beam_count)
    base = solved.information
    by_beams = more.by_beams.copy()
    by_beams[:, : base.by_beams.shape[1]] += base.by_beams
    return Information(base.own + more.own, by_beams)
