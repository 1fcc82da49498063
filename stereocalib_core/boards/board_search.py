"""Boards in whole clouds, without knowing where to look: flat, free-standing patches of the right size."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from stereocalib_core.boards.observation import BoardSpec
from stereocalib_core.boards.outline import Outline, fit_outline
from stereocalib_core.boards.planes import plane_through, ransac_plane, tangent_basis
from stereocalib_core.config.boards_search import CLOUD_SEARCH
from stereocalib_core.geometry import Plane
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.robust import mad_sigma


@dataclass(frozen=True)
class BoardCandidate:
    """A place in a cloud that looks like the board. plane in the LiDAR frame; outline.score says how much."""

    plane: Plane
    outline: Outline
    tolerance_m: float


def find_candidates(points: Array, board: BoardSpec, farthest_m: float) -> list[BoardCandidate]:
    """(N, 3) whole cloud [m] to board-like places, best first; none farther than `farthest_m`."""
    rays = thin_rays(points)
    near = rays[np.linalg.norm(rays, axis=1) < farthest_m]
    near = _one_per_voxel(near, CLOUD_SEARCH.voxel_share * board.short_side_m)
    if len(near) < 10:
        return []
    tree = cKDTree(near)
    seeds = _one_per_voxel(near, CLOUD_SEARCH.seed_share * board.short_side_m)
    if len(seeds) > CLOUD_SEARCH.most_seeds:
        seeds = seeds[np.random.default_rng(0).choice(len(seeds), CLOUD_SEARCH.most_seeds, replace=False)]
    means, normals, flatness, breadth = _patches(
        near, tree, seeds, CLOUD_SEARCH.patch_share * board.short_side_m
    )
    wide = breadth > CLOUD_SEARCH.least_breadth_share * board.short_side_m
    if not wide.any():
        return []
    # Floors and walls are everywhere, so the flattest quarter of the patches shows the sensor's own noise.
    noise_m = float(np.quantile(flatness[wide], CLOUD_SEARCH.noise_quantile))
    tolerance = float(
        np.clip(
            CLOUD_SEARCH.tolerance_sigmas * noise_m,
            CLOUD_SEARCH.least_tolerance_m,
            CLOUD_SEARCH.most_tolerance_m,
        )
    )
    reach = np.linalg.norm(means, axis=1)
    facing = np.abs(np.sum(normals * means, axis=1)) > CLOUD_SEARCH.least_incidence * reach
    chosen = np.flatnonzero(wide & facing & (flatness < CLOUD_SEARCH.flat_share * tolerance))
    coarse = _one_per_voxel(near, CLOUD_SEARCH.coarse_voxel_share * board.short_side_m)
    chosen = chosen[_stands_free(coarse, means[chosen], normals[chosen], board, tolerance)]
    found: list[BoardCandidate] = []
    for plane, center in _settle(near, tree, means[chosen], normals[chosen], board, tolerance):
        outline = fit_outline(rays, plane, center, board, tolerance)
        if outline.score >= CLOUD_SEARCH.least_score:
            found.append(BoardCandidate(plane, outline, tolerance))
    found.sort(key=lambda c: -c.outline.score)
    return _without_doubles(found, CLOUD_SEARCH.apart_share * board.short_side_m)[
        : CLOUD_SEARCH.most_candidates
    ]


def candidate_of_cropped(points: Array, board: BoardSpec) -> BoardCandidate | None:
    """(N, 3) cloud that holds the board only (and strays) to its place, or None when it is not flat."""
    rough = ransac_plane(points, CLOUD_SEARCH.rough_tolerance_m)
    if rough.sum() < CLOUD_SEARCH.least_cropped_points:
        return None
    plane, _ = plane_through(points[rough])
    noise = mad_sigma(plane.signed_distance(points[rough]))
    tolerance = float(
        np.clip(
            CLOUD_SEARCH.tolerance_sigmas * noise,
            CLOUD_SEARCH.least_cropped_tolerance_m,
            CLOUD_SEARCH.most_tolerance_m,
        )
    )
    inliers = points[ransac_plane(points, tolerance)]
    if len(inliers) < CLOUD_SEARCH.least_cropped_points or len(
        inliers
    ) < CLOUD_SEARCH.least_cropped_share * len(points):
        return None
    plane, mean = plane_through(inliers)
    return BoardCandidate(plane, fit_outline(inliers, plane, mean, board, tolerance), tolerance)


def edge_on_board(points: Array, board: BoardSpec) -> bool:
    """Whether a free-standing flat patch lies in a plane through the LiDAR's own origin: a board held edge-on."""
    near = _one_per_voxel(thin_rays(points), CLOUD_SEARCH.coarse_voxel_share * board.short_side_m)
    seeds = _one_per_voxel(near, CLOUD_SEARCH.seed_share * board.short_side_m)
    seeds = seeds[np.random.default_rng(0).permutation(len(seeds))[: CLOUD_SEARCH.most_seeds]]
    means, normals, flatness, breadth = _patches(
        near, cKDTree(near), seeds, CLOUD_SEARCH.patch_share * board.short_side_m
    )
    reach = np.linalg.norm(means, axis=1)
    through = np.abs(np.sum(normals * means, axis=1)) < CLOUD_SEARCH.edge_on_incidence * reach
    chosen = (
        through
        & (breadth > CLOUD_SEARCH.edge_on_breadth_share * board.short_side_m)
        & (flatness < CLOUD_SEARCH.edge_on_flat_share * board.short_side_m)
    )
    return bool(
        _stands_free(near, means[chosen], normals[chosen], board, CLOUD_SEARCH.edge_on_tolerance_m).any()
    )


