"""The surface of the road as the pair measured it, patch by patch, so that a scan can be held against the same places.

No road is a plane, and a plane through some of it depends on which part and on the weights. Two sensors that each
choose for themselves differ by what lies between: camber, kerbs, the next street at a crossing. Where the road was
aligned patch by patch, a scan is compared patch by patch: what is left is how the sensors disagree.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.config import DirectConfig
from stereocalib_core.front.road.estimate import RoadResult
from stereocalib_core.front.road.plane import shrink_of
from stereocalib_core.geometry import StereoCamera
from stereocalib_core.numeric.arrays import Array

NONE = -1
"""In `RoadSurface.tiles`: no patch."""


@dataclass(frozen=True)
class RoadSurface:
    """The patches that the stereo road was fitted to, on the grid that they tile.

    camera: of the pictures that were tiled, which may be shrunk. tiles: (h, w) int32 the patch on each tile, `NONE`
    where there is none or where it was rejected. corner: (2,) u, v [px] of the middle of tile 0, 0; tile: (2,) its
    width and height [px]. over_m: (N,) height of each patch over the stereo road's plane. range_m: nearest, farthest.
    """

    camera: StereoCamera
    tiles: NDArray[np.int32]
    corner: Array
    tile: Array
    over_m: Array
    range_m: tuple[float, float]

    @classmethod
    def of(cls, road: RoadResult, camera: StereoCamera, config: DirectConfig) -> RoadSurface | None:
        """From what the road stage saw; None where the road was not aligned directly."""
        if road.direct is None or road.estimate is None:
            return None
        patches = road.direct.patches
        used = np.flatnonzero((patches.weight > 0.0) & np.isfinite(patches.sigma_px))
        if not len(used):
            return None
        camera = camera.shrunk(shrink_of(road.disparity.step_px))
        u, v = patches.u[used], patches.v[used]
        tile = np.array([2.0 * config.patch_half_width_px + 1.0, 2.0 * config.patch_half_height_px + 1.0])
        corner = np.array([u.min(), v.min()])
        column, row = (np.rint((x - x.min()) / size).astype(int) for x, size in ((u, tile[0]), (v, tile[1])))
        tiles = np.full((row.max() + 1, column.max() + 1), NONE, np.int32)
        tiles[row, column] = np.arange(len(used))
        z = patches.z[used]
        m_per_px = road.estimate.extrinsics.height_m * z / (camera.focal_px * camera.baseline_m)
        over_m = patches.offset_px[used] * m_per_px
        return cls(camera, tiles, corner, tile, over_m, (float(z.min()), float(z.max())))
