"""Side-by-side video files, and live devices that are faster than whoever looks at them."""

from __future__ import annotations

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
from stereocalib_core.sources import SourceKind, open_source, prefetch, source_kind
from stereocalib_core.sources.live import LiveReader
from stereocalib_core.sources.video import to_frame

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
        f"video:{video.parent / 'none.avi'}?camera={camera}": "no such video",
        f"video:{text}?camera={camera}": "cannot be opened",
        f"video:{video}?camera={video.parent / 'none.yaml'}": "cannot be read",
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
