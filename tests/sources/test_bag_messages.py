"""What bags hold beside plain grey pictures: colours, bayer, 16 bit, packed pictures, clouds, positions, frames."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from stereocalib_core.errors import SourceError
from stereocalib_core.sources import open_source
from stereocalib_core.sources.bags import messages
from stereocalib_core.sources.bags.storages import Entry
from stereocalib_core.sources.bags.topics import choose
from stereocalib_core.sources.formats.bag import paired
from stereocalib_core.sources.pictures import UnreadablePicture

HEIGHT, WIDTH = 40, 60
_ROWS, _COLUMNS = np.mgrid[:HEIGHT, :WIDTH]
RGB = np.stack([60 + 2 * _COLUMNS, 40 + 3 * _ROWS, 200 - _COLUMNS - _ROWS], -1).astype(np.uint8)
"""Smooth, with three quite different channels: a channel taken for another is far off."""
GREY = cv2.cvtColor(RGB, cv2.COLOR_RGB2GRAY)


def image(encoding: str, data: np.ndarray, step: int | None = None, big: int = 0) -> Any:
    height, width = data.shape[:2]
    raw = data.astype(data.dtype.newbyteorder(">" if big else "<"))
    row = raw.reshape(height, -1)
    size = row.shape[1] * data.dtype.itemsize
    stride = size if step is None else step
    padded = np.zeros((height, stride), np.uint8)
    padded[:, :size] = row.view(np.uint8).reshape(height, size)
    return SimpleNamespace(
        encoding=encoding, width=width, height=height, step=stride, is_bigendian=big, data=padded.ravel()
    )


def mosaic(pattern: str, deep: bool = False) -> np.ndarray:
    """The one colour of each pixel that a sensor with this pattern keeps."""
    out = np.zeros((HEIGHT, WIDTH), np.uint8)
    for k, letter in enumerate(pattern):
        dy, dx = divmod(k, 2)
        out[dy::2, dx::2] = RGB[dy::2, dx::2, "rgb".index(letter)]
    return out.astype(np.uint16) << 8 if deep else out


@pytest.mark.parametrize(
    ("encoding", "data"),
    [
        ("mono8", GREY),
        ("8UC1", GREY),
        ("rgb8", RGB),
        ("bgr8", RGB[:, :, ::-1]),
        ("rgba8", np.dstack([RGB, np.full((HEIGHT, WIDTH), 9, np.uint8)])),
        ("bgra8", np.dstack([RGB[:, :, ::-1], np.full((HEIGHT, WIDTH), 9, np.uint8)])),
    ],
)
@pytest.mark.parametrize("pad", [0, 7])
def test_colours_become_their_luminance(encoding: str, data: np.ndarray, pad: int) -> None:
    step = WIDTH * (1 if data.ndim == 2 else data.shape[2]) + pad
    np.testing.assert_array_equal(messages.picture(image(encoding, data, step)), GREY)


@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
@pytest.mark.parametrize("deep", [False, True])
def test_bayer_patterns(pattern: str, deep: bool) -> None:
    found = messages.picture(image(f"bayer_{pattern}{16 if deep else 8}", mosaic(pattern, deep)))
    grey = found >> 8 if deep else found
    assert np.abs(grey[4:-4, 4:-4].astype(int) - GREY[4:-4, 4:-4]).max() <= 4


@pytest.mark.parametrize("big", [0, 1])
def test_sixteen_bit_of_either_order(big: int) -> None:
    deep = GREY.astype(np.uint16) << 4
    for encoding in ("mono16", "16UC1"):
        np.testing.assert_array_equal(messages.picture(image(encoding, deep, big=big)), deep)


def test_yuv() -> None:
    packed = np.zeros((HEIGHT, WIDTH, 2), np.uint8)
    packed[:, :, 0], packed[:, :, 1] = 128, GREY
    np.testing.assert_array_equal(messages.picture(image("yuv422", packed)), GREY)
    np.testing.assert_array_equal(messages.picture(image("yuv422_yuy2", packed[:, :, ::-1].copy())), GREY)


def test_packed_pictures_and_what_is_none() -> None:
    data = np.frombuffer(cv2.imencode(".png", GREY)[1].tobytes(), np.uint8)
    np.testing.assert_array_equal(messages.picture(SimpleNamespace(format="png", data=data)), GREY)
    for bad in (
        image("8UC7", GREY), SimpleNamespace(format="jpeg", data=b"none"),
        SimpleNamespace(**{**vars(image("mono8", GREY)), "height": 400}),
        SimpleNamespace(**{**vars(image("mono8", GREY)), "width": 10**6, "height": 10**6}),
    ):  # fmt: skip
        with pytest.raises(UnreadablePicture):
            messages.picture(bad)


def cloud(fields: list[tuple[str, int, int]], step: int, data: bytes, count: int) -> Any:
    made = [SimpleNamespace(name=n, offset=o, datatype=t, count=1) for n, o, t in fields]
    return SimpleNamespace(
        fields=made, is_bigendian=False, point_step=step, row_step=step * count, height=1, width=count,
        data=np.frombuffer(data, np.uint8),
    )  # fmt: skip


def test_clouds_by_their_fields() -> None:
    """As a Velodyne driver packs them: gaps, double precision, intensity elsewhere, points without a return."""
    kind = np.dtype({"names": ["x", "y", "z", "intensity"], "formats": ["<f8", "<f8", "<f8", "u1"],
                     "offsets": [0, 8, 16, 30], "itemsize": 40})  # fmt: skip
    points = np.zeros(4, kind)
    points["x"], points["y"], points["z"], points["intensity"] = [1, 2, np.nan, 4], 5, -6, [7, 8, 9, 10]
    found = messages.cloud(
        cloud([("x", 0, 8), ("y", 8, 8), ("z", 16, 8), ("intensity", 30, 2)], 40, points.tobytes(), 4)
    )
    assert found is not None
    np.testing.assert_array_equal(found, [[1, 5, -6, 7], [2, 5, -6, 8], [4, 5, -6, 10]])
    assert messages.cloud(cloud([("x", 0, 7)], 40, points.tobytes(), 4)) is None
    assert (
        messages.cloud(cloud([("x", 0, 7), ("y", 4, 7), ("z", 8, 7)], 40, points.tobytes()[:50], 4)) is None
    )


def test_positions_become_a_way_of_their_length() -> None:
    """100 m to the north, then 50 m to the east, from 49 degrees: headings follow, the length is right."""
    north = np.concatenate([np.arange(0, 101, 5.0), np.full(10, 100.0)])
    east = np.concatenate([np.zeros(21), np.arange(5, 55, 5.0)])
    latitude = 49.0 + np.rad2deg(north / messages.EARTH_RADIUS_M)
    longitude = 8.0 + np.rad2deg(east / (messages.EARTH_RADIUS_M * np.cos(np.deg2rad(49.0))))
    poses = messages.navsat_poses(np.column_stack([latitude, longitude, np.full(31, 110.0)]))
    steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    assert steps.sum() == pytest.approx(150.0, rel=1e-3)
    np.testing.assert_allclose(poses[5, :3, 2], [0, 1, 0], atol=1e-6)  # looks north
    np.testing.assert_allclose(poses[-1, :3, 2], [1, 0, 0], atol=1e-3)  # looks east
    np.testing.assert_allclose(poses[5, :3, 1], [0, 0, -1], atol=1e-9)  # y is down
    assert np.linalg.det(poses[5, :3, :3]) == pytest.approx(1.0)


IMAGE, INFO, CLOUD, ODOMETRY = messages.IMAGES[0], messages.CAMERA_INFO, messages.CLOUD, messages.POSES[0]
PACKED, FIX = messages.IMAGES[1], messages.POSES[-1]


@pytest.mark.parametrize(
    ("topics", "left", "right"),
    [
        ({"/cam0/image_raw": IMAGE, "/cam1/image_raw": IMAGE}, "/cam0/image_raw", "/cam1/image_raw"),
        ({"/right": IMAGE, "/left": IMAGE}, "/left", "/right"),
        (
            {f"/s/{side}/image_{kind}": IMAGE for side in ("left", "right") for kind in ("raw", "rect", "rect_color")},
            "/s/left/image_rect",
            "/s/right/image_rect",
        ),
        (
            {f"/zed/{s}/image{e}": kind for s in ("left", "right") for e, kind in (("", IMAGE), ("/packed", PACKED))},
            "/zed/left/image",
            "/zed/right/image",
        ),
        (
            {"/camera/infra1/image": IMAGE, "/camera/infra2/image": IMAGE, "/camera/depth/image": IMAGE},
            "/camera/infra1/image",
            "/camera/infra2/image",
        ),
        ({"/a": IMAGE, "/b": IMAGE}, "/a", "/b"),
    ],
)  # fmt: skip
def test_topics_are_found(topics: dict[str, str], left: str, right: str) -> None:
    found = choose(topics, dict.fromkeys(topics, 5), {}, "here")
    assert (found.left, found.right) == (left, right)
    assert found.rectified is ("rect" in left)


def test_topics_that_are_a_choice_are_asked_for() -> None:
    two = {f"/{rig}/{side}/image_raw": IMAGE for rig in ("front", "rear") for side in ("left", "right")}
    counts = dict.fromkeys(two, 5)
    with pytest.raises(SourceError, match=r"several pairs.*left=TOPIC"):
        choose(two, counts, {}, "here")
    found = choose(two, counts, {"left": "/rear/left/image_raw", "right": "/rear/right/image_raw"}, "here")
    assert found.left == "/rear/left/image_raw"
    with pytest.raises(SourceError, match="no topic /nose"):
        choose(two, counts, {"left": "/nose"}, "here")
    with pytest.raises(SourceError, match="no pictures"):
        choose({"/imu": "sensor_msgs/msg/Imu"}, {"/imu": 4}, {}, "here")
    more = {"/left": IMAGE, "/right": IMAGE, "/l1": CLOUD, "/l2": CLOUD, "/odom": ODOMETRY, "/fix": FIX}
    found = choose(more, dict.fromkeys(more, 5), {}, "here")
    assert (found.lidar, found.truth) == (None, "/odom")
    assert any("/l1, /l2" in note for note in found.notes)
    infos = {
        "/s/left/camera_info": INFO,
        "/s/right/camera_info": INFO,
        "/s/left/image": IMAGE,
        "/s/right/image": IMAGE,
    }
    found = choose(infos, dict.fromkeys(infos, 5), {}, "here")
    assert (found.left_info, found.right_info) == ("/s/left/camera_info", "/s/right/camera_info")


def test_pictures_are_paired_by_time_and_the_rest_is_counted() -> None:
    left = [Entry(100 * i, None, i) for i in range(6)]
    right = [Entry(100 * i + 20, None, i) for i in (0, 1, 3, 4, 4.9)]  # type: ignore[arg-type]
    pairs, notices = paired(left, right)
    assert [(a.place, None if b is None else b.place) for a, b in pairs] == [
        (0, 0), (1, 1), (2, None), (3, 3), (4, 4), (5, 4.9)
    ]  # fmt: skip
    assert notices == ["1 left pictures inside the recording have no right one"]
    assert paired(left, [Entry(5000, None, 0)]) == ([], [])


def test_what_is_no_bag_is_one_line(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    (tmp_path / "a.bag").write_bytes(b"#ROSBAG V2.0\n" + b"\0" * 100)
    (tmp_path / "b.mcap").write_bytes(b"\x89MCAP0\r\n" + b"\0" * 100)
    (tmp_path / "c.db3").write_bytes(b"SQLite format 3\0" + b"\0" * 100)
    (tmp_path / "d").mkdir()
    for name in ("a.bag", "b.mcap", "c.db3", "d", "none"):
        with pytest.raises(SourceError) as caught:
            open_source(f"bag:{tmp_path / name}")
        assert "\n" not in str(caught.value)
        assert name in str(caught.value)
    with pytest.raises(SourceError, match="bad bag source"):
        open_source("bag:")
