"""The pictures that a frame can be looked at through: name, what its colours mean, and how it is drawn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from stereocalib_app.drive import histograms, render
from stereocalib_app.widgets import canvas, palette
from stereocalib_app.widgets.canvas import Picture
from stereocalib_core.frames import StereoFrame
from stereocalib_core.front.road.stages import RoadStages
from stereocalib_core.geometry import Extrinsics, StereoCamera


@dataclass(frozen=True)
class Seen:
    """A frame with everything that the method saw in it. road: what it is judged by, live: a second one."""

    frame: StereoFrame
    stages: RoadStages | None
    camera: StereoCamera
    road: Extrinsics | None = None
    live: Extrinsics | None = None
    T_camera_lidar: NDArray[np.float64] | None = None
    marks: Callable[[Picture], None] | None = None
    """Draws what a lesson explains on the left image."""


Legend = tuple[tuple[str, palette.Rgb], ...]
CLASSES: Final[Legend] = (("road", palette.ROAD), ("free", palette.FREE), ("upright", palette.OBSTACLE))
HISTOGRAM_PX: Final = 1200
"""Width of a histogram: its cells are larger than pixels, so that their counts can be seen."""


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
    return histograms.u_disparity_view(seen.stages, HISTOGRAM_PX, HISTOGRAM_PX // 2)


def _v_disparity(seen: Seen) -> Picture:
    assert seen.stages is not None
    return histograms.v_disparity_view(
        seen.stages, seen.camera, HISTOGRAM_PX, int(HISTOGRAM_PX * 0.62), seen.live
    )


def _difference(seen: Seen) -> Picture:
    road = seen.live or seen.road
    if seen.stages is None or road is None:
        return canvas.notice(seen.camera.width, seen.camera.height, "no road to warp over")
    return render.difference_view(seen.frame, seen.stages, seen.camera, road)


def _lidar(seen: Seen) -> Picture:
    return render.lidar_view(seen.frame, seen.camera, seen.T_camera_lidar, seen.road)


STAGES: Final[dict[str, Stage]] = {
    "left image": Stage(
        (*CLASSES, ("horizon", palette.HORIZON), ("live", palette.LIVE)), _left, without_stages=True
    ),
    "disparity": Stage((), _disparity),
    "free map": Stage(CLASSES, _free_map),
    "u-disparity": Stage((CLASSES[1], CLASSES[2]), _u_disparity, "u-disparity"),
    "v-disparity": Stage((*CLASSES, ("profile ±10σ", palette.HORIZON)), _v_disparity, "v-disparity"),
    "left − right": Stage(
        (("left brighter", (255, 64, 1)), ("alike", (128, 128, 128)), ("left darker", (1, 64, 255))),
        _difference,
    ),
    "LiDAR": Stage((), _lidar, without_stages=True),
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
