"""Dense disparity where the road can be, and a coarser one above it.

Nothing above the horizon is road: what is seen there tells where the camera turns, and how far away the houses are. A
grid twice as coarse, an eighth of the work, is enough of it. The horizon is that of the road a moment ago.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from stereocalib_core.config import DisparityConfig, SightConfig
from stereocalib_core.front.matching import Matcher
from stereocalib_core.geometry import Extrinsics, StereoCamera
from stereocalib_core.numeric.arrays import Grey
from stereocalib_core.results import DisparityMap


def first_row(camera: StereoCamera, road: Extrinsics, step_px: int, config: SightConfig) -> int:
    """The picture row from which a road can be seen, a multiple of two cells; 0 where too little lies above it."""
    plane = road.disparity_plane(camera)
    ends = np.array([0.0, camera.width - 1.0]) - camera.cx_px
    horizon = camera.cy_px - np.max((plane.c_px + plane.b * ends) / plane.a)
    row = int(horizon - camera.focal_px * np.tan(config.above_horizon_rad)) // (2 * step_px) * (2 * step_px)
    least = max(config.least_rows_above * 2 * step_px, 32)
    return row if least <= row <= camera.height - least else 0


def match_by_the_horizon(
    match: Matcher,
    left: Grey,
    right: Grey,
    camera: StereoCamera,
    config: DisparityConfig,
    step_px: int,
    farthest_px: float,
    first: int,
) -> DisparityMap:
    """The map on the grid of `step_px`; cells above picture row `first` are those of a grid twice as coarse."""
    below = dataclasses.replace(camera, height=camera.height - first, cy_px=camera.cy_px - first)
    fine = match(left[first:], right[first:], below, config, step_px, farthest_px)
    above = dataclasses.replace(camera, height=first)
    coarse = match(left[:first], right[:first], above, config, 2 * step_px, farthest_px)
    rows, columns = first // fine.step_px, fine.values.shape[1]
    values = np.empty((rows + len(fine.values), columns), np.float32)
    values[rows:] = fine.values
    by = coarse.step_px // fine.step_px
    meet = first % coarse.step_px == 0 and by * fine.step_px == coarse.step_px
    if not meet or by * len(coarse.values) != rows:
        return match(left, right, camera, config, step_px, farthest_px)  # a matcher with a grid of its own
    reach = min(by * coarse.values.shape[1], columns)
    for i in range(by):
        for j in range(by):
            part = values[i:rows:by, j:reach:by]
            part[:] = coarse.values[:, : part.shape[1]]
    values[:rows, reach:] = values[:rows, reach - 1 : reach]
    return DisparityMap(values, fine.step_px)
