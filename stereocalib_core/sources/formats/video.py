"""`video:FILE?camera=camera.yaml`: both pictures in a video file, side by side, one over the other or each squeezed
to half its width, or in two files (`video:left.mp4,right.mp4?...`), or a live device (`video:0?...`)."""

from __future__ import annotations

import dataclasses
import os
import threading
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereocalib_core.calibration import Size, StereoCalibration
from stereocalib_core.config.reading import LEAST_FPS, LIKELY_FPS, MOST_FPS, UNSTATED_FPS
from stereocalib_core.errors import Failure, FailureReason, SourceError
from stereocalib_core.frames import Recording, StereoFrame
from stereocalib_core.geometry import StereoCamera
from stereocalib_core.sources.assembly import rectifying, unit_of
from stereocalib_core.sources.calibrations import Found, read_calibration
from stereocalib_core.sources.calibrations.rectify import opened
from stereocalib_core.sources.format import Format, SourceKind, Spec
from stereocalib_core.sources.live import LiveReader
from stereocalib_core.sources.pairing import content_key

LIVE_HOURS = 24
GRAB_AHEAD = 200
"""Frames skipped by decoding them; farther ones are sought."""
LAYOUTS = ("side-by-side", "top-bottom", "half-width")
KEYS = ("camera", "calibration", "layout", "fps", "unit")
NO_TRUTH = "no ground-truth poses: errors are not computed"


@dataclasses.dataclass(frozen=True)
class Described:
    """The calibration of a video, its frames a second where stated, and how both pictures lie in one."""

    found: Found
    fps: float | None
    layout: str | None

    def size(self, shape: Size) -> Size:
        """(width, height) of one picture of a video of `shape`."""
        return size_of_one(shape, self.layout or "side-by-side")


def _open(spec: Spec) -> Recording:
    """A video file or live device as a recording; raises SourceError."""
    options = spec.options
    wanted = options.get("calibration") or options.get("camera")
    unknown = [key for key in options if key not in KEYS]
    if not spec.name or not wanted or unknown:
        raise SourceError("bad video source", spec.text, "write video:FILE?camera=camera.yaml")
    layout = options.get("layout")
    if layout is not None and layout not in LAYOUTS:
        raise SourceError(f"unknown layout {layout[:30]}", spec.text, f"use one of {', '.join(LAYOUTS)}")
    fps = _fps(options.get("fps"), spec.text)
    names = [spec.name] if Path(spec.name).expanduser().is_file() else spec.name.split(",")
    beside = Path(names[0]).expanduser().parent / wanted
    here = Path(wanted).expanduser()
    found = read_calibration(beside if not here.exists() and beside.exists() else wanted, unit_of(options))
    described = Described(found, fps or found.calibration.fps, layout)
    if len(names) == 1 and names[0].isdecimal():
        return _open_device(int(names[0]), described)
    paths = [Path(name).expanduser() for name in names]
    for name, path in zip(names, paths, strict=True):
        if not path.is_file():
            raise SourceError("no such video", name, "check the path; a number is a live device")
    if len(paths) > 2:
        raise SourceError("bad video source", spec.text, "name one file, or the left and the right one")
    return _open_files(paths, described)


def _fps(text: str | None, where: str) -> float | None:
    if text is None:
        return None
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not LEAST_FPS <= value <= MOST_FPS:
        raise SourceError(f"fps is {text[:20]}", where, "expected a number from 0.001 to 10000")
    return value


def size_of_one(shape: Size, layout: str) -> Size:
    """(width, height) of each picture in a video of (width, height)."""
    width, height = shape
    return {"side-by-side": (width // 2, height), "top-bottom": (width, height // 2)}.get(
        layout, (width, height)
    )


def split(
    picture: NDArray[np.uint8], size: Size, layout: str = "side-by-side"
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]] | None:
    """A (H, W[, 3]) picture of both cameras to their grey ones of (width, height); None where it does not fit.

    half-width: each was squeezed to half its width, and is stretched again.
    """
    width, height = size
    shape = {"side-by-side": (height, 2 * width), "top-bottom": (2 * height, width)}.get(
        layout, (height, width)
    )
    if picture.shape[:2] != shape:
        return None
    grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY) if picture.ndim == 3 else picture
    if layout == "top-bottom":
        halves = [grey[:height], grey[height:]]
    else:
        middle = grey.shape[1] // 2
        halves = [grey[:, :middle], grey[:, middle : 2 * middle]]
    if layout == "half-width":
        halves = [cv2.resize(half, size, interpolation=cv2.INTER_LINEAR) for half in halves]
    left, right = (np.ascontiguousarray(half, dtype=np.uint8) for half in halves)
    return left, right


def to_frame(
    index: int,
    time_s: float,
    picture: NDArray[np.uint8] | None,
    camera: StereoCamera,
    layout: str = "side-by-side",
) -> StereoFrame:
    """A picture of both cameras, or None for one that could not be read, to a frame."""
    if picture is None:
        failure = Failure(FailureReason.UNREADABLE, "the video gives no picture here")
        return StereoFrame(index, time_s, None, None, failure)
    halves = split(picture, (camera.width, camera.height), layout)
    if halves is None:
        detail = f"picture is {picture.shape[1]}x{picture.shape[0]}, not 2x{camera.width}x{camera.height}"
        return StereoFrame(index, time_s, None, None, Failure(FailureReason.SIZE_MISMATCH, detail))
    return StereoFrame(index, time_s, *halves)


