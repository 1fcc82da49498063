"""The road of the frame before, seen from where the camera is now.

A plane n . X = h of the camera before is n' . X = h' for the camera now, n' = R n, h' = h + n' . t, when the motion
between both is T_current_previous = (R, t). The motion is that of all points by their measured disparities, so that no
road is needed to know it, and nothing that comes later.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from stereocalib_core.back.odometry.packing import PackedTracks
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.small_algebra import rotation_from_vector


class Moved(NamedTuple):
    """motion: (6,) rotation vector [rad], translation [m] of T_current_previous; covariance: (6, 6)."""

    motion: Array
    covariance: Array

    @property
    def travel_m(self) -> float:
        """Length of the way [m]."""
        return float(np.linalg.norm(self.motion[3:]))


def motions(tracks: PackedTracks) -> list[Moved | None]:
    """N motions from the frame just before, None where there is none."""
    found, covariance = tracks.stereo_motion, tracks.stereo_covariance
    standing = np.zeros(6)
    return [
        Moved(standing if tracks.still[i] else found[i, :6], covariance[i])
        if i > 0 and found[i, 6] > 0.0 and tracks.previous[i] == i - 1
        else None
        for i in range(len(tracks))
    ]


def carry(values: Array, moved: Moved) -> tuple[Array, Array, Array]:
    """Height [m], pitch, roll [rad] over the road of before as seen now (3,), how they follow those of before (3, 3),
    and the covariance (3, 3) that the motion's own brings, to first order in a small rotation."""
    R, t = rotation_from_vector(moved.motion[:3]), moved.motion[3:]
    (cp, sp), (cr, sr) = ((math.cos(a), math.sin(a)) for a in values[1:].tolist())
    n = R @ np.array([-sr, cr * cp, cr * sp])
    by_angles = R @ np.array([[0.0, -cr], [-cr * sp, -sr * cp], [cr * cp, -sr * sp]])
    x, y, z = n.tolist()
    # of height, pitch and roll by the normal
    reach = y * y + z * z
    J = np.array([t, [0.0, -z / reach, y / reach], [-1.0 / math.sqrt(reach), 0.0, 0.0]])
    by_values = np.column_stack([[1.0, 0.0, 0.0], J @ by_angles])
    by_motion = np.zeros((3, 6))
    by_motion[:, :3] = J @ np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
    by_motion[0, 3:] = n
    found = np.array([float(values[0]) + float(n @ t), math.atan2(z, y), -math.asin(x)])
    return found, by_values, by_motion @ moved.covariance @ by_motion.T
