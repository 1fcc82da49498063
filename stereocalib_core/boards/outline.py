"""Does a board of known size stand here? Asked ray by ray, which suits sparse rings and dense clouds alike.

Every return is a ray that ended somewhere. Rays through the board must end on it, rays past its edge
must end behind it. The share of rays that obey is an overlap ratio, measured in the sensor's own view:
on the board inside / (on the board inside + through it inside + on its plane outside).
A wall fails outside, a smaller panel fails inside, whatever hides the board counts for nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from stereocalib_core.boards.observation import BoardSpec
from stereocalib_core.boards.planes import tangent_basis
from stereocalib_core.config.boards_search import OUTLINE
from stereocalib_core.geometry import Plane
from stereocalib_core.numeric.arrays import Array


@dataclass(frozen=True)
class Outline:
    """A rectangle of the board's size on a plane. score: 0...1; axes: (2, 3) unit, along width and height."""

    center: Array
    axes: Array
    score: float


@dataclass(frozen=True)
class RaysOnPlane:
    """Rays met with a plane. places: (N, 2) along `axes` from `origin` [m]; on, behind: (N,) bool; index: (N,)."""

    origin: Array
    axes: Array
    places: Array
    on: NDArray[np.bool_]
    behind: NDArray[np.bool_]
    index: NDArray[np.int64]


def meet(
    points: Array, plane: Plane, origin: Array, axes: Array, reach_m: float, tolerance_m: float
) -> RaysOnPlane:
    """Rays of (N, 3) points that pass the plane within `reach_m` of `origin`."""
    distance = np.linalg.norm(points, axis=1)
    far = float(np.linalg.norm(origin))
    cosine = points @ origin / np.maximum(distance * far, 1e-12)
    near = np.flatnonzero(cosine > np.cos(np.arctan2(reach_m, max(far - reach_m, 0.1))))
    rays = points[near] / distance[near, None]
    slant = rays @ plane.normal
    ok = slant > OUTLINE.least_slant
    near, rays, slant = near[ok], rays[ok], slant[ok]
    places = (rays * (plane.offset_m / slant)[:, None] - origin) @ axes.T
    gap = (distance[near] - plane.offset_m / slant) * slant
    inside = np.hypot(places[:, 0], places[:, 1]) < reach_m
    return RaysOnPlane(
        origin,
        axes,
        places[inside],
        np.abs(gap[inside]) < tolerance_m,
        gap[inside] > tolerance_m,
        near[inside],
    )


def fit_outline(points: Array, plane: Plane, start: Array, board: BoardSpec, tolerance_m: float) -> Outline:
    """The best place of the board's rectangle on a plane near `start` (3,), by a coarse and a fine search."""
    basis = tangent_basis(plane.normal)
    reach = 0.5 * board.diagonal_m + OUTLINE.rim_m
    rays = meet(points, plane, start, basis, reach + OUTLINE.search_share * board.short_side_m, tolerance_m)
    counts = np.flatnonzero(rays.on | rays.behind)
    order = np.random.default_rng(0).permutation(counts)
    square = abs(board.width_m - board.height_m) < OUTLINE.square_share * board.short_side_m
    turn = np.pi / 2 if square else np.pi
    steps = OUTLINE.steps_per_quarter * (1 if square else 2)
    angles: Array = np.arange(float(steps)) * turn / steps
    shifts: Array = np.arange(-2.0, 3.0) * OUTLINE.shift_share * board.short_side_m
    center, angle, score = np.zeros(2), 0.0, -1.0
    for spread, most in zip(
        OUTLINE.rounds, (OUTLINE.coarse_rays, OUTLINE.fine_rays, OUTLINE.fine_rays), strict=True
    ):
        used = order[:most]
        if 0.0 <= score < OUTLINE.hopeless:
            break
        center, angle, score = _search(
            rays.places[used], rays.on[used], board, center, angle + angles, shifts * spread
        )
        angles = np.linspace(-1, 1, OUTLINE.turns) * turn / steps * spread
    score *= _shown(rays, board, center, angle)
    c, s = np.cos(angle), np.sin(angle)
    return Outline(start + center @ basis, np.array([[c, s], [-s, c]]) @ basis, score)


def _shown(rays: RaysOnPlane, board: BoardSpec, center: Array, angle: float) -> float:
    """How far the points span the rectangle and how little of it is hidden, 0...1: a mere corner is no board."""
    c, s = np.cos(angle), np.sin(angle)
    places = (rays.places - center) @ np.array([[c, -s], [s, c]])
    half = np.array([board.width_m, board.height_m]) / 2
    inside = (np.abs(places) < half).all(axis=1)
    on = inside & rays.on
    if on.sum() < OUTLINE.least_hits:
        return 0.0
    extent = float(
        (
            np.ptp(
                np.quantile(places[on], (OUTLINE.extent_quantile, 1 - OUTLINE.extent_quantile), axis=0),
                axis=0,
            )
            / (2 * half)
        ).min()
    )
    visible = float(on.sum() / (inside & ~rays.behind).sum())
    return min(1.0, extent / OUTLINE.least_extent) * min(1.0, visible / OUTLINE.least_visible)


def _search(
    places: Array, on: NDArray[np.bool_], board: BoardSpec, center: Array, angles: Array, shifts: Array
) -> tuple[Array, float, float]:
    """Best (center (2,), angle, score) over a grid; equal scores are averaged: gaps between rings do not pull."""
    half = np.array([board.width_m, board.height_m]) / 2
    sy, sx = np.meshgrid(shifts, shifts, indexing="ij")
    offsets = np.stack([sx.ravel(), sy.ravel()], axis=1)
    scores = overlaps(places - center, on, half, OUTLINE.edge_share * board.short_side_m, angles, offsets)
    angle = int(np.argmax(scores.max(axis=1)))
    top = float(scores[angle].max())
    middle = offsets[scores[angle] >= top - OUTLINE.equal_score].mean(axis=0)
    c, s = np.cos(angles[angle]), np.sin(angles[angle])
    return center + np.array([[c, -s], [s, c]]) @ middle, float(angles[angle]), top


@njit(cache=True, nogil=True)
def overlaps(
    places: Array, on: NDArray[np.bool_], half: Array, edge_m: float, angles: Array, offsets: Array
) -> Array:
    """(N, 2) ray places, (N,) on the plane, A angles and (O, 2) shifts to (A, O) overlap ratios.

    Compiled, because it is asked for some hundred patches of every cloud: 15 times quicker.
    """
    result = np.zeros((len(angles), len(offsets)))
    for i in range(len(angles)):
        c, s = np.cos(angles[i]), np.sin(angles[i])
        for j in range(len(offsets)):
            hit, through, past = 0, 0, 0
            for k in range(len(places)):
                x = places[k, 0] * c + places[k, 1] * s - offsets[j, 0]
                y = places[k, 1] * c - places[k, 0] * s - offsets[j, 1]
                depth = min(half[0] - abs(x), half[1] - abs(y))
                if depth > edge_m:
                    if on[k]:
                        hit += 1
                    else:
                        through += 1
                elif depth < -edge_m and on[k]:
                    past += 1
            result[i, j] = hit / max(hit + through + past, 1)
    return result


def rays_inside(rays: RaysOnPlane, board: BoardSpec, margin_m: float) -> NDArray[np.bool_]:
    """(N,) whether a ray passes the board `margin_m` inside its edge; `rays` must lie on the board's own axes."""
    return (np.abs(rays.places[:, 0]) < board.width_m / 2 - margin_m) & (
        np.abs(rays.places[:, 1]) < board.height_m / 2 - margin_m
    )
