"""The six numbers by which a LiDAR stands otherwise than calibrated, and what they do to T_camera_lidar.

Order everywhere: height [m], pitch, roll, yaw [rad], x, z [m], all in the camera's axes and with the signs of its
extrinsics: the LiDAR stands higher, looks further down, leans further right, looks further left, stands further
right and further ahead than the calibration says; angles turn it about its own origin.
"""

from __future__ import annotations

import numpy as np

from stereocalib_core.geometry import rotation_x, rotation_y, rotation_z
from stereocalib_core.numeric.arrays import Array

AXES = ("height", "pitch", "roll", "yaw", "x", "z")
HEIGHT, PITCH, ROLL, YAW, X, Z = range(6)
IS_ANGLE = np.array([False, True, True, True, False, False])


def moved(T_camera_lidar: Array, six: Array) -> Array:
    """(4, 4) where the LiDAR truly is, of where it was calibrated to be and (6,) how it stands otherwise."""
    height, pitch, roll, yaw, x, z = (float(value) for value in six)
    turn = rotation_x(pitch) @ rotation_z(roll) @ rotation_y(yaw)
    T = np.array(T_camera_lidar, dtype=np.float64)
    T[:3, :3] = turn.T @ T[:3, :3]
    T[:3, 3] += [x, -height, z]
    return T


def shown_by_road(normal: Array, T_camera_lidar: Array) -> Array:
    """(3, 6) d(height, pitch, roll that the road shows of the LiDAR) / d(six), to first order.

    normal: (3,) of the road in the camera frame, pointing down. A turn about the LiDAR's own origin moves the road
    that the calibration makes of its scan by the lever from there to the camera.
    """
    n, t = normal, T_camera_lidar[:3, 3]
    J = np.zeros((3, 6))
    J[0, [HEIGHT, X, Z]] = n[1], -n[0], -n[2]
    J[0, [PITCH, ROLL, YAW]] = n[1] * t[2] - n[2] * t[1], n[0] * t[1] - n[1] * t[0], n[2] * t[0] - n[0] * t[2]
    J[1, [PITCH, YAW]] = 1.0, -n[0]
    J[2, [ROLL, YAW]] = 1.0, -n[2]
    return J
