"""The road that a LiDAR scan shows in the car's own lane, against the stereo road of the same frame.

The scan is carried by the calibration into the stereo road's frame, where the road should be Y = 0, and the plane
Y = a + b Z + c X is fitted to the lane: a is what the LiDAR adds to the height, -b to the pitch, c to the roll.

Sampling. The rings of a spinning LiDAR crowd at its feet: rays are even in angle, so one point of a flat road
stands for an area that grows as r^3. Points are weighted by that area; what is fitted is the least-squares plane
of the surface, as the stereo road is, and not of the rings. No road is a plane (crown, dips), so both fits must
also weigh distance alike: the noise of stereo heights per area grows as Z^5 (a patch's depth as Z^2, its area as
Z^3) and outweighs the unevenness beyond `even_m`; the LiDAR's weight fades in the same way.

Motion within a sweep is left in. Travel moves points along the road, which leaves its plane where it is, and the
lane is swept within 10 ms of its middle; a body that pitches by 3 deg/s in that time turns the plane by 0.05 deg
at most, to and fro about zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.config import RoadCheckConfig
from stereocalib_core.frames import StereoFrame
from stereocalib_core.geometry import Array, Extrinsics, Plane, invert_transform
from stereocalib_core.results import FrameResult, RoadResidual

_TO_EXTRINSICS = np.diag([1.0, -1.0, 1.0])
"""d(height, pitch, roll) / d(a, b, c), small angles."""


@dataclass(frozen=True)
class LanePlane:
    """Y = a + b Z + c X [m] over the lane. coefficients (3,) a, b, c; covariance (3, 3).

    points: how many took part. agreement: share of the lane's area that lies on the plane, 0...1.
    """

    coefficients: Array
    covariance: Array
    points: int
    agreement: float


def scan_residual(
    frame: StereoFrame, result: FrameResult, T_camera_lidar: Array | None, config: RoadCheckConfig
) -> RoadResidual | None:
    """The LiDAR's road minus the stereo road of one frame; None without a scan, a stereo road or a clear lane.

    T_camera_lidar: (4, 4), LiDAR to camera coordinates [m].
    """
    if frame.lidar is None or result.road is None or T_camera_lidar is None:
        return None
    stereo = result.road.extrinsics
    near = max(config.near_m, result.road.range_m[0])
    far = min(config.far_m, result.road.range_m[1])
    points = lane_points(frame.lidar, T_camera_lidar, stereo, near, far, config)
    plane = fit_lane(points, config)
    if plane is None:
        return None
    seen = _extrinsics(plane.coefficients, stereo)
    values = np.array(
        [
            seen.height_m - stereo.height_m,
            seen.pitch_rad - stereo.pitch_rad,
            seen.roll_rad - stereo.roll_rad,
        ]
    )
    lidar = _TO_EXTRINSICS @ plane.covariance @ _TO_EXTRINSICS
    floor = np.diag([config.systematic_height_m, *[np.deg2rad(config.systematic_angle_deg)] * 2]) ** 2
    return RoadResidual(values, lidar + floor + result.road.covariance, plane.points)


def lane_points(
    scan: NDArray[np.float32],
    T_camera_lidar: Array,
    stereo: Extrinsics,
    near_m: float,
    far_m: float,
    config: RoadCheckConfig,
) -> Array:
    """(N, 4) LiDAR points to those over the lane, (M, 3) X, Y, Z [m] in the frame of the stereo road.

    What a misplaced LiDAR could still show as road is kept: `max_offset_m` and `max_tilt_deg` off the stereo road.
    """
    T = invert_transform(stereo.T_camera_road) @ T_camera_lidar
    rotation, shift = T[:3, :3].astype(np.float32), T[:3, 3].astype(np.float32)
    xyz = scan[:, :3]
    z = xyz @ rotation[2] + shift[2]
    # An azimuth that the lane does not reach is the cheapest thing to rule out in a scan of 120,000 points.
    ahead = xyz[(z > near_m) & (z < far_m)]
    road = ahead @ rotation.T + shift
    reach = config.max_offset_m + np.tan(np.deg2rad(config.max_tilt_deg)) * road[:, 2]
    inside = (np.abs(road[:, 0]) < config.lane_half_width_m) & (np.abs(road[:, 1]) < reach)
    return road[inside].astype(np.float64)


def fit_lane(points: Array, config: RoadCheckConfig) -> LanePlane | None:
    """(N, 3) X, Y, Z [m] over the lane to its plane; None where it is too thinly seen or mostly no plane."""
    if len(points) < config.min_points:
        return None
    x, y, z = points.T
    J = np.column_stack([np.ones(len(points)), z, x])
    area = (x**2 + z**2) ** 1.5
    weights = area / (1.0 + (z / config.even_m) ** 5)
    weights /= weights.sum()
    start = _vote(J, y, weights, config)
    if start is None:
        return None
    coefficients, robust = _refine(J, y, weights, start, config)
    residual = y - J @ coefficients
    near_plane = np.abs(residual) < config.agree_height_m
    agreement = float(weights[near_plane].sum())
    covariance = _covariance(J, residual, weights * robust, x, z, config)
    if agreement < config.min_agreement or covariance is None:
        return None
    return LanePlane(coefficients, covariance, int(np.count_nonzero(robust)), agreement)


def _vote(J: Array, y: Array, weights: Array, config: RoadCheckConfig) -> Array | None:
    """(3,) plane on which most of the lane's area lies, of planes through three points each; seeded."""
    rng = np.random.default_rng(len(y))
    few = rng.choice(len(y), min(len(y), config.vote_points), p=weights)
    corners = rng.choice(few, (config.vote_trials, 3))
    matrices = J[corners]
    wide = np.abs(np.linalg.det(matrices)) > 0.5
    if not wide.any():
        return None
    planes = np.linalg.solve(matrices[wide], y[corners[wide], None])[..., 0]
    steepest = np.tan(np.deg2rad(config.max_tilt_deg))
    level = (np.abs(planes[:, 0]) < config.max_offset_m) & (np.abs(planes[:, 1:]) < steepest).all(axis=1)
    if not level.any():
        return None
    planes = planes[level]
    counts = np.count_nonzero(np.abs(y[few] - planes @ J[few].T) < config.agree_height_m, axis=1)
    return np.asarray(planes[int(np.argmax(counts))])


