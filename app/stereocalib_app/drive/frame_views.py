"""The pictures of a frame, made once for every browser and layout and kept in a bounded cache."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from stereocalib_app.drive import stage_table
from stereocalib_app.drive.lesson_marks import marks
from stereocalib_app.drive.stage_table import STAGES, Seen
from stereocalib_app.widgets import canvas, palette
from stereocalib_core.frames import FrameSource, StereoFrame
from stereocalib_core.front.road.result import RoadResult
from stereocalib_core.geometry import Extrinsics, StereoCamera
from stereocalib_core.results import FrameResult

T = TypeVar("T")
CLOUD_POINTS, MOVING_POINTS = 14_000, 5_000
"""While playing a third of the points is enough to see, and a class on one page can keep up."""
CLOUD_RANGE_M = 45.0
PICTURE_CACHE_BYTES, STAGES_CACHE_BYTES = 96_000_000, 80_000_000
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
    stages: RoadResult | None

    @property
    def nbytes(self) -> int:
        """Memory of its pictures and maps."""
        arrays: list[NDArray | None] = [self.frame.left, self.frame.right, self.frame.lidar]
        if self.stages is not None:
            s = self.stages
            arrays += [s.disparity.values, s.u_disparity, s.v_disparity, s.v_disparity_whole]
            arrays += [s.obstacles, s.free, s.road]
        return sum(array.nbytes for array in arrays if array is not None)


@dataclass(frozen=True)
class Thumbnail:
    """Where a stage is on the sheet of thumbnails [px]."""

    name: str
    x: int
    y: int
    width: int
    height: int


@dataclass(frozen=True)
class FrameView:
    """One frame ready to be sent.

    jpeg: the stage on show, `size` (width, height) of it [px], `extent`: what its right and lower edge stand for.
    sheet, thumbnails: all stages, small, on one JPEG. points, colors: the coloured cloud in the camera frame [m].
    small: the left image once more, for the frustum.
    """

    index: int
    layout: str
    jpeg: bytes
    size: tuple[int, int]
    extent: tuple[float, float]
    sheet: bytes
    thumbnails: tuple[Thumbnail, ...]
    points: NDArray[np.float32]
    colors: NDArray[np.uint8]
    small: NDArray[np.uint8] | None


@dataclass(frozen=True, eq=False)
class Lesson:
    """What a step of the method draws on a frame: its title, the frame's result, what the filter made of it,
    and the path around it."""

    title: str
    result: FrameResult | None
    filtered: tuple[Extrinsics, NDArray[np.float64]] | None
    yaw_rad: float
    path: NDArray[np.float64] | None = None

    def _key(self) -> tuple[object, ...]:
        known = None if self.filtered is None else self.filtered[0]
        path = None if self.path is None else self.path.tobytes()
        return self.title, id(self.result), known, self.yaw_rad, path

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Lesson) and self._key() == other._key()

    def __hash__(self) -> int:
        return hash(self._key())

    def draw(
        self, camera: StereoCamera, road: Extrinsics | None, live: Extrinsics | None
    ) -> Callable[[canvas.Picture], None] | None:
        """Draws it, None where the lesson draws nothing of its own."""
        if road is not None and live is None:
            road = replace(road, yaw_rad=self.yaw_rad)
        return marks(self.title, camera, self.result, road, self.filtered, live, self.path)


@dataclass(frozen=True)
class Look:
    """How a frame is looked at: the stage on show, a second road with the page's corrections, the road it is judged
    by where the pair itself has none, and what a lesson draws on it."""

    layout: str
    live: Extrinsics | None = None
    road: Extrinsics | None = None
    lesson: Lesson | None = None


SMALL_PX = 320
MOVING_PX = 640
"""About the width of a picture while the drive plays."""
THUMB_PX, THUMB_COLUMNS = 320, 2
QUALITY, MOVING_QUALITY = 92, 75


def small_picture(frame: StereoFrame) -> NDArray[np.uint8] | None:
    """The left image, small, for the frustum."""
    if frame.left is None:
        return None
    height = max(1, round(frame.left.shape[0] * SMALL_PX / frame.left.shape[1]))
    small = cv2.resize(frame.left, (SMALL_PX, height), interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.cvtColor(small, cv2.COLOR_GRAY2RGB), dtype=np.uint8)


def cloud(
    frame: StereoFrame, stages: RoadResult | None, camera: StereoCamera, most: int = CLOUD_POINTS
) -> tuple[NDArray, NDArray]:
    """Coloured points of one pair, about `most`, in the camera frame: (N, 3) float32 [m] and (N, 3) uint8."""
    if stages is None or frame.left is None:
        return np.zeros((1, 3), np.float32), np.zeros((1, 3), np.uint8)
    values = stages.disparity.values
    every = max(1, int(np.sqrt(values.size / (1.6 * most))))
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


def contact_sheet(names: Sequence[str], seen: Seen) -> tuple[canvas.Picture, tuple[Thumbnail, ...]]:
    """Every stage small, two in a row; and where each is."""
    small = seen.shrunk(max(1, -(-seen.camera.width // THUMB_PX)))
    found = []
    for name in names:
        picture = stage_table.draw(name, small)
        if picture.shape[1] > THUMB_PX:
            size = THUMB_PX, max(1, round(picture.shape[0] * THUMB_PX / picture.shape[1]))
            picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
        found.append(picture)
    rows = [found[i : i + THUMB_COLUMNS] for i in range(0, len(found), THUMB_COLUMNS)]
    heights = [max(p.shape[0] for p in row) for row in rows]
    sheet = np.full((sum(heights), THUMB_PX * THUMB_COLUMNS, 3), palette.PAPER, np.uint8)
    places: list[Thumbnail] = []
    for row, y in zip(rows, np.cumsum([0, *heights[:-1]]), strict=True):
        for column, picture in enumerate(row):
            x, (h, w) = column * THUMB_PX, picture.shape[:2]
            sheet[y : y + h, x : x + w] = picture
            places.append(Thumbnail(names[len(places)], x, int(y), w, h))
    return sheet, tuple(places)


class FrameViews:
    """Makes and keeps the views of one drive."""

    def __init__(
        self,
        source: FrameSource,
        stages: Callable[[StereoFrame], RoadResult | None],
    ) -> None:
        self._source, self._make_stages = source, stages
        self._stages: BoundedCache[FrameStages] = BoundedCache(STAGES_CACHE_BYTES, lambda s: s.nbytes)
        self._makers = ThreadPoolExecutor(AHEAD_THREADS, "views ahead")
        self._ahead: list[Future[FrameView]] = []
        self._views: BoundedCache[FrameView] = BoundedCache(
            PICTURE_CACHE_BYTES,
            lambda v: len(v.jpeg) + len(v.sheet) + v.points.nbytes + v.colors.nbytes,
        )

    def keep(self, frame: StereoFrame, stages: RoadResult | None) -> None:
        """What the front end has just seen in a frame."""
        self._stages.put(frame.index, FrameStages(frame, stages))

    def stages(self, index: int) -> FrameStages:
        """The frame and its stages."""

        def make() -> FrameStages:
            frame = self._source[index]
            return FrameStages(frame, self._make_stages(frame))

        return self._stages.get(index, make)

    def get(self, index: int, look: Look, moving: bool = False) -> FrameView:
        """The frame as it is looked at; a `moving` picture is smaller: browsers without a graphics card take most of
        their time for large ones."""
        return self._views.get((index, look, moving), lambda: self._make(index, look, moving))

    def _make(self, index: int, look: Look, moving: bool) -> FrameView:
        found = self.stages(index)
        camera = self._source.camera
        own = (
            None
            if found.stages is None or found.stages.estimate is None
            else found.stages.estimate.extrinsics
        )
        marks = None if look.lesson is None else look.lesson.draw(camera, own or look.road, look.live)
        T = self._source.T_camera_lidar
        seen = Seen(found.frame, found.stages, camera, own or look.road, look.live, T, marks)
        by = max(1, round(camera.width / MOVING_PX)) if moving else 1
        if by > 1 and marks is None:
            picture = stage_table.draw(look.layout, seen.shrunk(by))
        else:
            picture = stage_table.draw(look.layout, seen)
            if by > 1:
                size = picture.shape[1] // by, picture.shape[0] // by
                picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
        sheet, thumbnails = contact_sheet(self._names(), seen)
        quality = MOVING_QUALITY if moving else QUALITY
        most = MOVING_POINTS if moving else CLOUD_POINTS
        points, colors = cloud(found.frame, found.stages, camera, most)
        return FrameView(
            index,
            look.layout,
            canvas.encode_jpeg(picture, quality),
            (picture.shape[1], picture.shape[0]),
            stage_table.extent(look.layout, seen),
            canvas.encode_jpeg(sheet, MOVING_QUALITY),
            thumbnails,
            points,
            colors,
            small_picture(found.frame),
        )

    def _names(self) -> list[str]:
        return [name for name in STAGES if name != "LiDAR" or self._source.T_camera_lidar is not None]

    def has(self, index: int, look: Look, moving: bool = False) -> bool:
        """Whether `get` would answer at once."""
        return (index, look, moving) in self._views

    def make_ahead(self, wanted: Sequence[tuple[int, Look]]) -> None:
        """Make moving views in the background that will be asked for soon; what was asked for last time is
        forgotten."""
        for future in self._ahead:
            future.cancel()
        try:
            self._ahead = [self._makers.submit(self.get, index, look, True) for index, look in wanted]
        except RuntimeError:
            # Closed meanwhile: the page that asked is on its way out.
            self._ahead = []

    def close(self) -> None:
        """Make nothing more ahead."""
        self._makers.shutdown(wait=False, cancel_futures=True)
