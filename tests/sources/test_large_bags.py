"""A bag is read by its index: how much of it is read, how soon it shows a frame and how much memory it takes do not
grow with its pictures."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags")

REPO = Path(__file__).resolve().parents[2]

PAIRS, SIZE = 160, (640, 480)
STEP_NS = 100_000_000
PROBE = """
import json, resource, sys, time
from pathlib import Path
import cv2, numpy, rosbags.highlevel, sqlite3, stereocalib_core.sources.formats
from stereocalib_core.sources import open_source

def read():
    return int(next(line.split()[1] for line in open("/proc/self/io") if line.startswith("rchar")))
def peak():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
before, memory, began = read(), peak(), time.perf_counter()
source = open_source(sys.argv[1])
first = source[0]
shown, opened = time.perf_counter() - began, read() - before
assert first.left is not None
for i in range(len(source)):
    assert source[i].failure is None
print(json.dumps([len(source), shown, opened, peak() - memory]))
"""


def write(place: Path, kind: str) -> str:
    """About 98 MB of pictures; the camera drives nowhere."""
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    ros2 = kind != "bag"
    store = get_typestore(Stores.ROS2_HUMBLE if ros2 else Stores.ROS1_NOETIC)
    types = store.types
    rng = np.random.default_rng(3)
    noise = rng.integers(0, 256, SIZE[0] * SIZE[1] + 1000).astype(np.uint8)
    writer: Any
    if ros2:
        plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        writer = Writer(place / "drive", version=9, storage_plugin=plugin)
    else:
        writer = Writer1(place / "drive.bag")
    serialize = store.serialize_cdr if ros2 else store.serialize_ros1
    with writer:
        topics = {}
        for side in ("left", "right"):
            for name, message in (("image_rect", "Image"), ("camera_info", "CameraInfo")):
                topics[side, name] = writer.add_connection(
                    f"/{side}/{name}", f"sensor_msgs/msg/{message}", typestore=store
                )
        for i in range(PAIRS):
            ns = 1_600_000_000 * 10**9 + i * STEP_NS
            extra = {} if ros2 else {"seq": i}
            time = types["builtin_interfaces/msg/Time"](sec=ns // 10**9, nanosec=ns % 10**9)
            header = types["std_msgs/msg/Header"](stamp=time, frame_id="cam", **extra)
            for side, shift in (("left", 0.0), ("right", -60.0)):
                image = types["sensor_msgs/msg/Image"](
                    header, SIZE[1], SIZE[0], "mono8", 0, SIZE[0], noise[i : i + SIZE[0] * SIZE[1]]
                )
                writer.write(topics[side, "image_rect"], ns, serialize(image, "sensor_msgs/msg/Image"))
                if i:
                    continue
                K = np.array([500.0, 0, 320, 0, 500, 240, 0, 0, 1])
                P = np.array([500.0, 0, 320, shift, 0, 500, 240, 0, 0, 0, 1, 0])
                region = types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
                info = types["sensor_msgs/msg/CameraInfo"](
                    header, SIZE[1], SIZE[0], "plumb_bob", np.zeros(5), K, np.eye(3).ravel(), P, 0, 0, region
                )
                writer.write(topics[side, "camera_info"], ns, serialize(info, "sensor_msgs/msg/CameraInfo"))
    return str(place / ("drive" if ros2 else "drive.bag"))


@pytest.mark.parametrize("kind", ["bag", "db3", "mcap"])
def test_only_the_index_of_a_bag_is_read_at_once(tmp_path: Path, kind: str) -> None:
    path = write(tmp_path, kind)
    total = sum(p.stat().st_size for p in [Path(path), *Path(path).glob("*")] if p.is_file())
    assert total > 90_000_000
    out = subprocess.run(
        [sys.executable, "-c", PROBE, f"bag:{path}"], capture_output=True, text=True, check=True, cwd=REPO
    )
    count, shown_s, opened_bytes, grown_bytes = json.loads(out.stdout)
    assert count == PAIRS
    # the pictures that tell size and depth and the first pair are read; of the others an index entry each
    assert opened_bytes < total / 10
    assert grown_bytes < 40_000_000
    assert shown_s < 5.0
