"""u-disparity, v-disparity and the free map on maps made by hand."""

from __future__ import annotations

import numpy as np

from stereocalib_core.config import FreeMapConfig, LaneConfig
from stereocalib_core.front.road import free_map, lane
from stereocalib_core.front.road.uv_disparity import u_disparity, v_disparity
from stereocalib_core.geometry import Extrinsics, StereoCamera
from stereocalib_core.results import DisparityMap

CAMERA = StereoCamera(400, 200, 250.0, 199.5, 60.0, 0.5)
ROAD = Extrinsics.from_degrees(1.5, 1.0, 0.5)


def _map(with_box: bool) -> DisparityMap:
    grid = DisparityMap(np.zeros((200, 400), np.float32), 1)
    values = ROAD.disparity_plane(CAMERA).disparity(CAMERA, grid.columns_u()[None], grid.rows_v()[:, None])
    values = np.where(values > 0.5, values, np.nan).astype(np.float32)
    if with_box:
        values[40:110, 150:220] = 14.0
    return DisparityMap(values, 1)


def test_counts_are_counts() -> None:
    values = np.array([[1.2, np.nan, 3.9], [1.7, 2.5, 200.0]], np.float32)
    u = u_disparity(values, 1.0, 8)
    assert u.shape == (8, 3) and u.sum() == 4 and u[1, 0] == 2 and u[2, 1] == 1 and u[3, 2] == 1
    v = v_disparity(values, values > 1.5, 1.0, 8)
    assert v.shape == (2, 8) and v[0, 3] == 1 and v[1, 1] == 1 and v[1, 2] == 1 and v.sum() == 3


def test_a_box_is_an_obstacle_and_the_road_is_free() -> None:
    disparity = _map(with_box=True)
    counts = u_disparity(disparity.values, 1.0, 128)
    obstacles, free = free_map.separate(disparity, counts, 1.0, CAMERA, FreeMapConfig())
    assert obstacles[45:100, 152:218].mean() > 0.95
    assert free[150:, :].mean() > 0.99
    assert not (obstacles & free).any()
    assert not (obstacles | free)[np.isnan(disparity.values)].any()


def test_lane_support_counts_agreement_and_range() -> None:
    disparity = _map(with_box=False)
    free = disparity.values > 0
    good = lane.measure(disparity, free, CAMERA, ROAD, 20.0, LaneConfig())
    assert good.agreement == 1.0 and good.covered == 1.0
    assert good.range_m[1] >= 19.0
    tilted = Extrinsics.from_degrees(1.5, 2.5, 0.5)
    assert lane.measure(disparity, free, CAMERA, tilted, 20.0, LaneConfig()).agreement < 0.6
    road, fraction = lane.road_mask(disparity, free, CAMERA, ROAD, LaneConfig())
    assert fraction > 0.98 and road[free].mean() > 0.99
