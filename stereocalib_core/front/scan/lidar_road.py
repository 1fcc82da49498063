"""The road that a LiDAR scan shows, against the stereo road of the same frame.

The scan is carried by the calibration into the stereo road's frame, where the road should be Y = 0, and the plane
Y = a + b Z + c X is fitted: a is what the LiDAR adds to the height, -b to the pitch, c to the roll.

Which road. Where the stereo road was aligned patch by patch (`road_surface`), the scan is compared with the same
patches: Y is counted from the surface that they show, so that camber, dips and kerbs, which are the road's and no
sensor's, cancel. Elsewhere the car's own lane is taken, where the road is flattest, and what lane and stereo road may
differ by is in the stereo road's covariance.

Sampling. The rings of a spinning LiDAR crowd at its feet: rays are even in angle, so one point of a flat road
stands for an area that grows as r^3. Points are weighted by that area; what is fitted is the least-squares plane
of the surface, as the stereo road is, and not of the rings. No road is a plane (crown, dips), so both fits must
also weigh distance alike: the noise of stereo heights per area grows as Z^5 (a patch's depth as Z^2, its area as
Z^3) and outweighs the unevenness beyond `even_m`; the LiDAR's weight fades in the same way.

Motion within a sweep is left in. Travel moves points along the road, which leaves its plane where it is, and the
road ahead is swept within 10 ms of its middle; a body that pitches by 5 deg/s in that time turns the plane by 0.05
deg, to and fro about zero, which is in sigma.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.config import RoadCheckConfig
from stereocalib_core.frames import StereoFrame
from stereocalib_core.front.scan import lane_kernels as kernels
from stereocalib_core.front.scan.road_surface import RoadSurface
from stereocalib_core.geometry import Extrinsics, Plane, StereoCamera, invert_transform
from stereocalib_core.numeric.arrays import Array
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
    frame: StereoFrame,
    result: FrameResult,
    T_camera_lidar: Array | None,
    config: RoadCheckConfig,
    surface: RoadSurface | None = None,
) -> RoadResidual | None:
    """The LiDAR's road minus the stereo road of one frame; None without a scan, a stereo road or a clear view of it.

    T_camera_lidar: (4, 4), LiDAR to camera coordinates [m]. surface: what the stereo road was fitted to; None = the
    plane alone is known, and the lane is compared with it.
    """
    if frame.lidar is None or result.road is None or T_camera_lidar is None:
        return None
    stereo = result.road.extrinsics
    if surface is not None:
        points = surface_points(frame.lidar, T_camera_lidar, stereo, surface, config)
    else:
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
    covariance = _TO_EXTRINSICS @ plane.covariance @ _TO_EXTRINSICS
    covariance += np.diag([config.systematic_height_m, *[np.deg2rad(config.systematic_angle_deg)] * 2]) ** 2
    if surface is None:
        covariance += result.road.covariance + result.road.bend_covariance
    return RoadResidual(values, covariance, plane.points)


def surface_points(
    scan: NDArray[np.float32],
    T_camera_lidar: Array,
    stereo: Extrinsics,
    surface: RoadSurface,
    config: RoadCheckConfig,
) -> Array:
    """(N, 4) LiDAR points to those over the stereo road's patches, (M, 3) X, Y, Z [m], Y from the patches' surface.

    What a misplaced LiDAR could still show as road is kept, as in `lane_points`.
    """
    T_camera_road, camera = stereo.T_camera_road, surface.camera
    return kernels.gather_on_tiles(
        np.ascontiguousarray(scan), invert_transform(T_camera_road) @ T_camera_lidar, T_camera_road,
        (camera.focal_px, camera.cx_px, camera.cy_px), surface.tiles, surface.corner, surface.tile, surface.over_m,
        config.max_offset_m, float(np.tan(np.deg2rad(config.max_tilt_deg))),
    )  # fmt: skip


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
    slope = float(np.tan(np.deg2rad(config.max_tilt_deg)))
    lane = (near_m, far_m, config.lane_half_width_m)
    return kernels.gather(np.ascontiguousarray(scan), T, *lane, config.max_offset_m, slope)


def fit_lane(points: Array, config: RoadCheckConfig) -> LanePlane | None:
    """(N, 3) X, Y, Z [m] over the lane to its plane; None where it is too thinly seen or mostly no plane."""
    if len(points) < config.min_points:
        return None
    points = kernels.without_obstacles(points, config.obstacle_cell_m, config.obstacle_height_m)
    if len(points) < config.min_points:
        return None
    x, z = points[:, 0], points[:, 2]
    weights = (x**2 + z**2) ** 1.5 / (1.0 + (z / config.even_m) ** 5)
    weights /= weights.sum()
    start = _vote(points, weights, config)
    if start is None:
        return None
    try:
        coefficients, robust = kernels.refine(
            points, weights, start, config.agree_height_m, config.tukey, config.min_spread_m, config.rounds,
            config.least_change,
        )  # fmt: skip
        residual = kernels.residuals(points, coefficients)
        covariance = _covariance(points, residual, weights * robust, config)
    except np.linalg.LinAlgError:
        return None
    agreement = float(weights[np.abs(residual) < config.agree_height_m].sum())
    if agreement < config.min_agreement or covariance is None:
        return None
    return LanePlane(coefficients, covariance, int(np.count_nonzero(robust)), agreement)


def _vote(points: Array, weights: Array, config: RoadCheckConfig) -> Array | None:
    """(3,) plane on which most of the lane's area lies, of planes through three points each; seeded."""
    rng = np.random.default_rng(len(points))
    few = points[rng.choice(len(points), min(len(points), config.vote_points), p=weights)]
    corners = few[rng.integers(0, len(few), (config.vote_trials, 3))]
    matrices = np.stack([np.ones(corners.shape[:2]), corners[..., 2], corners[..., 0]], axis=-1)
    wide = np.abs(np.linalg.det(matrices)) > 0.5
    if not wide.any():
        return None
    planes = np.linalg.solve(matrices[wide], corners[wide][..., 1, None])[..., 0]
    steepest = np.tan(np.deg2rad(config.max_tilt_deg))
    level = (np.abs(planes[:, 0]) < config.max_offset_m) & (np.abs(planes[:, 1:]) < steepest).all(axis=1)
    if not level.any():
        return None
    planes = np.ascontiguousarray(planes[level])
    return np.asarray(planes[int(np.argmax(kernels.votes(few, planes, config.agree_height_m)))])


