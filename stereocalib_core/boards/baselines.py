"""The two methods that the paper compares with, each as its authors state it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stereocalib_core.boards.rotations import nearest_rotation
from stereocalib_core.geometry import transform
from stereocalib_core.numeric.arrays import Array


def unnikrishnan_hebert(
    normals_camera: Array, offsets_camera: Array, normals_lidar: Array, offsets_lidar: Array
) -> Array:
    """Unnikrishnan and Hebert, CMU-RI-TR-05-09 (2005): T_camera_lidar from plane correspondences in two stages.

    Translation: t = (N_c^T N_c)^-1 N_c^T (d_c - d_l), from the camera's normals alone. Rotation: the one
    that brings the LiDAR's normals closest to the camera's, R = V U^T of the SVD of N_l^T N_c.
    """
    t = np.linalg.lstsq(normals_camera, offsets_camera - offsets_lidar, rcond=1e-6)[0]
    return transform(nearest_rotation(normals_camera.T @ normals_lidar), t)


def points_on_plane(clouds: Sequence[Array], normals_camera: Array, offsets_camera: Array) -> Array:
    """Zhang and Pless (2004) as Park et al. (2012) extend it to 3-D: T_camera_lidar from raw points on the planes.

    Every point p of board i satisfies n_i . (H p + t) = d_i, linear in the twelve numbers of H and t;
    the rotation nearest to H is taken last. clouds: M arrays (N_i, 3) [m]; needs 4 boards to be determined.
    """
    rows, targets = [], []
    for points, normal, offset in zip(clouds, normals_camera, offsets_camera, strict=True):
        # The triangular factor of the board's points poses the same least squares in four rows.
        factor: Array = np.asarray(np.linalg.qr(np.column_stack([points, np.ones(len(points))]), mode="r"))
        rows.append(np.hstack([np.kron(normal, factor[:, :3]), np.outer(factor[:, 3], normal)]))
        targets.append(factor[:, 3] * offset)
    solution = np.linalg.lstsq(np.vstack(rows), np.concatenate(targets), rcond=None)[0]
    return transform(nearest_rotation(solution[:9].reshape(3, 3)), solution[9:])
