"""Arrays to pictures: the left image with the road on it, and every stage of the method. Pure functions."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from stereocalib_app.widgets import canvas, palette
from stereocalib_app.widgets.canvas import Picture
from stereocalib_core.frames import StereoFrame
from stereocalib_core.front.road.stages import RoadStages
from stereocalib_core.front.road.uv_disparity import v_disparity
from stereocalib_core.geometry import (
    Extrinsics,
    StereoCamera,
    horizon,
    road_profile,
    road_to_image,
    vanishing_point_of_travel,
)

WIDTH_PX = 960
"""Width of every composed picture."""

GAP_PX = 10
"""Between the left image and the stages."""

STAGE_NAMES = ("disparity", "u-disparity", "free map", "v-disparity")
BAND_FACTOR = 10.0
"""The profile's band is drawn at this many sigma; one sigma is thinner than a pixel."""
CLASS_COLORS = (palette.PAPER, palette.FREE, palette.ROAD, palette.OBSTACLE)
_GRID_Z = (5.0, 7.5, 10.0, 15.0, 20.0, 30.0, 50.0)
_GRID_X = (-3.5, -1.75, 0.0, 1.75, 3.5)


def _scaled(points: NDArray[np.float64], scale: float) -> NDArray[np.float64]:
    """Image points [px] to points of a picture scaled about pixel centres."""
    return (points + 0.5) * scale - 0.5


def _resize(mask: NDArray, width: int, height: int) -> NDArray:
    flags = cv2.INTER_NEAREST
    source = mask.astype(np.uint8) if mask.dtype == np.bool_ else mask
    out = cv2.resize(source, (width, height), interpolation=flags)
    return out.astype(np.bool_) if mask.dtype == np.bool_ else out


def classes_of(stages: RoadStages) -> NDArray[np.uint8]:
    """(h, w) 0 nothing, 1 free, 2 road, 3 obstacle."""
    classes = stages.free.astype(np.uint8)
    classes[stages.road] = 2
    classes[stages.obstacles] = 3
    return classes


def picture_height(camera: StereoCamera, width: int) -> int:
    """Height of a picture of the camera's shape."""
    return int(round(camera.height * width / camera.width))


def draw_road(
    picture: Picture, camera: StereoCamera, extrinsics: Extrinsics, color: palette.Rgb, labels: bool
) -> None:
    """The road grid, the horizon and the direction of travel on a picture of the camera's shape. In place."""
    scale = picture.shape[1] / camera.width
    z_line = np.geomspace(_GRID_Z[0], _GRID_Z[-1], 24)
    for x in _GRID_X:
        points = np.stack([np.full_like(z_line, x), np.zeros_like(z_line), z_line], axis=1)
        line = road_to_image(camera, extrinsics, points)[:, :2]
        canvas.polyline(picture, _scaled(line, scale), color, 2 if x == 0 else 1)
    for z in _GRID_Z:
        ends = road_to_image(camera, extrinsics, np.array([[_GRID_X[0], 0, z], [_GRID_X[-1], 0, z]]))[:, :2]
        canvas.polyline(picture, _scaled(ends, scale), color, 1)
        if labels and z in (5.0, 10.0, 20.0):
            x_px, y_px = _scaled(ends, scale)[1]
            canvas.put_label(picture, f"{z:g} m", int(x_px) + 8, int(y_px) - 14)
    slope, row = horizon(camera, extrinsics)
    u = np.array([0.0, camera.width - 1.0])
    line = np.stack([u, row + slope * (u - camera.cx_px)], axis=1)
    horizon_color = palette.HORIZON if labels else color
    canvas.polyline(picture, _scaled(line, scale), horizon_color, 3)
    u_vp, v_vp = vanishing_point_of_travel(camera, extrinsics)
    x_px, y_px = _scaled(np.array([u_vp, v_vp]), scale)
    if 0 <= x_px < picture.shape[1] and 0 <= y_px < picture.shape[0]:
        cv2.drawMarker(picture, (int(x_px), int(y_px)), horizon_color, cv2.MARKER_CROSS, 22, 3, cv2.LINE_AA)


def left_view(
    frame: StereoFrame,
    stages: RoadStages | None,
    camera: StereoCamera,
    live: Extrinsics | None = None,
    width: int = WIDTH_PX,
) -> Picture:
    """The left image with free map, obstacles, road grid and horizon; `live` adds the corrected road."""
    height = picture_height(camera, width)
    legend: list[tuple[str, palette.Rgb]] = [
        ("road", palette.ROAD),
        ("free", palette.FREE),
        ("obstacle", palette.OBSTACLE),
        ("horizon", palette.HORIZON),
    ]
    if frame.left is None:
        why = frame.failure
        body = canvas.notice(
            width,
            height,
            "no picture" if why is None else str(why.reason),
            "" if why is None else why.detail[:80],
        )
        return canvas.titled(body, f"Left image · frame {frame.index}")
    if frame.left.shape != (camera.height, camera.width):
        height = int(round(frame.left.shape[0] * width / frame.left.shape[1]))
    grey = cv2.resize(frame.left, (width, height), interpolation=cv2.INTER_AREA)
    if stages is None:
        body = cv2.cvtColor(grey, cv2.COLOR_GRAY2RGB)
    else:
        classes = _resize(classes_of(stages), width, height)
        body = canvas.tinted(grey, classes, CLASS_COLORS, (0.0, 0.22, 0.36, 0.20))
    if stages is not None and stages.estimate is not None:
        draw_road(body, camera, stages.estimate.extrinsics, palette.GRID, labels=True)
    if live is not None:
        draw_road(body, camera, live, palette.LIVE, labels=False)
        legend.append(("live", palette.LIVE))
    failure = frame.failure if stages is None else stages.failure
    if failure is not None:
        canvas.put_label(body, f"failed: {failure.reason} ({failure.detail})"[:90], 8, 8, palette.FAILED, 22)
    return canvas.titled(body, f"Left image · frame {frame.index}", legend)


