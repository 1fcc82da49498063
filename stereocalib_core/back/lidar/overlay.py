"""Where a kept scan falls in the left picture, as calibrated and as found: data for a picture of before and after."""

from __future__ import annotations

import numpy as np

from stereocalib_core.geometry import StereoCamera
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.results import LidarPose, ScanSample


def edges_in_picture(sample: ScanSample, T_camera_lidar: Array, camera: StereoCamera) -> Array:
    """(K, 3) u, v [px] and side of the beam edges that fall into the left picture with the LiDAR at (4, 4)."""
    edges = sample.beam_edges
    placed = edges[:, :3] @ T_camera_lidar[:3, :3].T + T_camera_lidar[:3, 3]
    ahead = placed[:, 2] > 0.5
    seen = camera.project(placed[ahead])[:, :2]
    inside = (seen >= 0.0).all(axis=1) & (seen[:, 0] <= camera.width - 1) & (seen[:, 1] <= camera.height - 1)
    return np.column_stack([seen[inside], edges[ahead][inside, 3]])


def before_and_after(sample: ScanSample, pose: LidarPose, camera: StereoCamera) -> tuple[Array, Array]:
    """`edges_in_picture` with the LiDAR as calibrated, and as the drive found it."""
    found = edges_in_picture(sample, pose.T_camera_lidar, camera)
    return edges_in_picture(sample, pose.calibrated, camera), found