def _refine(J: Array, y: Array, weights: Array, start: Array, config: RoadCheckConfig) -> tuple[Array, Array]:
    """(3,) robust least squares from `start`, and the (N,) Tukey weights it ends with."""
    coefficients = start
    robust = np.ones(len(y))
    for _ in range(config.rounds):
        residual = y - J @ coefficients
        on_plane = np.abs(residual) < config.agree_height_m
        spread = 1.4826 * float(np.median(np.abs(residual[on_plane]))) if on_plane.any() else 0.0
        limit = config.tukey * max(spread, config.min_spread_m)
        robust = np.clip(1.0 - (residual / limit) ** 2, 0.0, None) ** 2
        w = weights * robust
        try:
            coefficients = np.linalg.solve((J * w[:, None]).T @ J, (J * w[:, None]).T @ y)
        except np.linalg.LinAlgError:
            return coefficients, np.zeros(len(y))
    return coefficients, robust


def _covariance(
    J: Array, residual: Array, w: Array, x: Array, z: Array, config: RoadCheckConfig
) -> Array | None:
    """(3, 3) from the residuals found, those of one cell of the road taken to rise and fall together."""
    cell = np.floor(z / config.cell_m).astype(np.int64) * 1000 + np.floor(x / config.cell_m).astype(np.int64)
    cells, inverse = np.unique(cell[w > 0], return_inverse=True)
    if len(cells) < config.min_cells:
        return None
    scores = J[w > 0] * (w * residual)[w > 0, None]
    sums = np.stack([np.bincount(inverse, scores[:, k]) for k in range(3)], axis=1)
    H_inv = np.linalg.inv((J * w[:, None]).T @ J)
    return np.asarray(H_inv @ (sums.T @ sums) @ H_inv * len(cells) / (len(cells) - 3.0))


def _extrinsics(coefficients: Array, stereo: Extrinsics) -> Extrinsics:
    """The lane plane in the frame of the stereo road to the camera's extrinsics over it."""
    a, b, c = (float(value) for value in coefficients)
    length = np.sqrt(1.0 + b * b + c * c)
    T = stereo.T_camera_road
    normal = T[:3, :3] @ (np.array([-c, 1.0, -b]) / length)
    return Extrinsics.from_plane(Plane(normal, a / length + float(normal @ T[:3, 3])))
