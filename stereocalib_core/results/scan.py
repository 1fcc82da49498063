"""What a frame keeps of its LiDAR scan, small enough to be kept for a whole drive: fixed-point numbers in int16."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_METRE = 250.0
"""Steps of 4 mm reach 131 m; their rounding, 1.2 mm, is far below the noise of any range."""
_PIXEL = 8.0
"""Steps of 1/8 px reach 4095 px; their rounding, 0.04 px, is a tenth of the noise of an edge."""
_SLOPE = 2.0**14
"""A patch of 16 px is off by less than 0.001 px by this rounding; slopes reach 2 px/px."""
_BEAM_EDGE = np.array([_METRE, _METRE, _METRE, 1.0])
_PICTURE_EDGE = np.array([_PIXEL, _PIXEL, _PIXEL, 1.0, _PIXEL])
_POINT = np.array([_METRE, _METRE, _METRE])
_PATCH = np.array([_PIXEL, _PIXEL, 64.0, _SLOPE, _SLOPE])


@dataclass(frozen=True)
class ScanSample:
    """What is kept of one LiDAR scan and of the pictures of the same moment (see `front.scan.scan_sample`).

    T_camera_lidar: (4, 4) as calibrated: with it the rest was chosen.
    sweep: turns of the LiDAR from frame to frame, as `StereoFrame.lidar_sweep`; NaN = not known.
    The others are int16, fixed-point, and are read through the properties below.
    """

    T_camera_lidar: NDArray[np.float64]
    packed_beam_edges: NDArray[np.int16]
    packed_picture_edges: NDArray[np.int16]
    packed_points: NDArray[np.int16]
    packed_patches: NDArray[np.int16]
    sweep: float

    @classmethod
    def pack(
        cls,
        T_camera_lidar: NDArray[np.float64],
        beam_edges: NDArray[np.float64],
        picture_edges: NDArray[np.float64],
        points: NDArray[np.float64],
        patches: NDArray[np.float64],
        sweep: float | None = None,
    ) -> ScanSample:
        """From what the properties give, rounded."""
        return cls(
            np.array(T_camera_lidar, dtype=np.float64),
            _fixed(beam_edges, _BEAM_EDGE),
            _fixed(picture_edges, _PICTURE_EDGE),
            _fixed(points, _POINT),
            _fixed(patches, _PATCH),
            float("nan") if sweep is None else sweep,
        )

    @property
    def beam_edges(self) -> NDArray[np.float64]:
        """(K, 4) x, y, z [m] in the LiDAR's frame where a beam leaves a near thing, and the thing's side: +1 right."""
        return self.packed_beam_edges / _BEAM_EDGE

    @property
    def picture_edges(self) -> NDArray[np.float64]:
        """(M, 5) u, v, disparity of the near side [px], its side: +1 right, contrast [grey/px]; in order of v."""
        return self.packed_picture_edges / _PICTURE_EDGE

    @property
    def points(self) -> NDArray[np.float64]:
        """(S, 3) x, y, z [m] in the LiDAR's frame of points on smooth surfaces off the road."""
        return self.packed_points / _POINT

    @property
    def patches(self) -> NDArray[np.float64]:
        """(P, 5) u, v, disparity [px] of the centre of small planes off the road, d disparity / du, dv [px/px]."""
        return self.packed_patches / _PATCH


def _fixed(rows: NDArray[np.float64], scale: NDArray[np.float64]) -> NDArray[np.int16]:
    """(N, k) numbers times (k,) scale, rounded and kept within int16."""
    limit = np.iinfo(np.int16)
    return np.clip(np.rint(rows * scale), limit.min, limit.max).astype(np.int16)
