"""The part of a LiDAR scan that the left picture may show: what all that compares the two begins with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.config import ScanSampleConfig
from stereocalib_core.front.scan import sample_kernels as kernels
from stereocalib_core.geometry import Array, StereoCamera


@dataclass(frozen=True)
class ScanView:
    """Points of a scan in the picture and a margin about it, in the scan's order.

    points: (M, 3) float32 x, y, z [m] in the LiDAR's frame. seen: (M, 3) u, v and disparity [px] by `T_camera_lidar`
    (4, 4), the calibration.
    """

    points: NDArray[np.float32]
    seen: Array
    T_camera_lidar: Array

    @classmethod
    def of(
        cls, scan: NDArray[np.float32], camera: StereoCamera, T_camera_lidar: Array, config: ScanSampleConfig
    ) -> ScanView:
        """From a scan (N, 4) float32 x, y, z [m] and intensity."""
        lens = (
            *(float(camera.width), float(camera.height), camera.focal_px, camera.cx_px, camera.cy_px),
            camera.focal_px * camera.baseline_m,
        )
        T = np.ascontiguousarray(T_camera_lidar, dtype=np.float64)
        margin = config.margin * camera.width
        points, seen = kernels.in_view(np.ascontiguousarray(scan), T, lens, margin, config.least_range_m)
        return cls(points, seen, T)
