"""Planes through LiDAR points: RANSAC, then weighted least squares with covariance.

A LiDAR measures a range r along a known ray u, so its noise lies along the ray: a point on the plane
n . X = d has r = d / (n . u), and its distance from the plane carries the noise sigma_r |n . u|.
"""

from __future__ import annotations

import numpy as np

from stereocalib_core.geometry import Array, Plane
from stereocalib_core.lidar_camera.observation import PlaneEstimate

MINIMUM_POINTS = 10
RANGE_SIGMA_FLOOR_M = 1e-4
MIXED_FLOOR = 0.02
"""Least |n . u| in a weight: a ray that grazes the plane would otherwise count without limit."""


def tangent_basis(normal: Array) -> Array:
    """(..., 3) unit normals to (..., 2, 3): two unit vectors across each, smooth enough for local steps."""
    n = np.asarray(normal, dtype=np.float64)
    helper = np.where(np.abs(n[..., :1]) < 0.8, np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))
    first = np.cross(n, helper)
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    return np.stack([first, np.cross(n, first)], axis=-2)


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
    rays = points / np.linalg.norm(points, axis=1, keepdims=True)
    plane, _ = plane_through(points)
    weights = np.ones(len(points))
    sigma = range_sigma_m
    for _ in range(6):
        slant = np.maximum(np.abs(rays @ plane.normal), MIXED_FLOOR)
        along = plane.signed_distance(points) / slant
        spread = range_sigma_m or max(1.4826 * float(np.median(np.abs(along))), RANGE_SIGMA_FLOOR_M)
        huber = np.minimum(1.0, 2.5 * spread / np.maximum(np.abs(along), 1e-12))
        weights = huber / slant**2
        previous = plane
        plane, mean = plane_through(points, weights)
        if float(np.abs(plane.normal - previous.normal).max()) < 1e-12:
            break
    slant = np.maximum(np.abs(rays @ plane.normal), MIXED_FLOOR)
    distance = plane.signed_distance(points)
    if sigma is None:
        freedom = max(float(np.sum(weights * slant**2)) - 3.0, 1.0)
        sigma = max(float(np.sqrt(np.sum(weights * distance**2) / freedom)), RANGE_SIGMA_FLOOR_M)
    covariance = _plane_covariance(points, weights / sigma**2, plane, mean)
    at = mean if center is None else center
    on_plane = at - plane.normal * float(plane.signed_distance(at))
    return PlaneEstimate(plane, on_plane, covariance, float(np.sqrt(np.mean(distance**2))))


def _plane_covariance(points: Array, weights: Array, plane: Plane, mean: Array) -> Array:
    """(4, 4) covariance of (n, d) from weighted point-to-plane residuals."""
    basis = tangent_basis(plane.normal)
    across = (points - mean) @ basis.T
    J = np.column_stack([across, -np.ones(len(points))])
    information = (J * weights[:, None]).T @ J
    local = np.linalg.pinv(information, hermitian=True)
    # n = n0 + a e1 + b e2 turns the plane about the mean, so d = n . mean + shift.
    to_plane = np.zeros((4, 3))
    to_plane[:3, :2] = basis.T
    to_plane[3, :2] = basis @ mean
    to_plane[3, 2] = 1.0
    return to_plane @ local @ to_plane.T


def ransac_plane(points: Array, tolerance_m: float, seed: int = 0, trials: int = 200) -> Array:
    """(N, 3) points to the (N,) bool inliers of the plane with most of them; seeded, all trials at once."""
    rng = np.random.default_rng(seed)
    few = points if len(points) <= 1500 else points[rng.choice(len(points), 1500, replace=False)]
    corners = few[rng.integers(0, len(few), (trials, 3))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
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