def disparity_view(stages: RoadStages, width: int, height: int) -> Picture:
    """Dense disparity; near is bright, nothing measured is dark."""
    top = 0.6 * stages.bin_px * len(stages.u_disparity)
    body = canvas.colorize(stages.disparity.values, 0.0, top, "cividis")
    body = _resize(body, width, height)
    return canvas.titled(body, "Disparity", note=f"0 to {top:.0f} px, near is bright")


def free_map_view(frame: StereoFrame, stages: RoadStages, width: int, height: int) -> Picture:
    """What is road, what else is free, what stands upright, and what has no disparity."""
    shape = stages.free.shape[::-1]
    grey: Picture = np.zeros(stages.free.shape, np.uint8)
    if frame.left is not None:
        grey = cv2.resize(frame.left, shape, interpolation=cv2.INTER_AREA)
    body = canvas.tinted(grey, classes_of(stages), CLASS_COLORS, (0.0, 0.75, 0.85, 0.8), gain=0.33)
    valid = int(np.isfinite(stages.disparity.values).sum())
    share = 100.0 * float(stages.free.sum()) / max(valid, 1)
    legend = [("road", palette.ROAD), ("free", palette.FREE), ("obstacle", palette.OBSTACLE)]
    return canvas.titled(_resize(body, width, height), "Free map", legend, f"{share:.0f} % of valid")


def _counts_picture(layers: Sequence[tuple[NDArray, palette.Rgb]]) -> Picture:
    """Histograms in colours, brightness by log count; the last layer with a count wins its cell."""
    out = np.full((*layers[0][0].shape, 3), palette.PAPER, dtype=np.float32)
    for counts, color in layers:
        hit = counts > 0
        gain = 0.35 + 0.65 * np.clip(np.log1p(counts[hit]) / np.log1p(24.0), 0, 1)
        out[hit] = gain[:, None] * np.array(color, dtype=np.float32)
    return out.astype(np.uint8)


def u_disparity_view(stages: RoadStages, width: int, height: int) -> Picture:
    """Columns against disparity: what stands upright piles up (orange), the road spreads (blue)."""
    bins = len(stages.u_disparity)
    obstacle_values = np.where(stages.obstacles, stages.disparity.values, np.nan)
    ones = np.isfinite(obstacle_values.T)
    piles = v_disparity(np.ascontiguousarray(obstacle_values.T), ones, stages.bin_px, bins).T
    rest = np.maximum(stages.u_disparity - piles, 0)
    picture = _counts_picture([(rest, palette.FREE), (piles, palette.OBSTACLE)])
    body = cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
    legend = [("free", palette.FREE), ("upright", palette.OBSTACLE)]
    if width >= WIDTH_PX:
        columns = stages.disparity.columns_u()
        draw_axes(
            body, ("column u [px]", float(columns[-1]), 200), ("disparity [px]", bins * stages.bin_px, 20)
        )
    else:
        canvas.put_label(body, "far", 4, 2, palette.INK_SOFT, 18)
        canvas.put_label(body, "near", 4, height - 30, palette.INK_SOFT, 18)
    return canvas.titled(body, "u-disparity", legend)


Axis = tuple[str, float, int]
"""Its name with its unit, the value at its end, and the distance between ticks."""


def draw_axes(picture: Picture, along: Axis, down: Axis) -> None:
    """Ticks and names along the lower and the left edge, both from 0 at the upper left. In place."""
    height, width = picture.shape[:2]
    name, end, step = along
    name_px = canvas.text_width(name, 18) + 14
    for value in range(step, int(end), step):
        x = int(value * width / end)
        if x > width - name_px - 30:
            break
        canvas.polyline(picture, np.array([[x, height - 9.0], [x, height - 1.0]]), palette.INK_SOFT, 2)
        canvas.put_label(picture, f"{value}", x - 18, height - 38, palette.INK_SOFT, 18)
    canvas.put_label(picture, name, width, height - 38, palette.INK_SOFT, 18)
    name, end, step = down
    for value in range(step, int(end), step):
        y = int(value * height / end)
        if y > height - 50:
            break
        if y > 44:
            canvas.polyline(picture, np.array([[0.0, y], [8.0, y]]), palette.INK_SOFT, 2)
            canvas.put_label(picture, f"{value}", 10, y - 14, palette.INK_SOFT, 18)
    canvas.put_label(picture, name, 4, 4, palette.INK_SOFT, 18)


