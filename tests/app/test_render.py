"""The pictures: drawn where geometry says, in the colours of the legend."""

from __future__ import annotations

import time

import cv2
import numpy as np
import pytest
from stereocalib_app.drive import histograms, render, stage_table
from stereocalib_app.drive.frame_views import BoundedCache, cloud, contact_sheet
from stereocalib_app.drive.stage_table import STAGES, Seen
from stereocalib_app.widgets import canvas, palette

from stereocalib_core.errors import Failure, FailureReason
from stereocalib_core.frames import StereoFrame
from stereocalib_core.front.road.result import RoadResult
from stereocalib_core.front.road.uv_disparity import u_disparity
from stereocalib_core.geometry import Extrinsics, StereoCamera
from stereocalib_core.results import DisparityMap, RoadEstimate

CAMERA = StereoCamera(640, 320, 500.0, 320.0, 140.0, 0.5)
TRUTH = Extrinsics.from_degrees(1.6, 2.0, 3.0)


@pytest.fixture(scope="module")
def seen() -> tuple[StereoFrame, RoadResult]:
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
    stages = RoadResult(
        DisparityMap(values, step),
        1.0,
        u_disparity(values, 1.0, 96),
        wall,
        free,
        free,
        estimate=estimate,
    )
    left = np.full((CAMERA.height, CAMERA.width), 128, np.uint8)
    return StereoFrame(7, 0.7, left, left), stages


def test_horizon_is_drawn_where_geometry_says(seen: tuple[StereoFrame, RoadResult]) -> None:
    picture = render.left_view(*seen, CAMERA)
    yellow = np.abs(picture.astype(int) - palette.HORIZON).max(axis=2) < 60
    for u in (40, 200, 500):
        rows = np.flatnonzero(yellow[:, u])
        expected = 140.0 - 500.0 * np.tan(TRUTH.pitch_rad)
        expected += np.tan(TRUTH.roll_rad) / np.cos(TRUTH.pitch_rad) * (u - 320)
        assert abs(rows.mean() - expected) < 1.5


def test_colours_mean_the_same_in_every_view(seen: tuple[StereoFrame, RoadResult]) -> None:
    frame, stages = seen
    picture = render.free_map_view(frame, stages, 640, 320)
    assert np.abs(picture[300, 500].astype(int) - palette.ROAD).max() < 40
    assert np.abs(picture[200, 40].astype(int) - palette.OBSTACLE).max() < 60
    columns = histograms.u_disparity_view(stages, 320, 192)
    wall_row = int(30.5 / 96 * 192)
    assert columns[wall_row, 40, 0] > 180 > columns[wall_row, 40, 2]


def test_every_stage_is_drawn_and_knows_its_axes(seen: tuple[StereoFrame, RoadResult]) -> None:
    looked = Seen(*seen, CAMERA, TRUTH)
    for name, stage in STAGES.items():
        picture = stage_table.draw(name, looked)
        assert picture.dtype == np.uint8
        if stage.axes == "image":
            assert picture.shape == (CAMERA.height, CAMERA.width, 3)
            assert stage_table.extent(name, looked) == (CAMERA.width, CAMERA.height)
    assert stage_table.extent("v-disparity", looked) == (96.0, CAMERA.height)
    assert stage_table.extent("u-disparity", looked) == (CAMERA.width, 96.0)


