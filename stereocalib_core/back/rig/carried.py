"""The road of the frame before, seen from where the camera is now.

A plane n . X = h of the camera before is n' . X = h' for the camera now, n' = R n, h' = h + n' . t, when the motion
between both is T_current_previous = (R, t). The motion is that of all points by their measured disparities, so that no
road is needed to know it, and nothing that comes later.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from stereocalib_core.back.odometry.packing import PackedTracks
from stereocalib_core.geometry import Extrinsics, transform
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.small_algebra import rotation_from_vector

_STEP = 1e-6
"""Of the central differences [m], [rad]: the functions are smooth, and this is far above rounding."""


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
    and the covariance (3, 3) that the motion's own brings."""
    by_values, by_motion = np.empty((3, 3)), np.empty((3, 6))
    for k in range(3):
        off = np.eye(3)[k] * _STEP
        by_values[:, k] = _seen(values + off, moved.motion) - _seen(values - off, moved.motion)
    for k in range(6):
        off = np.eye(6)[k] * _STEP
        by_motion[:, k] = _seen(values, moved.motion + off) - _seen(values, moved.motion - off)
    by_values, by_motion = by_values / (2.0 * _STEP), by_motion / (2.0 * _STEP)
    return _seen(values, moved.motion), by_values, by_motion @ moved.covariance @ by_motion.T


def _seen(values: Array, motion: Array) -> Array:
    plane = Extrinsics(*values.tolist()).plane()
    e = Extrinsics.from_plane(plane.transformed(transform(rotation_from_vector(motion[:3]), motion[3:])))
    return np.array([e.height_m, e.pitch_rad, e.roll_rad])
