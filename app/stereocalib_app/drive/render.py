"""Arrays to pictures of the camera's shape: the left image with the road on it, disparity, free map. Pure functions."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from stereocalib_app.widgets import canvas, palette
from stereocalib_app.widgets.canvas import Picture
from stereocalib_core.frames import StereoFrame
from stereocalib_core.front.road.result import RoadResult
from stereocalib_core.geometry import (
    Extrinsics,
    StereoCamera,
    horizon,
    road_to_image,
    vanishing_point_of_travel,
)

CLASS_COLORS = (palette.PAPER, palette.FREE, palette.ROAD, palette.OBSTACLE)
_GRID_Z = (5.0, 7.5, 10.0, 15.0, 20.0, 30.0, 50.0)
LEAST_LABEL_PX = 14
"""Smaller letters cannot be read; the picture is too small for them."""
_GRID_X = (-3.5, -1.75, 0.0, 1.75, 3.5)


def _scaled(points: NDArray[np.float64], scale: float) -> NDArray[np.float64]:
    """Image points [px] to points of a picture scaled about pixel centres."""
    return (points + 0.5) * scale - 0.5


def _resize(mask: NDArray, width: int, height: int) -> NDArray:
    flags = cv2.INTER_NEAREST
    source = mask.astype(np.uint8) if mask.dtype == np.bool_ else mask
    out = cv2.resize(source, (width, height), interpolation=flags)
    return out.astype(np.bool_) if mask.dtype == np.bool_ else out


def classes_of(stages: RoadResult) -> NDArray[np.uint8]:
    """(h, w) 0 nothing, 1 free, 2 road, 3 obstacle."""
    classes = stages.free.astype(np.uint8)
    classes[stages.road] = 2
    classes[stages.obstacles] = 3
    return classes


def draw_road(
    picture: Picture, camera: StereoCamera, extrinsics: Extrinsics, color: palette.Rgb, labels: bool
) -> None:
    """The road grid, the horizon and the direction of travel on a picture of the camera's shape. In place."""
    scale = picture.shape[1] / camera.width
    size_px = min(20, picture.shape[1] // 32)
    z_line = np.geomspace(_GRID_Z[0], _GRID_Z[-1], 24)
    for x in _GRID_X:
        points = np.stack([np.full_like(z_line, x), np.zeros_like(z_line), z_line], axis=1)
        line = road_to_image(camera, extrinsics, points)[:, :2]
        canvas.polyline(picture, _scaled(line, scale), color, 2 if x == 0 else 1)
    for z in _GRID_Z:
        ends = road_to_image(camera, extrinsics, np.array([[_GRID_X[0], 0, z], [_GRID_X[-1], 0, z]]))[:, :2]
        canvas.polyline(picture, _scaled(ends, scale), color, 1)
        if labels and size_px >= LEAST_LABEL_PX and z in (5.0, 10.0, 20.0):
            x_px, y_px = _scaled(ends, scale)[1]
            canvas.put_label(picture, f"{z:g} m", int(x_px) + 8, int(y_px) - 14, size_px=size_px)
    slope, row = horizon(camera, extrinsics)
    u = np.array([0.0, camera.width - 1.0])
    line = np.stack([u, row + slope * (u - camera.cx_px)], axis=1)
    horizon_color = palette.HORIZON if labels else color
    canvas.polyline(picture, _scaled(line, scale), horizon_color, 3 if picture.shape[1] > 800 else 2)
    u_vp, v_vp = vanishing_point_of_travel(camera, extrinsics)
    x_px, y_px = _scaled(np.array([u_vp, v_vp]), scale)
    if 0 <= x_px < picture.shape[1] and 0 <= y_px < picture.shape[0]:
        cv2.drawMarker(picture, (int(x_px), int(y_px)), horizon_color, cv2.MARKER_CROSS, 22, 3, cv2.LINE_AA)


def left_view(
    frame: StereoFrame,
    stages: RoadResult | None,
    camera: StereoCamera,
    live: Extrinsics | None = None,
) -> Picture:
    """The left image with free map, obstacles, road grid and horizon; `live` adds the corrected road."""
    width, height = camera.width, camera.height
    if frame.left is None:
        why = frame.failure
        return canvas.notice(
            width,
            height,
            "no picture" if why is None else str(why.reason),
            "" if why is None else why.detail[:80],
        )
    if frame.left.shape != (height, width):
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
    failure = frame.failure if stages is None else stages.failure
    size_px = min(22, width // 28)
    if failure is not None and size_px >= LEAST_LABEL_PX:
        canvas.put_label(
            body, f"failed: {failure.reason} ({failure.detail})"[:90], 8, 8, palette.FAILED, size_px
        )
    return np.asarray(body)


def disparity_view(stages: RoadResult, width: int, height: int) -> Picture:
    """Dense disparity; near is bright, nothing measured is dark."""
    top = 0.6 * stages.bin_px * len(stages.u_disparity)
    values = stages.disparity.values
    if width < values.shape[1]:
        return canvas.colorize(_resize(values, width, height), 0.0, top, "cividis")
    return _resize(canvas.colorize(values, 0.0, top, "cividis"), width, height)


def free_map_view(frame: StereoFrame, stages: RoadResult, width: int, height: int) -> Picture:
    """What is road, what else is free, what stands upright, and what has no disparity."""
    classes = classes_of(stages)
    if width < classes.shape[1]:
        classes = _resize(classes, width, height)
    grey: Picture = np.zeros(classes.shape, np.uint8)
    if frame.left is not None:
        grey = cv2.resize(frame.left, classes.shape[::-1], interpolation=cv2.INTER_AREA)
    body = canvas.tinted(grey, classes, CLASS_COLORS, (0.0, 0.75, 0.85, 0.8), gain=0.33)
    return _resize(body, width, height)


def difference_view(
    frame: StereoFrame, stages: RoadResult, camera: StereoCamera, road: Extrinsics
) -> Picture:
    """Left minus the right image warped over the road plane: grey where they agree, red where left is brighter,
    blue where it is darker. On the road everything is grey only when height, pitch and roll are right."""
    if frame.left is None or frame.right is None:
        return canvas.notice(camera.width, camera.height, "no pair of pictures")
    rows, columns = frame.left.shape
    u, v = np.arange(columns, dtype=np.float64)[None], np.arange(rows, dtype=np.float64)[:, None]
    disparity = road.disparity_plane(camera).disparity(camera, u, v).astype(np.float32)
    at = u.astype(np.float32) - disparity - np.float32(camera.disparity_offset_px)
    down = np.broadcast_to(v.astype(np.float32), (rows, columns))
    right = cv2.remap(frame.right, at, down, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    seen = (disparity > 1.0) & (at >= 0)
    on_road = seen & _resize(stages.road, columns, rows)
    # The exposures of the two cameras may differ: that is no fault of the plane.
    offset = 0.0
    if on_road.any():
        offset = float(np.median(frame.left[on_road])) - float(np.median(right[on_road]))
    difference = cv2.subtract(frame.left, right, dtype=cv2.CV_16S) - np.int16(round(offset))
    shown = np.clip(difference * DIFFERENCE_GAIN, -127, 127).astype(np.int16) + 128
    index = np.where(seen, shown + np.where(on_road, 512, 256).astype(np.int16), frame.left)
    return np.asarray(np.take(_difference_colors(), index, axis=0))


@cache
def _difference_colors() -> Picture:
    """(768, 3): grey values where nothing is warped, then differences off the road, then on it."""
    step = np.arange(256, dtype=np.float32) - 128
    colors = np.clip(np.stack([128 + step, 128 - np.abs(step) * 0.5, 128 - step], axis=1), 0, 255)
    grey = np.repeat(np.arange(256, dtype=np.float32)[:, None] / 4, 3, axis=1)
    return np.concatenate([grey, 0.55 * colors, colors]).astype(np.uint8)


DIFFERENCE_GAIN = 4
"""Grey levels shown for one that differs."""
HEIGHTS_M = (-0.3, 2.0)
"""Heights over the road from the first colour to the last."""


def lidar_view(
    frame: StereoFrame,
    camera: StereoCamera,
    T_camera_lidar: NDArray[np.float64] | None,
    road: Extrinsics | None,
) -> Picture:
    """The left image, dark, with every LiDAR point in it coloured by its height over the stereo road."""
    if frame.left is None:
        return canvas.notice(camera.width, camera.height, "no picture")
    body = np.repeat((frame.left // 2)[..., None], 3, axis=2)
    if frame.lidar is None or T_camera_lidar is None or road is None:
        canvas.put_label(body, "no LiDAR points" if frame.lidar is None else "no road measured", 8, 8)
        return body
    points = frame.lidar[:, :3] @ T_camera_lidar[:3, :3].T + T_camera_lidar[:3, 3]
    points = points[points[:, 2] > 1.0]
    places = camera.project(points)
    inside = (
        (places[:, 0] >= 0)
        & (places[:, 0] < camera.width)
        & (places[:, 1] >= 0)
        & (places[:, 1] < camera.height)
    )
    points, places = points[inside], places[inside]
    height = -road.plane().signed_distance(points)  # the plane looks down, as Y does
    colors = canvas.colorize(height[None], *HEIGHTS_M, "viridis")[0]
    order = np.argsort(-points[:, 2])
    for (x, y), color in zip(places[order, :2], colors[order], strict=True):
        cv2.circle(body, (int(x), int(y)), 1, tuple(int(c) for c in color), -1)
    return body
