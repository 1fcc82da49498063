"""Counts of disparity as pictures: by column (u-disparity) and by row (v-disparity). Pure functions."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from stereocalib_app.widgets import canvas, palette
from stereocalib_app.widgets.canvas import Picture
from stereocalib_core.front.road.result import RoadResult
from stereocalib_core.front.road.uv_disparity import v_disparity
from stereocalib_core.geometry import Extrinsics, StereoCamera, road_profile

BAND_FACTOR = 10.0
"""The profile's band is drawn at this many sigma; one sigma is thinner than a pixel."""


MOST_SEEN = 24
"""From this count on a cell is as bright as can be."""
AXES_FROM_PX = 560
"""A narrower picture has no room for the words of its axes."""


@cache
def _count_colors(colors: tuple[palette.Rgb, ...]) -> Picture:
    """(len(colors) * (MOST_SEEN + 1), 3): the colour of each count in each layer, brighter with its logarithm."""
    gain = 0.35 + 0.65 * np.log1p(np.arange(MOST_SEEN + 1.0)) / np.log1p(MOST_SEEN)
    table = gain[None, :, None] * np.array(colors, dtype=np.float64)[:, None, :]
    table[:, 0] = palette.PAPER
    return table.reshape(-1, 3).astype(np.uint8)


def _counts_picture(layers: Sequence[tuple[NDArray, palette.Rgb]]) -> Picture:
    """Histograms in colours, brightness by log count; the last layer with a count wins its cell."""
    index = np.zeros(layers[0][0].shape, np.uint8)
    for k, (counts, _) in enumerate(layers):
        seen = np.minimum(counts, MOST_SEEN).astype(np.uint8)
        np.copyto(index, seen + np.uint8(k * (MOST_SEEN + 1)), where=seen > 0)
    return np.asarray(np.take(_count_colors(tuple(color for _, color in layers)), index, axis=0))


def u_disparity_view(stages: RoadResult, width: int, height: int) -> Picture:
    """Columns against disparity: what stands upright piles up (orange), the road spreads (blue)."""
    bins = len(stages.u_disparity)
    obstacle_values = np.where(stages.obstacles, stages.disparity.values, np.nan)
    ones = np.isfinite(obstacle_values.T)
    piles = v_disparity(np.ascontiguousarray(obstacle_values.T), ones, stages.bin_px, bins).T
    rest = np.maximum(stages.u_disparity - piles, 0)
    picture = _counts_picture([(rest, palette.FREE), (piles, palette.OBSTACLE)])
    body = cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
    columns = stages.disparity.columns_u()
    draw_axes(body, ("column u [px]", float(columns[-1]), 200), ("disparity [px]", bins * stages.bin_px, 20))
    return np.asarray(body)


Axis = tuple[str, float, int]
"""Its name with its unit, the value at its end, and the distance between ticks."""


def draw_axes(picture: Picture, along: Axis, down: Axis) -> None:
    """Ticks and names along the lower and the left edge, both from 0 at the upper left, where they fit. In place."""
    height, width = picture.shape[:2]
    if width < AXES_FROM_PX:
        return
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
    stages: RoadResult, camera: StereoCamera, width: int, height: int, live: Extrinsics | None = None
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
    rows_px = stages.v_disparity.shape[0] * stages.disparity.step_px
    draw_axes(body, ("disparity [px]", bins * stages.bin_px, 20), ("row v [px]", rows_px, 100))
    return np.asarray(body)