def _shape(capture: Any) -> Size:
    return int(capture.get(cv2.CAP_PROP_FRAME_WIDTH)), int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT))


def layout_of(shape: Size, calibration: StereoCalibration, where: object) -> str:
    """How both pictures lie in a video of (width, height), from the calibration's own size; else SourceError."""
    own = calibration.size
    if own is None:
        return "side-by-side"
    layouts = {(2 * own[0], own[1]): "side-by-side", (own[0], 2 * own[1]): "top-bottom"}
    if shape not in layouts:
        found = f"{shape[0]}x{shape[1]} pixels, camera.yaml needs 2x{own[0]}x{own[1]} side by side"
        found += "; add layout=half-width if each was squeezed to half" if shape == own else ""
        raise SourceError("video does not fit the camera", where, found)
    return layouts[shape]


class FileReader:
    """Frame i of a video file, whichever order they are asked for in."""

    def __init__(self, path: Path) -> None:
        # damaged frames are failures of the drive, not lines of the decoder on stderr
        os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
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


def _open_files(paths: list[Path], described: Described) -> Recording:
    readers = [FileReader(path) for path in paths]
    shapes = [_shape(reader.capture) for reader in readers]
    calibration = described.found.calibration
    notices = [NO_TRUTH]
    if len(readers) == 2:
        layout, size = "", shapes[0]
        if shapes[1] != shapes[0]:
            texts = " and ".join(f"{width}x{height}" for width, height in shapes)
            raise SourceError("videos of two sizes", paths[1], texts)
    else:
        layout = described.layout or layout_of(shapes[0], calibration, paths[0])
        size = size_of_one(shapes[0], layout)
        if layout != "side-by-side" and described.layout is None:
            notices.append(f"layout of the video: {layout}, as the calibration's size says")
    ready = opened(calibration, size, paths[0])
    claimed_fps = float(readers[0].capture.get(cv2.CAP_PROP_FPS))
    fps = described.fps or (claimed_fps if LIKELY_FPS[0] <= claimed_fps <= LIKELY_FPS[1] else UNSTATED_FPS)
    counts = [reader.count() for reader in readers]
    count = min(counts)
    if count == 0:
        raise SourceError("video without a frame", paths[0], "check the file")
    if max(counts) != count:
        notices.append(f"videos of {counts[0]} and {counts[1]} frames: paired from the first on")

    def load(index: int) -> StereoFrame:
        pictures = [reader.read(index) for reader in readers]
        if len(pictures) == 1:
            return to_frame(index, index / fps, pictures[0], ready.camera, layout)
        if any(picture is None for picture in pictures):
            return to_frame(index, index / fps, None, ready.camera)
        return to_frame(index, index / fps, np.hstack(pictures), ready.camera)  # type: ignore[arg-type]

    return Recording(
        name=paths[0].name,
        camera=ready.camera,
        timestamps_s=np.arange(count) / fps,
        load=load if ready.rectifier is None else rectifying(load, ready.rectifier),
        notices=(*notices, *ready.notes),
        content_key=content_key("video", [*paths, *described.found.files], layout, fps),
        calibration=calibration,
    )


def _open_device(number: int, described: Described) -> Recording:
    calibration, layout = described.found.calibration, described.layout or "side-by-side"
    if calibration.size is None:
        raise SourceError(
            "calibration without a picture size", described.found.files[0], "add width and height"
        )
    width, height = calibration.size
    shape = {"side-by-side": (2 * width, height), "top-bottom": (width, 2 * height)}.get(
        layout, (width, height)
    )
    capture = cv2.VideoCapture(number)
    if not capture.isOpened():
        raise SourceError("no such camera", f"device {number}", "check that it is plugged in and free")
    capture.set(cv2.CAP_PROP_FRAME_WIDTH, shape[0])
    capture.set(cv2.CAP_PROP_FRAME_HEIGHT, shape[1])
    if _shape(capture) != shape:
        found = f"{_shape(capture)[0]}x{_shape(capture)[1]} pixels, expected {shape[0]}x{shape[1]}"
        raise SourceError("video does not fit the camera", f"device {number}", found)
    ready = opened(calibration, calibration.size, described.found.files[0])
    reader = LiveReader(capture.read)
    fps = described.fps or UNSTATED_FPS

    def load(index: int) -> StereoFrame:
        time_s, picture = reader.newest()
        return to_frame(index, time_s, picture, ready.camera, layout)

    return Recording(
        name=f"device {number}",
        camera=ready.camera,
        timestamps_s=np.arange(int(LIVE_HOURS * 3600 * fps)) / fps,
        load=load if ready.rectifier is None else rectifying(load, ready.rectifier),
        notices=("live: frames that come while one is worked on are dropped", *ready.notes),
        content_key=f"live-{number}-{reader.started_ns}",
        live=True,
        calibration=calibration,
    )


FORMAT = Format("video", lambda spec: spec.scheme == "video", _open, SourceKind.VIDEO)
