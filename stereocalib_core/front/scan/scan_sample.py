"""What is kept of a LiDAR scan and of the pictures of the same moment, so that one can be held against the other.

A road fixes three of the six between LiDAR and camera. The other three show where depth breaks: a beam that leaves
a near thing does so where the disparity breaks and, to the pixel, where the picture has its contrast (Levinson &
Thrun, "Automatic online calibration of cameras and lasers", RSS 2013, with the stereo pair's own depth added: an
edge has a disparity and a side, and only its like is its match). What is kept does not depend on how well the
calibration at hand is: edges of the scan and edges of the pictures each for themselves, so that the back end can
put the scan anywhere. The same for surfaces: points of the scan and small planes of the disparity map.

The scan is kept as it was recorded; the back end knows how the car moved while it was swept.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.config import ScanSampleConfig
from stereocalib_core.front.scan import sample_kernels as kernels
from stereocalib_core.front.scan.view import ScanView
from stereocalib_core.geometry import Array, Extrinsics, StereoCamera, image_to_road, invert_transform
from stereocalib_core.results import DisparityMap, ScanSample


def sample_scan(
    view: ScanView,
    left: NDArray[np.uint8],
    disparity: DisparityMap,
    camera: StereoCamera,
    road: Extrinsics | None,
    config: ScanSampleConfig,
    sweep: float | None = None,
) -> ScanSample:
    """One scan, as far as the left picture (H, W) may show it, and that picture with its disparity.

    road: what lies on it is no surface to compare, since the road has a comparison of its own; None = not known.
    sweep: as `StereoFrame.lidar_sweep`.
    """
    T, gap = view.T_camera_lidar, float(np.deg2rad(config.beam_step_deg))
    jump, least = (config.jump_px, config.jump_share), config.least_disparity_px
    seen = beam_after_beam(view.points, config)
    focal_baseline = camera.focal_px * camera.baseline_m
    edges = kernels.beam_edges(seen, T, focal_baseline, least, jump, gap, config.beam_tilt)
    points = kernels.smooth_points(seen, config.straight_m, gap, config.point_every)
    step = disparity.step_px
    broken = kernels.picture_edges(
        *(disparity.values, step, left, max(config.row_px // step, 1)),
        *(least, jump, config.reach_px),
    )
    planes = kernels.patches(
        *(disparity.values, step, max(config.patch_px // step, 3)),
        *(config.patch_share, config.patch_rms_px, least),
    )
    if road is not None:
        on_camera = points @ T[:3, :3].T + T[:3, 3]
        to_road = invert_transform(road.T_camera_road)
        points = points[on_camera @ to_road[1, :3] + to_road[1, 3] < -config.clear_of_road_m]
        over = image_to_road(camera, road, planes[:, 0], planes[:, 1], planes[:, 2])[:, 1]
        planes = planes[over < -config.clear_of_road_m]
    return ScanSample.pack(
        T,
        _thinned(edges, config.most_edges),
        _thinned(broken, config.most_edges),
        _thinned(points, config.most_points),
        _thinned(planes, config.most_points),
        sweep,
    )


def beam_after_beam(points: NDArray[np.float32], config: ScanSampleConfig) -> NDArray[np.float32]:
    """(M, 3) points with neighbours of one beam beside each other: as they are where most already are, else sorted.

    Drivers that write a cloud firing by firing put one point of every beam in a row; beams are then told by elevation.
    """
    if len(points) < 2 or kernels.neighbours_share_beams(points, config.beam_tilt):
        return points
    rise = points[:, 2] / np.linalg.norm(points, axis=1)
    beam = np.round(rise / config.beam_tilt).astype(np.int64)
    azimuth = np.arctan2(points[:, 1], points[:, 0])
    return np.ascontiguousarray(points[np.lexsort((azimuth, beam))])


def _thinned(rows: Array, most: int) -> Array:
    """(N, k) rows to at most `most` of them, evenly chosen."""
    if len(rows) <= most:
        return rows
    return rows[np.arange(most) * len(rows) // most]


def warm_up() -> None:
    """Compile the loops by a small made-up scene."""
    camera = StereoCamera(64, 48, 50.0, 31.5, 23.5, 0.5)
    values = np.full((24, 32), 5.0, np.float32)
    values[:, 12:20] = 12.0
    azimuth = np.linspace(-0.5, 0.5, 200)
    ranges = np.where(np.abs(azimuth) < 0.1, 2.1, 5.0)
    scan = np.stack([ranges * np.cos(azimuth), ranges * np.sin(azimuth), 0 * ranges, 0 * ranges], axis=1)
    axes = np.eye(4)
    axes[:3, :3] = [[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]
    picture = np.tile(np.arange(64, dtype=np.uint8), (48, 1))
    config = ScanSampleConfig()
    view = ScanView.of(scan.astype(np.float32), camera, axes, config)
    sample_scan(view, picture, DisparityMap(values, 2), camera, None, config)