def thin_rays(points: Array) -> Array:
    """At most 60,000 of (N, 3) points, drawn evenly and repeatably."""
    if len(points) <= CLOUD_SEARCH.most_rays:
        return points
    return points[
        np.sort(np.random.default_rng(0).choice(len(points), CLOUD_SEARCH.most_rays, replace=False))
    ]


def _one_per_voxel(points: Array, size_m: float) -> Array:
    cells = np.floor(points / size_m).astype(np.int64)
    keys = (cells[:, 0] * 73_856_093) ^ (cells[:, 1] * 19_349_663) ^ (cells[:, 2] * 83_492_791)
    return points[np.sort(np.unique(keys, return_index=True)[1])]


def _neighbours(tree: cKDTree, places: Array, radius_m: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Flat (owner, point) index pairs of all points within a radius of each place."""
    lists = tree.query_ball_point(places, radius_m)
    lengths = np.array([len(each) for each in lists], dtype=np.int64)
    owner = np.repeat(np.arange(len(places)), lengths)
    return owner, np.fromiter(chain.from_iterable(lists), dtype=np.int64, count=int(lengths.sum()))


def _patches(
    points: Array, tree: cKDTree, seeds: Array, radius_m: float
) -> tuple[Array, Array, Array, Array]:
    """Mean, normal, rms across and rms along the second axis of the points round each seed."""
    owner, index = _neighbours(tree, seeds, radius_m)
    count = np.maximum(np.bincount(owner, minlength=len(seeds)).astype(np.float64), 1.0)
    local = points[index] - seeds[owner]
    first = np.stack([np.bincount(owner, local[:, a], len(seeds)) for a in range(3)], axis=1) / count[:, None]
    second = np.zeros((len(seeds), 3, 3))
    for a in range(3):
        for b in range(a, 3):
            moment = np.bincount(owner, local[:, a] * local[:, b], len(seeds)) / count
            second[:, a, b] = second[:, b, a] = moment - first[:, a] * first[:, b]
    values, vectors = np.linalg.eigh(second)
    rms = np.sqrt(np.maximum(values, 0.0))
    breadth = np.where(count >= CLOUD_SEARCH.least_patch, rms[:, 1], 0.0)
    return seeds + first, vectors[:, :, 0], rms[:, 0], breadth


def _stands_free(
    points: Array, centers: Array, normals: Array, board: BoardSpec, tolerance_m: float
) -> NDArray[np.bool_]:
    """Whether the plane ends beyond the board's half diagonal: most sectors of a ring outside it are empty."""
    inner = 0.5 * board.diagonal_m + CLOUD_SEARCH.ring_inner_share * board.short_side_m
    outer = inner + CLOUD_SEARCH.ring_width_share * board.short_side_m
    owner, index = _neighbours(cKDTree(points), centers, outer)
    local = points[index] - centers[owner]
    basis = tangent_basis(normals)
    a = np.sum(local * basis[owner, 0], axis=1)
    b = np.sum(local * basis[owner, 1], axis=1)
    ring = (np.hypot(a, b) > inner) & (np.abs(np.sum(local * normals[owner], axis=1)) < tolerance_m)
    sector = (
        np.floor((np.arctan2(b, a) / (2 * np.pi) + 0.5) * CLOUD_SEARCH.sectors).astype(np.int64)
        % CLOUD_SEARCH.sectors
    )
    filled = np.zeros((len(centers), CLOUD_SEARCH.sectors), dtype=bool)
    filled[owner[ring], sector[ring]] = True
    return np.asarray(filled.sum(axis=1) <= CLOUD_SEARCH.sectors // 2)


def _settle(
    points: Array, tree: cKDTree, centers: Array, normals: Array, board: BoardSpec, tolerance_m: float
) -> list[tuple[Plane, Array]]:
    """Move each patch to the middle of its own plane's points, and keep one of each place."""
    places, facings = np.zeros((0, 3)), np.zeros((0, 3))
    settled: list[tuple[Plane, Array]] = []
    near_m = CLOUD_SEARCH.near_share * board.short_side_m
    for center, normal in zip(centers, normals, strict=True):
        if _known(center, normal, places, facings, near_m):
            continue
        on = np.zeros(0, dtype=bool)
        for _ in range(4):
            local = points[tree.query_ball_point(center, 0.5 * board.diagonal_m)]
            on = np.abs((local - center) @ normal) < tolerance_m
            if on.sum() < CLOUD_SEARCH.least_patch:
                break
            plane, moved = plane_through(local[on])
            shift = float(np.linalg.norm(moved - center))
            normal, center = plane.normal, moved
            if shift < CLOUD_SEARCH.settled_share * board.short_side_m:
                break
        if on.sum() >= CLOUD_SEARCH.least_patch and not _known(center, normal, places, facings, near_m):
            places, facings = np.vstack([places, center]), np.vstack([facings, normal])
            offset = float(normal @ center)
            settled.append((Plane(-normal, -offset) if offset < 0 else Plane(normal, offset), center))
    return settled


def _known(center: Array, normal: Array, places: Array, facings: Array, near_m: float) -> bool:
    gap = places - center
    close = np.sqrt(np.sum(gap * gap, axis=1)) < near_m
    return bool((close & (np.abs(facings @ normal) > CLOUD_SEARCH.same_facing)).any())


def _without_doubles(candidates: list[BoardCandidate], distance_m: float) -> list[BoardCandidate]:
    """Best first; a worse candidate near a better one is dropped."""
    kept: list[BoardCandidate] = []
    for candidate in candidates:
        if all(np.linalg.norm(candidate.outline.center - k.outline.center) > distance_m for k in kept):
            kept.append(candidate)
    return kept