def v_disparity_view(
    stages: RoadStages, camera: StereoCamera, width: int, height: int, live: Extrinsics | None = None
) -> Picture:
    """Rows against disparity: the road is a line; cells that agree with it are green, other free blue."""
    bins = stages.v_disparity.shape[1]
    road = v_disparity(stages.disparity.values, stages.road, stages.bin_px, bins)
    others = np.maximum(stages.v_disparity_whole - stages.v_disparity, 0)
    rest = np.maximum(stages.v_disparity - road, 0)
    picture = _counts_picture([(others, palette.OBSTACLE), (rest, palette.FREE), (road, palette.ROAD)])
    body = cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
    x_scale = width / (bins * stages.bin_px)
    y_scale = height / (stages.v_disparity.shape[0] * stages.disparity.step_px)
    disparity = np.linspace(0.0, bins * stages.bin_px, 64)

    def line(slope: float, intercept: float) -> NDArray[np.float64]:
        rows = slope * disparity + intercept
        return np.stack([disparity * x_scale, (rows + 0.5) * y_scale], axis=1)

    if stages.estimate is not None:
        e, sigma = stages.estimate.extrinsics, BAND_FACTOR * stages.estimate.sigma
        edges = [
            line(
                *road_profile(
                    camera, Extrinsics(e.height_m + a * sigma[0], e.pitch_rad + b * sigma[1], e.roll_rad)
                )
            )
            for a in (-1, 1)
            for b in (-1, 1)
        ]
        rows = np.stack([edge[:, 1] for edge in edges])
        outline = np.concatenate(
            [
                np.stack([edges[0][:, 0], rows.min(axis=0)], axis=1),
                np.stack([edges[0][::-1, 0], rows.max(axis=0)[::-1]], axis=1),
            ]
        )
        shade = body.copy()
        cv2.fillPoly(shade, [np.round(outline * 16).astype(np.int32)], palette.HORIZON, cv2.LINE_AA, shift=4)
        body = cv2.addWeighted(shade, 0.35, body, 0.65, 0)
        canvas.polyline(body, line(*road_profile(camera, e)), palette.HORIZON, 2)
    elif stages.profile is not None:
        canvas.polyline(body, line(*stages.profile), palette.HORIZON, 2)
    if live is not None:
        canvas.polyline(body, line(*road_profile(camera, live)), palette.LIVE, 2)
    large = width >= WIDTH_PX
    legend = [("road", palette.ROAD), ("profile ±10σ", palette.HORIZON)]
    if large:
        legend = [("road", palette.ROAD), ("free", palette.FREE), ("upright", palette.OBSTACLE), legend[1]]
        rows_px = stages.v_disparity.shape[0] * stages.disparity.step_px
        draw_axes(body, ("disparity [px]", bins * stages.bin_px, 20), ("row v [px]", rows_px, 100))
    else:
        canvas.put_label(body, "far", 4, height - 30, palette.INK_SOFT, 18)
        canvas.put_label(body, "near", width - 60, height - 30, palette.INK_SOFT, 18)
    return canvas.titled(body, "v-disparity", legend)


def stages_view(
    frame: StereoFrame,
    stages: RoadStages | None,
    camera: StereoCamera,
    layout: str = "all stages",
    live: Extrinsics | None = None,
    width: int = WIDTH_PX,
) -> Picture:
    """All stages in one picture, or one of STAGE_NAMES large."""
    height = picture_height(camera, width)
    if stages is None:
        why = frame.failure
        return canvas.notice(
            width, height, "no stages for this frame", "" if why is None else str(why.reason)
        )
    if layout == "disparity":
        return disparity_view(stages, width, height)
    if layout == "free map":
        return free_map_view(frame, stages, width, height)
    if layout == "u-disparity":
        return u_disparity_view(stages, width, int(width * 0.5))
    if layout == "v-disparity":
        return v_disparity_view(stages, camera, width, int(width * 0.62), live)
    left = (width - 12) // 2
    right = width - 12 - left
    gap = np.full((height + canvas.BAR_PX, 12, 3), palette.PAPER, dtype=np.uint8)
    histograms = np.hstack(
        [u_disparity_view(stages, left, height), gap, v_disparity_view(stages, camera, right, height, live)]
    )
    return np.vstack(
        [
            disparity_view(stages, width, height),
            histograms,
            free_map_view(frame, stages, width, height),
        ]
    )


def composed_view(
    frame: StereoFrame,
    stages: RoadStages | None,
    camera: StereoCamera,
    layout: str = "all stages",
    live: Extrinsics | None = None,
) -> Picture:
    """Left image and stages as one picture: browsers follow one picture a tick twice as fast as two."""
    left = left_view(frame, stages, camera, live)
    gap = np.full((GAP_PX, left.shape[1], 3), palette.PAPER, dtype=np.uint8)
    return np.vstack([left, gap, stages_view(frame, stages, camera, layout, live)])