def _covariance(points: Array, residual: Array, weights: Array, config: RoadCheckConfig) -> Array | None:
    """(3, 3) from the residuals found, those of one cell of the road taken to rise and fall together."""
    scores, cells = kernels.clustered_scores(points, weights * residual, config.cell_m)
    if cells < config.min_cells:
        return None
    H_inv = np.linalg.inv(kernels.normal_equations(points, weights)[0])
    return np.asarray(H_inv @ scores @ H_inv * cells / (cells - 3.0))


def _extrinsics(coefficients: Array, stereo: Extrinsics) -> Extrinsics:
    """The lane plane in the frame of the stereo road to the camera's extrinsics over it."""
    a, b, c = (float(value) for value in coefficients)
    length = np.sqrt(1.0 + b * b + c * c)
    T = stereo.T_camera_road
    normal = T[:3, :3] @ (np.array([-c, 1.0, -b]) / length)
    return Extrinsics.from_plane(Plane(normal, a / length + float(normal @ T[:3, 3])))


def warm_up() -> None:
    """Compile the loops by a small made-up lane."""
    z, x = (grid.ravel() for grid in np.meshgrid(np.linspace(5.0, 19.0, 30), np.linspace(-1.5, 1.5, 10)))
    scan = np.stack([x, np.zeros_like(x), z, np.zeros_like(x)], axis=1).astype(np.float32)
    config = RoadCheckConfig()
    level = Extrinsics(0.0, 0.0, 0.0)
    fit_lane(lane_points(scan, np.eye(4), level, 4.0, 20.0, config), config)
    camera = StereoCamera(64, 48, 50.0, 31.5, 23.5, 0.5)
    tiles, tile = np.zeros((1, 1), np.int32), np.array([13.0, 7.0])
    surface = RoadSurface(camera, tiles, np.array([31.5, 23.5]), tile, np.zeros(1), (4.0, 20.0))
    surface_points(scan, np.eye(4), level, surface, config)
