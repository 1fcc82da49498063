"""Does a board of known size stand here? Asked ray by ray, which suits sparse rings and dense clouds alike.

Every return is a ray that ended somewhere. Rays through the board must end on it, rays past its edge
must end behind it. The share of rays that obey is an overlap ratio, measured in the sensor's own view:
on the board inside / (on the board inside + through it inside + on its plane outside).
A wall fails outside, a smaller panel fails inside, whatever hides the board counts for nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.geometry import Array, Plane
from stereocalib_core.lidar_camera.observation import BoardSpec
from stereocalib_core.lidar_camera.planes import tangent_basis

RIM_M = 0.20
EDGE_SHARE = 0.025
COARSE_RAYS, FINE_RAYS = 300, 1200
LEAST_VISIBLE, LEAST_EXTENT = 0.7, 0.6


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
    ok = slant > 0.03
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
    reach = 0.5 * board.diagonal_m + RIM_M
    rays = meet(points, plane, start, basis, reach + 0.15 * board.short_side_m, tolerance_m)
    counts = np.flatnonzero(rays.on | rays.behind)
    order = np.random.default_rng(0).permutation(counts)
    square = abs(board.width_m - board.height_m) < 0.02 * board.short_side_m
    turn = np.pi / 2 if square else np.pi
    steps = 15 if square else 30
    angles = np.arange(steps) * turn / steps
    shifts = np.arange(-3, 4) * 0.06 * board.short_side_m
    center, angle, score = np.zeros(2), 0.0, -1.0
    for spread, most in ((1.0, COARSE_RAYS), (0.35, FINE_RAYS), (0.12, FINE_RAYS)):
        used = order[:most]
        center, angle, score = _search(
            rays.places[used], rays.on[used], board, center, angle + angles, shifts * spread
        )
        angles = np.linspace(-1, 1, 7) * turn / steps * spread
    score *= _shown(rays, board, center, angle)
    c, s = np.cos(angle), np.sin(angle)
    return Outline(start + center @ basis, np.array([[c, s], [-s, c]]) @ basis, score)


def _shown(rays: RaysOnPlane, board: BoardSpec, center: Array, angle: float) -> float:
    """How far the points span the rectangle and how little of it is hidden, 0...1: a corner of something is no board."""
    c, s = np.cos(angle), np.sin(angle)
    places = (rays.places - center) @ np.array([[c, -s], [s, c]])
    half = np.array([board.width_m, board.height_m]) / 2
    inside = (np.abs(places) < half).all(axis=1)
    on = inside & rays.on
    if on.sum() < 6:
        return 0.0
    extent = float((np.ptp(np.quantile(places[on], (0.02, 0.98), axis=0), axis=0) / (2 * half)).min())
    visible = float(on.sum() / (inside & ~rays.behind).sum())
    return min(1.0, extent / LEAST_EXTENT) * min(1.0, visible / LEAST_VISIBLE)


def _search(
    places: Array, on: NDArray[np.bool_], board: BoardSpec, center: Array, angles: Array, shifts: Array
) -> tuple[Array, float, float]:
    """Best (center (2,), angle, score) over a grid; equal scores are averaged, so gaps between rings do not pull."""
    half = np.array([board.width_m, board.height_m]) / 2
    edge = EDGE_SHARE * board.short_side_m
    sy, sx = np.meshgrid(shifts, shifts, indexing="ij")
    offsets = np.stack([sx.ravel(), sy.ravel()], axis=1)
    best: tuple[float, float, Array] = (-1.0, 0.0, center)
    for angle in angles:
        c, s = np.cos(angle), np.sin(angle)
        turned = (places - center) @ np.array([[c, -s], [s, c]])
        depth = np.minimum(
            half[0] - np.abs(turned[None, :, 0] - offsets[:, None, 0]),
            half[1] - np.abs(turned[None, :, 1] - offsets[:, None, 1]),
        )
        inside, outside = depth > edge, depth < -edge
        hit = (inside & on).sum(axis=1)
        score = hit / np.maximum(hit + (inside & ~on).sum(axis=1) + (outside & on).sum(axis=1), 1)
        top = float(score.max())
        if top > best[0]:
            middle = offsets[score >= top - 0.004].mean(axis=0)
            best = (top, float(angle), center + np.array([[c, -s], [s, c]]) @ middle)
    return best[2], best[1], best[0]


def rays_inside(rays: RaysOnPlane, board: BoardSpec, margin_m: float) -> NDArray[np.bool_]:
    """(N,) whether a ray passes the board `margin_m` inside its edge; `rays` must lie on the board's own axes."""
    return (np.abs(rays.places[:, 0]) < board.width_m / 2 - margin_m) & (
        np.abs(rays.places[:, 1]) < board.height_m / 2 - margin_m
    )
