"""The pictures: drawn where geometry says, in the colours of the legend."""

from __future__ import annotations

import time

import numpy as np
import pytest
from stereocalib_app.drive import render
from stereocalib_app.drive.frame_views import BoundedCache, cloud
from stereocalib_app.widgets import canvas, palette

from stereocalib_core.errors import Failure, FailureReason
from stereocalib_core.frames import StereoFrame
from stereocalib_core.front.road.stages import DisparityMap, RoadStages
from stereocalib_core.front.road.uv_disparity import u_disparity, v_disparity
from stereocalib_core.geometry import Extrinsics, StereoCamera
from stereocalib_core.results import RoadEstimate

CAMERA = StereoCamera(640, 320, 500.0, 320.0, 140.0, 0.5)
TRUTH = Extrinsics.from_degrees(1.6, 2.0, 3.0)


@pytest.fixture(scope="module")
def seen() -> tuple[StereoFrame, RoadStages]:
    """A flat road with a wall on its left quarter."""
    step = 2
    rows, columns = CAMERA.height // step, CAMERA.width // step
    blank = DisparityMap(np.zeros((rows, columns), np.float32), step)
    plane = TRUTH.disparity_plane(CAMERA).disparity(CAMERA, blank.columns_u()[None], blank.rows_v()[:, None])
    values = np.where(plane > 3.0, plane, np.nan).astype(np.float32)
    wall = np.zeros(values.shape, bool)
    wall[:, : columns // 4] = True
    values[wall] = 30.0
    free = np.isfinite(values) & ~wall
    estimate = RoadEstimate(TRUTH, np.diag([0.01, 0.001, 0.001]) ** 2, int(free.sum()), 0.8, (4.0, 20.0))
    whole = np.isfinite(values)
    stages = RoadStages(
        DisparityMap(values, step),
        1.0,
        u_disparity(values, 1.0, 96),
        v_disparity(values, free, 1.0, 96),
        v_disparity(values, whole, 1.0, 96),
        wall,
        free,
        free,
        None,
        TRUTH,
        estimate,
        None,
        (),
    )
    left = np.full((CAMERA.height, CAMERA.width), 128, np.uint8)
    return StereoFrame(7, 0.7, left, left), stages


def test_horizon_is_drawn_where_geometry_says(seen: tuple[StereoFrame, RoadStages]) -> None:
    picture = render.left_view(*seen, CAMERA, width=CAMERA.width)[canvas.BAR_PX :]
    yellow = np.abs(picture.astype(int) - palette.HORIZON).max(axis=2) < 60
    for u in (40, 200, 500):
        rows = np.flatnonzero(yellow[:, u])
        expected = 140.0 - 500.0 * np.tan(TRUTH.pitch_rad)
        expected += np.tan(TRUTH.roll_rad) / np.cos(TRUTH.pitch_rad) * (u - 320)
        assert abs(rows.mean() - expected) < 1.5


def test_colours_mean_the_same_in_every_view(seen: tuple[StereoFrame, RoadStages]) -> None:
    frame, stages = seen
    picture = render.free_map_view(frame, stages, 640, 320)[canvas.BAR_PX :]
    assert np.abs(picture[300, 500].astype(int) - palette.ROAD).max() < 40
    assert np.abs(picture[200, 40].astype(int) - palette.OBSTACLE).max() < 60
    columns = render.u_disparity_view(stages, 320, 192)[canvas.BAR_PX :]
    wall_row = int(30.5 / 96 * 192)
    assert columns[wall_row, 40, 0] > 180 > columns[wall_row, 40, 2]


def test_every_layout_fits_and_keeps_its_title(seen: tuple[StereoFrame, RoadStages]) -> None:
    for layout in ("all stages", *render.STAGE_NAMES):
        picture = render.stages_view(*seen, CAMERA, layout)
        assert picture.shape[1] == render.WIDTH_PX
        assert picture.dtype == np.uint8
        assert picture[: canvas.BAR_PX, :200].max() > 200


def test_bad_frames_are_pictures_too() -> None:
    failure = Failure(FailureReason.MISSING_PAIR, "no right image")
    frame = StereoFrame(3, 0.3, None, None, failure)
    assert render.left_view(frame, None, CAMERA).shape[1] == render.WIDTH_PX
    assert render.stages_view(frame, None, CAMERA).shape[1] == render.WIDTH_PX
    points, colors = cloud(frame, None, CAMERA)
    assert points.shape == colors.shape == (1, 3)


def test_cloud_lies_on_the_road(seen: tuple[StereoFrame, RoadStages]) -> None:
    points, colors = cloud(*seen, CAMERA)
    assert points.dtype == np.float32
    assert len(points) == len(colors) > 1000
    height = TRUTH.plane().signed_distance(points)
    assert np.median(np.abs(height[points[:, 0] > 0.5])) < 0.01


def test_title_keeps_text_inside(seen: tuple[StereoFrame, RoadStages]) -> None:
    legend = [("a very long name of a class", palette.ROAD)] * 8
    bar = canvas.title_bar(300, "Title", legend, "a note that does not fit either")
    assert bar.shape == (canvas.BAR_PX, 300, 3)


def test_cache_is_bounded_and_makes_each_value_once() -> None:
    made: list[int] = []
    cache: BoundedCache[bytes] = BoundedCache(100, len)

    def make(key: int) -> bytes:
        made.append(key)
        time.sleep(0.01)
        return bytes(30)

    import threading

    threads = [threading.Thread(target=cache.get, args=(1, lambda: make(1))) for _ in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert made == [1]
    for key in range(10):
        cache.get(key, lambda key=key: make(key))
    assert len(cache) <= 3


def test_a_failing_picture_does_not_block_the_next_try() -> None:
    cache: BoundedCache[bytes] = BoundedCache(100, len)

    def fail() -> bytes:
        raise ValueError("no")

    with pytest.raises(ValueError, match="no"):
        cache.get(1, fail)
    assert cache.get(1, lambda: b"yes") == b"yes"
