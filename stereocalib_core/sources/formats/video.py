"""`video:FILE?camera=camera.yaml`: both pictures side by side in a video file, or a live device (`video:0?...`)."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl

import cv2
import numpy as np
from numpy.typing import NDArray

from stereocalib_core.errors import Failure, FailureReason, SourceError
from stereocalib_core.frames import Recording, StereoFrame
from stereocalib_core.geometry import StereoCamera
from stereocalib_core.sources.calibrations.own_yaml import CameraFile, read_camera_file
from stereocalib_core.sources.formats.folder import rectifying
from stereocalib_core.sources.live import LiveReader
from stereocalib_core.sources.pairing import content_key

DEFAULT_FPS = 10.0
LIVE_HOURS = 24
GRAB_AHEAD = 200
"""Frames skipped by decoding them; farther ones are sought."""


def open_video(spec: str) -> Recording:
    """A video file or live device as a recording; raises SourceError."""
    name, camera_path = _parts(spec)
    described = read_camera_file(camera_path)
    if name.isdecimal():
        return _open_device(int(name), described)
    path = Path(name).expanduser()
    if not path.is_file():
        raise SourceError("no such video", name, "check the path; a number is a live device")
    return _open_file(path, described, camera_path)


def _parts(spec: str) -> tuple[str, Path]:
    name, _, query = spec.removeprefix("video:").rpartition("?")
    options = parse_qsl(query, keep_blank_values=True)
    if not name or len(options) != 1 or options[0][0] != "camera" or not options[0][1]:
        raise SourceError("bad video source", spec, "write video:FILE?camera=camera.yaml")
    camera = Path(options[0][1]).expanduser()
    beside = Path(name).expanduser().parent / camera
    return name, beside if not camera.is_file() and beside.is_file() else camera


def split(
    picture: NDArray[np.uint8], camera: StereoCamera
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]] | None:
    """A (H, 2 W[, 3]) picture to its grey halves; None where it has another size."""
    if picture.shape[:2] != (camera.height, 2 * camera.width):
        return None
    grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY) if picture.ndim == 3 else picture
    return (
        np.ascontiguousarray(grey[:, : camera.width], dtype=np.uint8),
        np.ascontiguousarray(grey[:, camera.width :], dtype=np.uint8),
    )


def to_frame(
    index: int, time_s: float, picture: NDArray[np.uint8] | None, camera: StereoCamera
) -> StereoFrame:
    """A side-by-side picture, or None for one that could not be read, to a frame."""
    if picture is None:
        failure = Failure(FailureReason.UNREADABLE, "the video gives no picture here")
        return StereoFrame(index, time_s, None, None, failure)
    halves = split(picture, camera)
    if halves is None:
        detail = f"picture is {picture.shape[1]}x{picture.shape[0]}, not 2x{camera.width}x{camera.height}"
        return StereoFrame(index, time_s, None, None, Failure(FailureReason.SIZE_MISMATCH, detail))
    return StereoFrame(index, time_s, *halves)


def _check_size(capture: Any, camera: StereoCamera, where: object) -> None:
    width, height = (int(capture.get(key)) for key in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
    if (width, height) != (2 * camera.width, camera.height):
        found = f"{width}x{height} pixels, camera.yaml needs 2x{camera.width}x{camera.height} side by side"
        raise SourceError("video does not fit the camera", where, found)


class FileReader:
    """Frame i of a video file, whichever order they are asked for in."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._lock = threading.Lock()
        self._capture = cv2.VideoCapture(str(path))
        self._next = 0
        if not self._capture.isOpened():
            raise SourceError("video cannot be opened", path, "convert it, e.g. to MP4 with H.264")

    @property
    def capture(self) -> Any:
        """The open file, for its properties."""
        return self._capture

    def count(self) -> int:
        """How many frames can really be read; what the file claims is only believed when its last one is there."""
        claimed = int(self._capture.get(cv2.CAP_PROP_FRAME_COUNT))
        if 0 < claimed < 10**8 and self.read(claimed - 1) is not None:
            return claimed
        with self._lock:
            self._rewind()
            counted = 0
            while self._capture.grab():
                counted += 1
            self._next = counted
        return counted

    def read(self, index: int) -> NDArray[np.uint8] | None:
        """(H, W, 3) uint8, or None where there is none."""
        with self._lock:
            if not 0 <= index - self._next <= GRAB_AHEAD:
                self._capture.set(cv2.CAP_PROP_POS_FRAMES, index)
                self._next = index
                if int(self._capture.get(cv2.CAP_PROP_POS_FRAMES)) != index:
                    self._rewind()
            while self._next < index:
                if not self._capture.grab():
                    return None
                self._next += 1
            ok, picture = self._capture.read()
            self._next += 1
            return np.asarray(picture, dtype=np.uint8) if ok else None

    def _rewind(self) -> None:
        self._capture.release()
        self._capture = cv2.VideoCapture(str(self._path))
        self._next = 0


def _open_file(path: Path, described: CameraFile, camera_path: Path) -> Recording:
    camera, reader = described.camera, FileReader(path)
    _check_size(reader.capture, camera, path)
    claimed_fps = float(reader.capture.get(cv2.CAP_PROP_FPS))
    fps = described.fps or (claimed_fps if 0.1 <= claimed_fps <= 1000 else DEFAULT_FPS)
    count = reader.count()
    if count == 0:
        raise SourceError("video without a frame", path, "check the file")

    def load(index: int) -> StereoFrame:
        return to_frame(index, index / fps, reader.read(index), camera)

    return Recording(
        name=path.name,
        camera=camera,
        timestamps_s=np.arange(count) / fps,
        load=_rectified(load, described),
        notices=("no ground-truth poses: errors are not computed",),
        content_key=content_key("video", [path, camera_path]),
    )


def _open_device(number: int, described: CameraFile) -> Recording:
    camera = described.camera
    capture = cv2.VideoCapture(number)
    if not capture.isOpened():
        raise SourceError("no such camera", f"device {number}", "check that it is plugged in and free")
    capture.set(cv2.CAP_PROP_FRAME_WIDTH, 2 * camera.width)
    capture.set(cv2.CAP_PROP_FRAME_HEIGHT, camera.height)
    _check_size(capture, camera, f"device {number}")
    reader = LiveReader(capture.read)
    fps = described.fps or DEFAULT_FPS

    def load(index: int) -> StereoFrame:
        time_s, picture = reader.newest()
        return to_frame(index, time_s, picture, camera)

    return Recording(
        name=f"device {number}",
        camera=camera,
        timestamps_s=np.arange(int(LIVE_HOURS * 3600 * fps)) / fps,
        load=_rectified(load, described),
        notices=("live: frames that come while one is worked on are dropped",),
        content_key=f"live-{number}-{reader.started_ns}",
        live=True,
    )


def _rectified(load: Callable[[int], StereoFrame], described: CameraFile) -> Callable[[int], StereoFrame]:
    return load if described.rectifier is None else rectifying(load, described.rectifier)
