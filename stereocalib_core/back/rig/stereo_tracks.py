"""The points of a whole drive that were seen in both pictures of two frames, in one block for compiled loops."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.geometry import StereoCamera
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.chunks import MOST_AT_ONCE
from stereocalib_core.numeric.spill import let_go, roomy
from stereocalib_core.results import FrameResult


@dataclass(frozen=True)
class StereoTracks:
    """All points of a drive that were seen in both pictures of two frames, in the units of the kernels.

    rays: (8, M) x, y, disparity in the frame before, then in this one, all over the focal length, and how the match of
    either leans (`Tracks.lean`).
    start: (N + 1,) the points of pair i, which ends in frame i, are start[i] ... start[i + 1].
    """

    camera: StereoCamera
    rays: Array
    start: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.start) - 1


def stereo_tracks(camera: StereoCamera, results: Sequence[FrameResult]) -> StereoTracks:
    """The tracks of consecutive frames to one block; points without a disparity in both frames are left out."""
    start = np.zeros(len(results) + 1, dtype=np.int64)
    for i, result in enumerate(results):
        start[i + 1] = start[i]
        if result.tracks is not None and len(result.tracks):
            start[i + 1] += np.count_nonzero(np.isfinite(result.tracks.points).all(axis=1))
            if i % MOST_AT_ONCE == 0:
                let_go(result.tracks.points)
    rays = roomy((8, int(start[-1])))
    centre = np.array([camera.cx_px, camera.cy_px, 0.0] * 2)[:, None]
    for i, result in enumerate(results):
        if result.tracks is not None and start[i + 1] > start[i]:
            known = np.isfinite(result.tracks.points).all(axis=1)
            points, lean = result.tracks.points[known], result.tracks.lean
            rays[:6, start[i] : start[i + 1]] = (points.astype(np.float64).T - centre) / camera.focal_px
            rays[6:, start[i] : start[i + 1]] = 0.0 if lean is None else lean[known].T
            if i % MOST_AT_ONCE == 0:
                let_go(rays, result.tracks.points)
    let_go(rays)
    return StereoTracks(camera, rays, start)
