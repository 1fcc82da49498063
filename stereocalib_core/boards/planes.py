"""Planes through LiDAR points: RANSAC, then weighted least squares with covariance.

A LiDAR measures a range r along a known ray u, so its noise lies along the ray: a point on the plane
n . X = d has r = d / (n . u), and its distance from the plane carries the noise sigma_r |n . u|.
"""

from __future__ import annotations

import numpy as np

from stereocalib_core.boards.observation import PlaneEstimate
from stereocalib_core.boards.rotations import cross
from stereocalib_core.config.boards import PLANE
from stereocalib_core.geometry import Plane
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.robust import mad_sigma


def tangent_basis(normal: Array) -> Array:
    """(..., 3) unit normals to (..., 2, 3): two unit vectors across each, smooth enough for local steps."""
    n = np.asarray(normal, dtype=np.float64)
    helper = np.where(np.abs(n[..., :1]) < 0.8, np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))
    first = cross(n, helper)
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    return np.stack([first, cross(n, first)], axis=-2)


def plane_through(points: Array, weights: Array | None = None) -> tuple[Plane, Array]:
    """(N, 3) points to the plane of least squared distance and their (weighted) mean; normal away from the origin."""
    w = np.ones(len(points)) if weights is None else weights
    mean = w @ points / w.sum()
    centred = points - mean
    normal = np.linalg.eigh((centred * w[:, None]).T @ centred)[1][:, 0]
    offset = float(normal @ mean)
    return (Plane(-normal, -offset) if offset < 0 else Plane(normal, offset)), mean


def fit_plane(
    points: Array, range_sigma_m: float | None = None, center: Array | None = None
) -> PlaneEstimate:
    """(N, 3) board points [m] to their plane: weighted least squares with ray noise, outliers held down (Huber).

    `range_sigma_m` None takes the noise from the scatter of the points. `center` (3,) is where the board's
    middle is thought to be (default: mean of the points); it is moved onto the plane.
    """
    reach = np.linalg.norm(points, axis=1)
    rays = points / reach[:, None]
    plane, _ = plane_through(points)
    H = np.zeros((3, 3))
    for _ in range(12):
        slant = np.maximum(rays @ plane.normal, PLANE.slant_floor)
        miss = reach - plane.offset_m / slant
        spread = range_sigma_m or max(mad_sigma(miss), PLANE.range_sigma_floor_m)
        weights = np.minimum(1.0, PLANE.huber * spread / np.maximum(np.abs(miss), 1e-12))
        # Derivatives at the point where the ray meets the plane, not at the noisy one: that would bias them.
        met = rays * (plane.offset_m / slant)[:, None]
        mean = (weights / slant**2) @ met / np.sum(weights / slant**2)
        basis = tangent_basis(plane.normal)
        J = np.column_stack([(met - mean) @ basis.T, -np.ones(len(met))]) / slant[:, None]
        H = (J * weights[:, None]).T @ J
        step = -np.linalg.lstsq(H, J.T @ (weights * miss), rcond=1e-14)[0]
        plane = _moved(plane, basis, mean, step)
        if float(np.abs(step).max()) < 1e-13:
            break
    sigma = range_sigma_m
    if sigma is None:
        freedom = max(float(weights.sum()) - 3.0, 1.0)
        sigma = max(float(np.sqrt(np.sum(weights * miss**2) / freedom)), PLANE.range_sigma_floor_m)
    covariance = _plane_covariance(H / sigma**2, plane, mean)
    at = points.mean(axis=0) if center is None else center
    on_plane = at - plane.normal * float(plane.signed_distance(at))
    rms = float(np.sqrt(np.mean(plane.signed_distance(points) ** 2)))
    return PlaneEstimate(plane, on_plane, covariance, rms)


def _moved(plane: Plane, basis: Array, about: Array, step: Array) -> Plane:
    """Tilted about a point on the plane by step[:2] [rad] and shifted along the normal by step[2] [m]."""
    normal = plane.normal + step[:2] @ basis
    normal /= np.linalg.norm(normal)
    offset = float(normal @ about) + (plane.offset_m - float(plane.normal @ about)) + float(step[2])
    return Plane(-normal, -offset) if offset < 0 else Plane(normal, offset)


def _plane_covariance(information: Array, plane: Plane, mean: Array) -> Array:
    """(4, 4) covariance of (n, d) from the (3, 3) information of two tilts about `mean` and a shift."""
    basis = tangent_basis(plane.normal)
    local = np.linalg.pinv(information, hermitian=True)
    # n = n0 + a e1 + b e2 turns the plane about the mean, so d = n . mean + shift.
    to_plane = np.zeros((4, 3))
    to_plane[:3, :2] = basis.T
    to_plane[3, :2] = basis @ mean
    to_plane[3, 2] = 1.0
    return to_plane @ local @ to_plane.T


def ransac_plane(
    points: Array, tolerance_m: float, seed: int = 0, trials: int = PLANE.ransac_trials
) -> Array:
    """(N, 3) points to the (N,) bool inliers of the plane with most of them; seeded, all trials at once."""
    rng = np.random.default_rng(seed)
    few = (
        points
        if len(points) <= PLANE.ransac_points
        else points[rng.choice(len(points), PLANE.ransac_points, replace=False)]
    )
    corners = few[rng.integers(0, len(few), (trials, 3))]
    normals = cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normals, axis=1)
    good = length > 1e-6
    normals, anchors = normals[good] / length[good, None], corners[good, 0]
    if not len(normals):
        return np.ones(len(points), dtype=bool)
    offsets = np.sum(normals * anchors, axis=1)
    counts = np.sum(np.abs(few @ normals.T - offsets) < tolerance_m, axis=0)
    best = int(np.argmax(counts))
    plane, inliers = Plane(normals[best], float(offsets[best])), np.zeros(len(points), dtype=bool)
    for _ in range(3):
        inliers = np.abs(plane.signed_distance(points)) < tolerance_m
        if inliers.sum() < 3:
            break
        plane, _ = plane_through(points[inliers])
    return inliers
