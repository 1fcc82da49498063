"""The road in one stereo pair: disparity, u- and v-disparity, free map, profile, roll, and the direct plane."""

from __future__ import annotations


def warm_up() -> None:
    """Compile what is compiled, by one small pair through the whole chain."""
    import numpy as np

    from stereocalib_core.config import PipelineConfig
    from stereocalib_core.front.road.ahead import bend_ahead
    from stereocalib_core.front.road.estimate import estimate_road
    from stereocalib_core.front.road.uv_disparity import v_disparity
    from stereocalib_core.geometry import Extrinsics, StereoCamera

    camera = StereoCamera(400, 160, 250.0, 199.5, 60.0, 0.5)
    u, v = np.meshgrid(np.arange(400.0), np.arange(160.0))
    road = Extrinsics(1.6, 0.0, 0.0)
    disparity = np.clip(road.disparity_plane(camera).disparity(camera, u, v), 0.0, None)
    texture = np.random.default_rng(0).integers(40, 200, (160, 520)).astype(np.float64)
    left = np.empty((160, 400), np.uint8)
    for i in range(160):
        left[i] = np.interp(u[i] - disparity[i] + 60.0, np.arange(520.0), texture[i])
    result = estimate_road(left, texture[:, 60:460].astype(np.uint8), camera, PipelineConfig())
    if result.drawable:
        v_disparity(result.disparity.values, result.free, 1.0, 128)
        bend_ahead(result.disparity, result.free, camera, road, PipelineConfig().lane)
