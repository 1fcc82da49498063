"""The pictures of a frame, made once for every browser and layout and kept in a bounded cache."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Generic, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from stereocalib_app.drive import render
from stereocalib_app.widgets import canvas, palette
from stereocalib_core.frames import FrameSource, StereoFrame
from stereocalib_core.front.road.stages import RoadStages
from stereocalib_core.geometry import Extrinsics, StereoCamera

T = TypeVar("T")
CLOUD_POINTS = 14_000
CLOUD_RANGE_M = 45.0
PICTURE_CACHE_BYTES = 96_000_000
AHEAD_THREADS = 2


class BoundedCache(Generic[T]):
    """Least recently used values within a budget; a value asked for by several threads is made once."""

    def __init__(self, budget: int, cost: Callable[[T], int]) -> None:
        self._budget, self._cost = budget, cost
        self._values: OrderedDict[Hashable, T] = OrderedDict()
        self._used = 0
        self._lock = threading.Lock()
        self._making: dict[Hashable, threading.Event] = {}

    def get(self, key: Hashable, make: Callable[[], T]) -> T:
        """The value of `key`, made by `make` where it is not there."""
        while True:
            with self._lock:
                if key in self._values:
                    self._values.move_to_end(key)
                    return self._values[key]
                event = self._making.get(key)
                if event is None:
                    event = self._making[key] = threading.Event()
                    break
            event.wait(timeout=30.0)
        try:
            value = make()
            with self._lock:
                self._values[key] = value
                self._used += self._cost(value)
                while self._used > self._budget and len(self._values) > 1:
                    self._used -= self._cost(self._values.popitem(last=False)[1])
            return value
        finally:
            with self._lock:
                del self._making[key]
            event.set()

    def put(self, key: Hashable, value: T) -> None:
        """Keep a value that was made elsewhere, unless there is one or it is being made."""
        with self._lock:
            known = key in self._values or key in self._making
        if not known:
            self.get(key, lambda: value)

    def __len__(self) -> int:
        return len(self._values)

    def __contains__(self, key: Hashable) -> bool:
        return key in self._values


@dataclass(frozen=True)
class FrameStages:
    """A frame with everything that the method saw in it."""

    frame: StereoFrame
    stages: RoadStages | None


@dataclass(frozen=True)
class FrameView:
    """One frame ready to be sent: the picture (left image above the stages) as JPEG, the coloured cloud in the
    camera frame [m], and the left image once more, small."""

    index: int
    jpeg: bytes
    points: NDArray[np.float32]
    colors: NDArray[np.uint8]
    small: NDArray[np.uint8] | None


SMALL_PX = 320
MOVING_PX = 640
"""Width of a picture while the drive plays."""


def small_picture(frame: StereoFrame) -> NDArray[np.uint8] | None:
    """The left image, small, for the frustum."""
    if frame.left is None:
        return None
    height = max(1, round(frame.left.shape[0] * SMALL_PX / frame.left.shape[1]))
    small = cv2.resize(frame.left, (SMALL_PX, height), interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.cvtColor(small, cv2.COLOR_GRAY2RGB), dtype=np.uint8)


def cloud(frame: StereoFrame, stages: RoadStages | None, camera: StereoCamera) -> tuple[NDArray, NDArray]:
    """Coloured points of one pair in the camera frame: (N, 3) float32 [m] and (N, 3) uint8."""
    if stages is None or frame.left is None:
        return np.zeros((1, 3), np.float32), np.zeros((1, 3), np.uint8)
    values = stages.disparity.values
    every = max(1, int(np.sqrt(values.size / (1.6 * CLOUD_POINTS))))
    d = values[::every, ::every]
    u = stages.disparity.columns_u()[::every][None, :]
    v = stages.disparity.rows_v()[::every][:, None]
    good = d > camera.focal_px * camera.baseline_m / CLOUD_RANGE_M
    points = camera.back_project(*np.broadcast_arrays(u, v, np.where(good, d, 1.0)))[good]
    grey = cv2.resize(frame.left, values.shape[::-1], interpolation=cv2.INTER_AREA)[::every, ::every]
    colors = np.repeat(grey[..., None], 3, axis=2)
    for mask, tint in ((stages.road, palette.ROAD), (stages.obstacles, palette.OBSTACLE)):
        canvas.blend(colors, mask[::every, ::every], tint, 0.22)
    if not good.any():
        return np.zeros((1, 3), np.float32), np.zeros((1, 3), np.uint8)
    return points.astype(np.float32), colors[good]


class FrameViews:
    """Makes and keeps the views of one drive."""

    def __init__(self, source: FrameSource, stages: Callable[[StereoFrame], RoadStages | None]) -> None:
        self._source, self._make_stages = source, stages
        self._stages: BoundedCache[FrameStages] = BoundedCache(24, lambda _: 1)
        self._makers = ThreadPoolExecutor(AHEAD_THREADS, "views ahead")
        self._ahead: list[Future[FrameView]] = []
        self._views: BoundedCache[FrameView] = BoundedCache(
            PICTURE_CACHE_BYTES,
            lambda v: len(v.jpeg) + v.points.nbytes + v.colors.nbytes,
        )

    def keep(self, frame: StereoFrame, stages: RoadStages | None) -> None:
        """What the front end has just seen in a frame."""
        self._stages.put(frame.index, FrameStages(frame, stages))

    def stages(self, index: int) -> FrameStages:
        """The frame and its stages."""

        def make() -> FrameStages:
            frame = self._source[index]
            return FrameStages(frame, self._make_stages(frame))

        return self._stages.get(index, make)

    def get(self, index: int, layout: str, live: Extrinsics | None = None, moving: bool = False) -> FrameView:
        """The frame's picture in a layout; `live` draws a second road with those extrinsics; a `moving` picture is
        smaller: browsers without a graphics card take most of their time for large ones."""

        def make() -> FrameView:
            seen = self.stages(index)
            camera = self._source.camera
            points, colors = cloud(seen.frame, seen.stages, camera)
            picture = render.composed_view(seen.frame, seen.stages, camera, layout, live)
            if moving:
                size = MOVING_PX, round(picture.shape[0] * MOVING_PX / picture.shape[1])
                picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
            return FrameView(index, canvas.encode_jpeg(picture), points, colors, small_picture(seen.frame))

        return self._views.get((index, layout, live, moving), make)

    def has(self, index: int, layout: str, live: Extrinsics | None = None, moving: bool = False) -> bool:
        """Whether `get` would answer at once."""
        return (index, layout, live, moving) in self._views

    def make_ahead(self, wanted: Sequence[tuple[int, Extrinsics | None]], layout: str) -> None:
        """Make moving views in the background that will be asked for soon; what was asked for last time is
        forgotten."""
        for future in self._ahead:
            future.cancel()
        try:
            self._ahead = [self._makers.submit(self.get, index, layout, live, True) for index, live in wanted]
        except RuntimeError:
            # Closed meanwhile: the page that asked is on its way out.
            self._ahead = []

    def close(self) -> None:
        """Make nothing more ahead."""
        self._makers.shutdown(wait=False, cancel_futures=True)