@pytest.mark.parametrize("name", list(STAGES))
def test_a_small_picture_shows_what_the_large_one_does(
    name: str, seen: tuple[StereoFrame, RoadResult]
) -> None:
    """Lines too: a small v-disparity has its profile where the large one has it."""
    looked = Seen(*seen, CAMERA, TRUTH)
    large, small = stage_table.draw(name, looked), stage_table.draw(name, looked.shrunk(2))
    assert abs(small.shape[1] - large.shape[1] // 2) <= 1
    for color in (palette.HORIZON, palette.ROAD):
        centres = []
        for picture in (large, small):
            rows, columns = np.nonzero(np.abs(picture.astype(int) - color).max(axis=2) < 60)
            centres.append((len(rows), rows.sum() / picture.shape[0], columns.sum() / picture.shape[1]))
        (most, *whole), (few, *part) = centres
        if most > 400:
            np.testing.assert_allclose(np.array(part) / few, np.array(whole) / most, atol=0.02)


def test_the_sheet_holds_every_stage_where_it_says(seen: tuple[StereoFrame, RoadResult]) -> None:
    sheet, places = contact_sheet(list(STAGES), Seen(*seen, CAMERA, TRUTH))
    assert [place.name for place in places] == list(STAGES)
    for place in places:
        assert place.x + place.width <= sheet.shape[1]
        assert place.y + place.height <= sheet.shape[0]
    free = next(place for place in places if place.name == "free map")
    pixel = sheet[free.y + int(0.93 * free.height), free.x + int(0.78 * free.width)]
    assert np.abs(pixel.astype(int) - palette.ROAD).max() < 40


def test_left_minus_right_is_grey_only_over_the_true_road() -> None:
    """A textured plane seen by both cameras: with the true road the difference vanishes, with another it does not."""
    rng = np.random.default_rng(3)
    texture = cv2.GaussianBlur(
        rng.uniform(0, 255, (CAMERA.height, CAMERA.width)).astype(np.float32), (0, 0), 1.5
    )
    texture = cv2.normalize(texture, None, 20, 235, cv2.NORM_MINMAX)
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width].astype(np.float64)
    plane = TRUTH.disparity_plane(CAMERA)
    # The right camera sees at u what the left one sees at u + d(u, v), solved by a few steps.
    at = u.copy()
    for _ in range(20):
        at = u + np.maximum(plane.disparity(CAMERA, at, v), 0.0)
    right = cv2.remap(texture, at.astype(np.float32), v.astype(np.float32), cv2.INTER_LINEAR)
    road = np.asarray(plane.disparity(CAMERA, u[::2, ::2] + 0.5, v[::2, ::2] + 0.5) > 5.0)
    values = np.where(road, 10.0, np.nan).astype(np.float32)
    counts = np.zeros((4, 4), np.int32)
    stages = RoadResult(DisparityMap(values, 2), 1.0, counts, ~road, road, road)
    frame = StereoFrame(0, 0.0, texture.astype(np.uint8), right.astype(np.uint8))
    inner = np.s_[220:300, 250:600]

    def spread(extrinsics: Extrinsics) -> float:
        picture = render.difference_view(frame, stages, CAMERA, extrinsics)[inner].astype(int)
        return float(np.abs(picture[..., 0] - picture[..., 2]).mean())

    assert 4.0 * spread(TRUTH) < spread(Extrinsics.from_degrees(1.6, 2.3, 3.0))


def test_lidar_points_are_coloured_by_their_height_over_the_road() -> None:
    ahead = (TRUTH.T_camera_road @ np.array([0.0, 0.0, 9.0, 1.0]))[:3]
    above = (TRUTH.T_camera_road @ np.array([1.5, -2.0, 9.0, 1.0]))[:3]
    points = np.array([[*ahead, 0], [*above, 0]], np.float32)
    frame = StereoFrame(0, 0.0, np.zeros((CAMERA.height, CAMERA.width), np.uint8), None, None, points)
    picture = render.lidar_view(frame, CAMERA, np.eye(4), TRUTH)
    table = canvas.lookup_table("viridis").astype(int)
    share = (0.0 - render.HEIGHTS_M[0]) / (render.HEIGHTS_M[1] - render.HEIGHTS_M[0])
    for point, wanted in ((ahead, table[int(255 * share)]), (above, table[255])):
        x, y, _ = CAMERA.project(point)
        assert np.abs(picture[int(y), int(x)].astype(int) - wanted).max() <= 6


def test_bad_frames_are_pictures_too() -> None:
    failure = Failure(FailureReason.MISSING_PAIR, "no right image")
    frame = StereoFrame(3, 0.3, None, None, failure)
    for name in STAGES:
        assert stage_table.draw(name, Seen(frame, None, CAMERA)).shape[1] == CAMERA.width
    points, colors = cloud(frame, None, CAMERA)
    assert points.shape == colors.shape == (1, 3)


def test_cloud_lies_on_the_road(seen: tuple[StereoFrame, RoadResult]) -> None:
    points, colors = cloud(*seen, CAMERA)
    assert points.dtype == np.float32
    assert len(points) == len(colors) > 1000
    height = TRUTH.plane().signed_distance(points)
    assert np.median(np.abs(height[points[:, 0] > 0.5])) < 0.01


def test_title_keeps_text_inside(seen: tuple[StereoFrame, RoadResult]) -> None:
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
