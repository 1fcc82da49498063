"""Side-by-side video files, and live devices that are faster than whoever looks at them."""

from __future__ import annotations

import csv
import threading
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
from drive_writer import CAMERA_YAML, HEIGHT, WIDTH

from stereocalib_core.errors import FailureReason, SourceError
from stereocalib_core.frames import Recording, StereoFrame
from stereocalib_core.geometry import StereoCamera
from stereocalib_core.run.drive import run_drive
from stereocalib_core.sources import SourceKind, open_source, prefetch, source_kind
from stereocalib_core.sources.calibrations.own_yaml import read_camera_file
from stereocalib_core.sources.formats.video import to_frame
from stereocalib_core.sources.live import LiveReader

FRAMES = 30


def side_by_side(frame: int) -> np.ndarray:
    """Left half of grey 40 + 5 frame, right half of half of it, three channels."""
    picture = np.full((HEIGHT, 2 * WIDTH, 3), 40 + 5 * frame, np.uint8)
    picture[:, WIDTH:] //= 2
    return picture


@pytest.fixture
def video(tmp_path: Path) -> Path:
    path = tmp_path / "drive.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 20, (2 * WIDTH, HEIGHT))
    for i in range(FRAMES):
        writer.write(side_by_side(i))
    writer.release()
    (tmp_path / "camera.yaml").write_text(CAMERA_YAML)
    return path


def number(frame: StereoFrame) -> int:
    assert frame.left is not None and frame.right is not None
    left, right = float(frame.left.mean()), float(frame.right.mean())
    assert right == pytest.approx(left / 2, abs=3)
    return round((left - 40) / 5)


def test_a_file_gives_every_frame_in_any_order(video: Path) -> None:
    spec = f"video:{video}?camera={video.parent / 'camera.yaml'}"
    assert source_kind(spec) is SourceKind.VIDEO
    source = open_source(spec)
    assert len(source) == FRAMES
    assert not source.live
    assert source[0].left is not None
    assert source[0].left.shape == (HEIGHT, WIDTH)
    np.testing.assert_allclose(source.timestamps_s, np.arange(FRAMES) / 20)
    assert [number(frame) for frame in prefetch(source, 0, FRAMES)] == list(range(FRAMES))
    assert [number(source[i]) for i in (29, 0, 7, 6, 20, 20)] == [29, 0, 7, 6, 20, 20]


def test_camera_yaml_may_lie_beside_the_video_and_set_the_rate(video: Path) -> None:
    (video.parent / "camera.yaml").write_text(CAMERA_YAML + "fps: 5\n")
    assert open_source(f"video:{video}?camera=camera.yaml").timestamps_s[1] == pytest.approx(0.2)


def test_bad_videos_are_one_clear_line(video: Path) -> None:
    camera = video.parent / "camera.yaml"
    text = video.parent / "text.avi"
    text.write_text("no video")
    wide = video.parent / "wide.yaml"
    wide.write_text(CAMERA_YAML.replace("width: 96", "width: 192"))
    cases = {
        f"video:{video}": "camera=camera.yaml",
        f"video:{video}?cam={camera}": "camera=camera.yaml",
        f"video:?camera={camera}": "bad video source",
        f"video:{video}?camera={camera}&camera={camera}": "bad video source",
        f"video:{video.parent / 'none.avi'}?camera={camera}": "no such video",
        f"video:{text}?camera={camera}": "cannot be opened",
        f"video:{video}?camera={video.parent / 'none.yaml'}": "no such calibration",
        f"video:{video}?camera={wide}": "does not fit",
        f"video:99?camera={camera}": "no such camera",
    }
    for spec, part in cases.items():
        with pytest.raises(SourceError) as caught:
            open_source(spec)
        assert part in str(caught.value), spec


def test_a_cut_video_ends_where_it_can_be_read(video: Path) -> None:
    data = video.read_bytes()
    video.write_bytes(data[: int(len(data) * 0.6)])
    source = open_source(f"video:{video}?camera=camera.yaml")
    assert 10 < len(source) < FRAMES
    assert [number(frame) for frame in prefetch(source, 0, len(source))] == list(range(len(source)))


def test_a_frame_that_cannot_be_read_or_has_another_size() -> None:
    camera = StereoCamera(WIDTH, HEIGHT, 80.0, 47.5, 31.5, 0.5)
    lost = to_frame(3, 0.3, None, camera)
    assert lost.failure is not None and lost.failure.reason is FailureReason.UNREADABLE
    odd = to_frame(3, 0.3, np.zeros((HEIGHT, WIDTH, 3), np.uint8), camera)
    assert odd.failure is not None and odd.failure.reason is FailureReason.SIZE_MISMATCH


@pytest.mark.wall_clock
def test_a_live_source_drops_frames_rather_than_lag() -> None:
    made = 0
    ended = threading.Event()

    def read() -> tuple[bool, np.ndarray | None]:
        nonlocal made
        time.sleep(0.005)
        if made == 100:
            ended.set()
            return False, None
        made += 1
        return True, np.full((HEIGHT, 2 * WIDTH, 3), made, np.uint8)

    camera = StereoCamera(WIDTH, HEIGHT, 80.0, 47.5, 31.5, 0.5)
    reader = LiveReader(read)
    source = Recording(
        "live", camera, np.arange(1000) / 10.0, lambda i: to_frame(i, *reader.newest(), camera), live=True
    )
    seen, lags = [], []
    for frame in prefetch(source, 0, len(source)):
        assert frame.left is not None
        seen.append(int(frame.left[0, 0]))
        lags.append(made - seen[-1])
        time.sleep(0.05)  # ten times slower than the camera
    assert ended.is_set()
    assert 5 < len(seen) < 30
    assert all(np.diff(seen) > 0)
    assert max(lags) <= 3
    assert reader.dropped == 100 - len(seen)
    assert seen[-1] >= 98


