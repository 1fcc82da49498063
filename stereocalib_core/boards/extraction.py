"""The board's points in a cloud, once it is known where the board should be."""

from __future__ import annotations

import numpy as np

from stereocalib_core.boards.observation import BoardSpec, PlaneEstimate
from stereocalib_core.boards.outline import fit_outline, meet, rays_inside
from stereocalib_core.boards.planes import fit_plane, plane_through, ransac_plane
from stereocalib_core.boards.rotations import angle_between
from stereocalib_core.config.boards_search import EXTRACTION
from stereocalib_core.geometry import Plane
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.robust import SIGMA_PER_MAD


def board_at(
    points: Array,
    T_lidar_board: Array,
    board: BoardSpec,
    tolerance_m: float,
    turn_rad: float = EXTRACTION.most_turn_rad,
) -> tuple[Array, PlaneEstimate] | str:
    """The board near an expected pose: (M, 3) points on it and its plane, or the reason why it is not there.

    points: (N, 3) whole cloud. T_lidar_board: (4, 4) where it should be. The plane's `center` is found
    from the outline in the cloud alone, so that it can testify against the expectation.
    """
    center, axes = T_lidar_board[:3, 3], T_lidar_board[:3, :2].T
    expected = _facing(T_lidar_board[:3, 2], center)
    reach = 0.5 * board.diagonal_m + EXTRACTION.reach_m
    edge = max(EXTRACTION.edge_m, EXTRACTION.edge_share * board.short_side_m)
    rays = meet(points, expected, center, axes, reach, EXTRACTION.loose_tolerance_m)
    near = points[rays.index[rays.on & rays_inside(rays, board, edge)]]
    if len(near) < EXTRACTION.least_points:
        return f"only {len(near)} cloud points where the board should be"
    loose = near
    near = near[ransac_plane(near, tolerance_m)]
    plane, _ = plane_through(near)
    tolerance_m = _own_tolerance(loose, plane, tolerance_m)
    plane, _ = plane_through(loose[np.abs(plane.signed_distance(loose)) < tolerance_m])
    if angle_between(plane.normal, expected.normal) > turn_rad:
        return "what stands where the board should be faces another way"
    middle = center - plane.normal * plane.signed_distance(center)
    rays = meet(points, plane, middle, axes, reach, tolerance_m)
    inside = rays_inside(rays, board, edge)
    hits = rays.on & inside
    spoilt = (rays.behind & inside).sum() + (rays.on & ~rays_inside(rays, board, -edge)).sum()
    score = hits.sum() / max(hits.sum() + spoilt, 1)
    if hits.sum() < EXTRACTION.least_points:
        return f"only {hits.sum()} cloud points on the board"
    if score < (least := EXTRACTION.least_score):
        return f"no free-standing board where it should be (outline score {score:.2f} of at least {least})"
    chosen = points[rays.index[hits]]
    outline = fit_outline(points, plane, middle, board, tolerance_m)
    return chosen, fit_plane(chosen, center=outline.center)


def _own_tolerance(points: Array, plane: Plane, tolerance_m: float) -> float:
    """Three sigmas of the board's own scatter, grown from within, so that a hand or a coat near it adds nothing."""
    distance = np.abs(plane.signed_distance(points))
    limit = tolerance_m
    for _ in range(4):
        inside = distance[distance < limit]
        sigma = SIGMA_PER_MAD * float(np.median(inside)) if len(inside) else 0.0
        limit = float(
            np.clip(
                EXTRACTION.own_sigmas * sigma,
                EXTRACTION.least_own_share * tolerance_m,
                EXTRACTION.growth * limit,
            )
        )
    return min(limit, EXTRACTION.most_own_share * tolerance_m, EXTRACTION.loose_tolerance_m)


def _facing(normal: Array, center: Array) -> Plane:
    offset = float(normal @ center)
    return Plane(-normal, -offset) if offset < 0 else Plane(normal.copy(), offset)
