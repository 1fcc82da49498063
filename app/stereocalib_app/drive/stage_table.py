"""The pictures that a frame can be looked at through: name, what its colours mean, and how it is drawn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from stereocalib_app.drive import histograms, render
from stereocalib_app.widgets import canvas, palette
from stereocalib_app.widgets.canvas import Picture
from stereocalib_core.frames import StereoFrame
from stereocalib_core.front.road.result import RoadResult
from stereocalib_core.geometry import Extrinsics, StereoCamera


@dataclass(frozen=True)
class Seen:
    """A frame with everything that the method saw in it. road: what it is judged by, live: a second one."""

    frame: StereoFrame
    stages: RoadResult | None
    camera: StereoCamera
    road: Extrinsics | None = None
    live: Extrinsics | None = None
    T_camera_lidar: NDArray[np.float64] | None = None
    marks: Callable[[Picture], None] | None = None
    """Draws what a lesson explains on the left image."""
    histogram_px: int = 1200
    """Width of a histogram: its cells are larger than pixels, so that their counts can be seen."""
    measured: StereoCamera | None = None
    """The camera that the stages speak of, where `camera` is one of larger pixels."""

    def shrunk(self, by: int) -> Seen:
        """The same through a camera whose pixels are `by` times as large, for a picture that is small; without what
        a lesson draws, which is made for the whole picture."""
        if by == 1 and self.marks is None:
            return self
        left, right = (_means(picture, by) for picture in (self.frame.left, self.frame.right))
        frame = replace(self.frame, left=left, right=right)
        width = self.histogram_px // by
        camera = self.camera.shrunk(by)
        measured = self.measured or self.camera
        return replace(self, frame=frame, camera=camera, marks=None, histogram_px=width, measured=measured)


def _means(picture: NDArray[np.uint8] | None, by: int) -> NDArray[np.uint8] | None:
    """(h // by, w // by) means of by x by pixels."""
    if picture is None or by == 1:
        return picture
    height, width = (side // by for side in picture.shape)
    whole = np.ascontiguousarray(picture[: height * by, : width * by])
    return np.asarray(cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA), dtype=np.uint8)


Legend = tuple[tuple[str, palette.Rgb], ...]
CLASSES: Final[Legend] = (("road", palette.ROAD), ("free", palette.FREE), ("upright", palette.OBSTACLE))


@dataclass(frozen=True)
class Stage:
    """One way to look at a frame. axes: `image`, or what is counted along x and y."""

    legend: Legend
    draw: Callable[[Seen], Picture]
    axes: str = "image"
    without_stages: bool = False
    """Whether there is something to see where the method saw nothing."""


def _left(seen: Seen) -> Picture:
    body = render.left_view(seen.frame, seen.stages, seen.camera, seen.live)
    if seen.marks is not None and seen.frame.left is not None:
        seen.marks(body)
    return body


def _disparity(seen: Seen) -> Picture:
    assert seen.stages is not None
    return render.disparity_view(seen.stages, seen.camera.width, seen.camera.height)


def _free_map(seen: Seen) -> Picture:
    assert seen.stages is not None
    return render.free_map_view(seen.frame, seen.stages, seen.camera.width, seen.camera.height)


def _u_disparity(seen: Seen) -> Picture:
    assert seen.stages is not None
    return histograms.u_disparity_view(seen.stages, seen.histogram_px, seen.histogram_px // 2)


def _v_disparity(seen: Seen) -> Picture:
    assert seen.stages is not None
    width = seen.histogram_px
    camera = seen.measured or seen.camera
    return histograms.v_disparity_view(seen.stages, camera, width, int(width * 0.62), seen.live)


def _difference(seen: Seen) -> Picture:
    road = seen.live or seen.road
    if seen.stages is None or road is None:
        return canvas.notice(seen.camera.width, seen.camera.height, "no road to warp over")
    return render.difference_view(seen.frame, seen.stages, seen.camera, road)


def _lidar(seen: Seen) -> Picture:
    return render.lidar_view(seen.frame, seen.camera, seen.T_camera_lidar, seen.road)


def _shade(table: str, share: float) -> palette.Rgb:
    """The colour of a table at a share of its range."""
    r, g, b = (int(part) for part in canvas.lookup_table(table)[round(255 * share)])
    return r, g, b


STAGES: Final[dict[str, Stage]] = {
    "left image": Stage(
        (*CLASSES, ("horizon", palette.HORIZON), ("live", palette.LIVE)), _left, without_stages=True
    ),
    "disparity": Stage(
        (("far", _shade("cividis", 0.0)), ("near", _shade("cividis", 1.0)), ("no match", palette.PAPER)),
        _disparity,
    ),
    "free map": Stage(CLASSES, _free_map),
    "u-disparity": Stage((CLASSES[1], CLASSES[2]), _u_disparity, "u-disparity"),
    "v-disparity": Stage((*CLASSES, ("profile ±10σ", palette.HORIZON)), _v_disparity, "v-disparity"),
    "left − right": Stage(
        (("left brighter", (255, 64, 1)), ("alike", (128, 128, 128)), ("left darker", (1, 64, 255))),
        _difference,
    ),
    "LiDAR": Stage(
        tuple(
            (f"{words} {height_m:g} m".replace("-", "−").strip(), _shade("viridis", share))
            for words, height_m, share in (
                ("≤", render.HEIGHTS_M[0], 0.0),
                ("road", 0.0, -render.HEIGHTS_M[0] / (render.HEIGHTS_M[1] - render.HEIGHTS_M[0])),
                ("", 1.0, (1.0 - render.HEIGHTS_M[0]) / (render.HEIGHTS_M[1] - render.HEIGHTS_M[0])),
                ("≥", render.HEIGHTS_M[1], 1.0),
            )
        ),
        _lidar,
        without_stages=True,
    ),
}


def draw(name: str, seen: Seen) -> Picture:
    """The picture of a stage, or a calm one that says why there is none."""
    stage = STAGES[name]
    if seen.stages is None and not stage.without_stages:
        why = seen.frame.failure
        words = "" if why is None else str(why.reason)
        return canvas.notice(seen.camera.width, seen.camera.height, "no stages for this frame", words)
    return stage.draw(seen)


def extent(name: str, seen: Seen) -> tuple[float, float]:
    """What the right and the lower edge of a picture stand for, in the units of its axes."""
    axes = STAGES[name].axes
    if axes == "image" or seen.stages is None:
        return float(seen.camera.width), float(seen.camera.height)
    disparity = len(seen.stages.u_disparity) * seen.stages.bin_px
    rows = seen.stages.v_disparity.shape[0] * seen.stages.disparity.step_px
    return (float(seen.camera.width), disparity) if axes == "u-disparity" else (disparity, float(rows))