UNRECTIFIED_YAML = f"""width: {WIDTH}
height: {HEIGHT}
left: {{K: [[80, 0, 47], [0, 81, 32], [0, 0, 1]], D: [-0.1, 0.02, 0, 0, 0]}}
right: {{K: [[79, 0, 48], [0, 80, 31], [0, 0, 1]], D: [-0.12, 0.03, 0, 0, 0]}}
R: [[1, 0, 0], [0, 0.9998, -0.019999], [0, 0.019999, 0.9998]]
t: [-0.5, 0.002, 0.003]
"""


def test_an_unrectified_video_is_rectified(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    picture = cv2.GaussianBlur(rng.integers(0, 256, (HEIGHT, 2 * WIDTH)).astype(np.uint8), (0, 0), 3)
    picture = cv2.normalize(picture, None, 0, 255, cv2.NORM_MINMAX)
    writer = cv2.VideoWriter(
        str(tmp_path / "v.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 20, (2 * WIDTH, HEIGHT)
    )
    for _ in range(3):
        writer.write(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR))
    writer.release()
    (tmp_path / "camera.yaml").write_text(UNRECTIFIED_YAML)
    rectifier = read_camera_file(tmp_path / "camera.yaml").rectifier
    assert rectifier is not None
    frame = open_source(f"video:{tmp_path / 'v.avi'}?camera=camera.yaml")[1]
    halves = picture[:, :WIDTH].copy(), picture[:, WIDTH:].copy()
    for found, raw, wanted in zip((frame.left, frame.right), halves, rectifier.apply(*halves), strict=True):
        assert found is not None
        assert np.abs(found.astype(float) - wanted).mean() < 3.0
        assert np.abs(found.astype(float) - raw).mean() > 10.0


class Device:
    """A camera that gives 300 pictures, 100 a second at most, in place of `cv2.VideoCapture`."""

    def __init__(self, number: int) -> None:
        self.given = 0

    def isOpened(self) -> bool:  # noqa: N802
        return True

    def set(self, key: int, value: float) -> bool:
        return True

    def get(self, key: int) -> float:
        return {cv2.CAP_PROP_FRAME_WIDTH: 2 * WIDTH, cv2.CAP_PROP_FRAME_HEIGHT: HEIGHT}[key]

    def read(self) -> tuple[bool, np.ndarray | None]:
        time.sleep(0.01)
        self.given += 1
        return self.given <= 300, side_by_side(self.given % 40)


@pytest.mark.wall_clock
def test_a_run_on_a_live_device_ends_with_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever is slower than the device skips pictures; the times are those at which they came."""
    monkeypatch.setattr("stereocalib_core.sources.formats.video.cv2.VideoCapture", Device)
    (tmp_path / "camera.yaml").write_text(CAMERA_YAML)

    def slow(done: int, *_: object) -> None:
        time.sleep(0.1)

    drive = run_drive(f"video:0?camera={tmp_path / 'camera.yaml'}", tmp_path / "out", progress=slow)
    assert 2 <= len(drive.frames) < 150
    rows = list(csv.DictReader((tmp_path / "out" / "extrinsics.csv").open()))
    times = np.array([float(row["timestamp_s"]) for row in rows])
    assert np.all(np.diff(times) > 0)
    assert np.median(np.diff(times)) > 0.08
    assert times[-1] > 0.8


@pytest.mark.parametrize("layout", ["top-bottom", "half-width"])
def test_other_layouts_of_both_pictures(tmp_path: Path, layout: str) -> None:
    rng = np.random.default_rng(3)
    sides = [
        cv2.GaussianBlur(rng.integers(0, 256, (HEIGHT, WIDTH)).astype(np.uint8), (0, 0), 5) for _ in "lr"
    ]
    if layout == "half-width":
        both = np.hstack(
            [cv2.resize(side, (WIDTH // 2, HEIGHT), interpolation=cv2.INTER_AREA) for side in sides]
        )
    else:
        both = np.vstack(sides)
    size = (both.shape[1], both.shape[0])
    writer = cv2.VideoWriter(str(tmp_path / "v.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 20, size)
    for _ in range(3):
        writer.write(cv2.cvtColor(both, cv2.COLOR_GRAY2BGR))
    writer.release()
    (tmp_path / "camera.yaml").write_text(CAMERA_YAML)
    spec = f"video:{tmp_path / 'v.avi'}?camera=camera.yaml"
    frame = open_source(f"{spec}&layout={layout}")[1]
    for found, wanted in zip((frame.left, frame.right), sides, strict=True):
        assert found is not None and found.shape == (HEIGHT, WIDTH)
        assert np.abs(found[:, 4:-4].astype(float) - wanted[:, 4:-4]).mean() < 3.0
    if layout == "half-width":
        with pytest.raises(SourceError, match="layout=half-width"):
            open_source(spec)
    else:
        assert any("top-bottom" in note for note in open_source(spec).notices)
    with pytest.raises(SourceError, match="unknown layout"):
        open_source(f"{spec}&layout=diagonal")
