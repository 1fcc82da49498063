"""Where the board's outline in the cloud lies on the board, against the middle of the pattern in the picture.

Planes say nothing of shifts along themselves; the outline does, roughly: rays are sparse, and no pattern is printed
exactly in the middle of its board. Each board's centre has an error of its own and all of them share one (the
print), so that many boards do not pretend to know better than the print was made.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stereocalib_core.boards.observation import PairObservation
from stereocalib_core.boards.rotations import cross
from stereocalib_core.config.boards import CENTRES
from stereocalib_core.numeric.arrays import Array


@dataclass(frozen=True)
class Centres:
    """lidar, camera: (M, 3) the board's centre in either sensor [m]; axes: (M, 2, 3) the board's x and y in the camera.

    own_m: error of one board's centre along an axis; shared_m: what all boards share of it, 1 sigma.
    """

    lidar: Array
    camera: Array
    axes: Array
    own_m: float
    shared_m: float

    @classmethod
    def of(cls, kept: Sequence[PairObservation], T_camera_lidar: Array, scale: float) -> Centres:
        """From observations with both planes; the error of one comes from their scatter under a first solution."""
        lidar = np.array([o.lidar_plane.center for o in kept if o.lidar_plane is not None])
        poses = np.array([o.T_camera_board for o in kept])
        own = CENTRES.usual_own_m
        raw = cls(lidar, poses[:, :3, 3], np.swapaxes(poses[:, :3, :2], 1, 2), own, CENTRES.shared_m)
        if len(kept) >= CENTRES.least_boards:
            gaps = raw.gaps(T_camera_lidar, scale)
            # Not a robust one: outlines that slipped to the next ring are what the weight must allow for.
            apart = gaps - gaps.mean(axis=0)
            own = max(float(np.sqrt(np.sum(apart**2) / (2 * len(kept) - 2))), CENTRES.least_own_m)
        return cls(raw.lidar, raw.camera, raw.axes, own, raw.shared_m)

    def gaps(self, T_camera_lidar: Array, scale: float) -> Array:
        """(M, 2) from the pattern's middle to the outline's, along the board's x and y [m]."""
        gap = self.lidar @ T_camera_lidar[:3, :3].T + T_camera_lidar[:3, 3] - scale * self.camera
        return np.asarray(np.einsum("mka,ma->mk", self.axes, gap))

    def cost(self, T_camera_lidar: Array, scale: float) -> float:
        """Half the sum of squares, weighed by own and shared errors."""
        gaps = self.gaps(T_camera_lidar, scale)
        return 0.5 * float(np.sum(gaps * self._weighed(gaps)))

    def equations(self, T_camera_lidar: Array, scale: float) -> tuple[Array, Array]:
        """(7, 7) information and (7,) gradient by a left twist of T and by the scale."""
        moved = self.lidar @ T_camera_lidar[:3, :3].T + T_camera_lidar[:3, 3]
        J = np.zeros((len(moved), 2, 7))
        J[:, :, :3] = cross(moved[:, None, :], self.axes)
        J[:, :, 3:6] = self.axes
        J[:, :, 6] = -np.einsum("mka,ma->mk", self.axes, self.camera)
        return (
            np.einsum("mki,mkj->ij", J, self._weighed(J)),
            np.einsum("mki,mk->i", self._weighed(J), self.gaps(T_camera_lidar, scale)),
        )

    def _weighed(self, values: Array) -> Array:
        """(M, 2, ...) times the inverse of own^2 I + shared^2 1 1^T over the boards (Sherman and Morrison)."""
        own, shared = self.own_m**2, self.shared_m**2
        return (values - shared * values.sum(axis=0) / (own + len(values) * shared)) / own
