"""Pictures and rows of a set of chessboard poses: arrays in, RGB pictures or HTML out. Pure functions."""

from __future__ import annotations

import base64
import html
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from app import canvas, palette, text
from app.canvas import Picture
from app.lidar_session import LidarSnapshot, PairFiles
from stereocalib_core.lidar_camera import BoardCamera, BoardSpec, PairObservation, PairResult
from stereocalib_core.lidar_camera.pictures import draw_board, overlay

Array = NDArray[np.float64]
WIDTH_PX = 900
CLOSE_UP_PX = 2400
"""Width at which the cloud is drawn before a close-up is cut out."""
MOST_HEIGHT_PX = 620
THUMB_PX = (96, 60)
GOOD, REFUSED, OUT = palette.ROAD, palette.FAILED, palette.INK_SOFT


def color_of(pair: PairResult | None) -> palette.Rgb:
    """Used, refused, or left out by hand."""
    if pair is None:
        return OUT
    if pair.ok:
        return GOOD
    return OUT if pair.reason == "left out" else REFUSED


def _window(
    camera: BoardCamera, board: BoardSpec, T_camera_board: Array, width: int, height: int
) -> tuple[int, int, int, int]:
    """x0, y0, x1, y1 of the board with some air, in a picture of this size."""
    corners = board.outline_board @ T_camera_board[:3, :3].T + T_camera_board[:3, 3]
    pixels = camera.project(corners) * (width / camera.width)
    if not np.isfinite(pixels).all():
        return 0, 0, width, height
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    middle, half = (low + high) / 2, 0.85 * float((high - low).max())
    half_x, half_y = max(half, 40.0), max(half, 40.0) * height / width
    x0, y0 = np.maximum(middle - (half_x, half_y), 0)
    x1, y1 = np.minimum(middle + (half_x, half_y), (width, height))
    return int(x0), int(y0), max(int(x1), int(x0) + 8), max(int(y1), int(y0) + 8)


def cloud_over_picture(
    files: PairFiles,
    observation: PairObservation,
    pair: PairResult | None,
    T_camera_lidar: Array,
    camera: BoardCamera,
    board: BoardSpec,
    title: str,
    note: str,
    close_up: bool = False,
) -> Picture:
    """The cloud on the picture by one transform, under a title; why not, when a half is missing."""
    if files.picture is None:
        return canvas.titled(canvas.notice(WIDTH_PX, 380, "no picture", files.problem[:80]), title)
    cloud = np.zeros((0, 3)) if files.cloud is None else files.cloud
    posed = observation.T_camera_board
    zoomed = close_up and posed is not None
    width = max(CLOSE_UP_PX, files.picture.shape[1]) if zoomed else WIDTH_PX
    body: Picture = overlay(files.picture, cloud, T_camera_lidar, camera, width)
    if posed is not None:
        body = draw_board(body, camera, posed, board, pair is not None and pair.ok)
        if zoomed:
            x0, y0, x1, y1 = _window(camera, board, posed, body.shape[1], body.shape[0])
            body = body[y0:y1, x0:x1]
    body = np.ascontiguousarray(body[:, :, ::-1])
    height = min(MOST_HEIGHT_PX, round(body.shape[0] * WIDTH_PX / body.shape[1]))
    if body.shape[1] != WIDTH_PX:
        body = cv2.resize(body, (WIDTH_PX, height), interpolation=cv2.INTER_AREA)
    if files.cloud is None:
        canvas.put_label(body, files.problem[:70] or "no cloud", 8, 8, palette.FAILED, 22)
    return canvas.titled(body, title, note=note)


def thumbnail_rule(index: int, path: Path | None) -> str:
    """A CSS rule that gives the class of pair `index` its small picture; dark where there is none.

    Rules, because the rows are redrawn with every number and the pictures need not be.
    """
    width, height = THUMB_PX
    small: Picture = np.full((height, width, 3), 40, np.uint8)
    picture = None if path is None else cv2.imread(str(path), cv2.IMREAD_REDUCED_GRAYSCALE_4)
    if picture is not None:
        scaled = cv2.resize(picture, (2 * width, 2 * height), interpolation=cv2.INTER_AREA)
        small = np.repeat(scaled[:, :, None], 3, axis=2).astype(np.uint8)
    data = base64.b64encode(canvas.encode_jpeg(small, 70)).decode()
    return f".pair-{index}{{background:#282828 url(data:image/jpeg;base64,{data}) center/cover}}"


def worst_rms_m(snapshot: LidarSnapshot) -> float:
    """The length of a full bar: that of the worst pair that takes part, with some air."""
    if snapshot.result is None:
        return 1.0
    used = [p.plane_rms_m for p in snapshot.result.pairs if p.ok and np.isfinite(p.plane_rms_m)]
    return 1.5 * max(used, default=0.02)


def bar(value: float, full: float, color: palette.Rgb) -> str:
    """A thin HTML bar; nothing for an unknown value."""
    share = 0.0 if not np.isfinite(value) else min(100.0, 100.0 * value / max(full, 1e-12))
    return (
        '<div style="height:4px;background:rgba(128,128,128,0.25);border-radius:2px;margin:2px 0">'
        f'<div style="height:4px;width:{share:.1f}%;background:{palette.css(color)};border-radius:2px"></div></div>'
    )


def pair_row(snapshot: LidarSnapshot, index: int, name: str) -> str:
    """Thumbnail, name, residuals and, for a refused pair, the reason."""
    result = snapshot.result
    pair = None if result is None else result.pairs[index]
    color = color_of(pair)
    shown = index == snapshot.wish.pair
    edge = palette.css(palette.NOW) if shown else "transparent"
    rms = float("nan") if pair is None else pair.plane_rms_m
    angle = float("nan") if pair is None else pair.normal_error_deg
    if snapshot.trial is not None:
        rms, angle = (
            float(snapshot.trial.plane_rms_m[index]),
            float(snapshot.trial.normal_error_deg[index]),
        )
    numbers = "–"
    if pair is not None:
        pixels = text.number(pair.reprojection_rms_px, 2, " px")
        numbers = f"{text.number(1000 * rms, 1, ' mm')} · {pixels} · {text.number(angle, 2, '°')}"
    reason = ""
    if pair is not None and not pair.ok:
        reason = (
            f'<div style="color:{palette.css(color)};font-size:0.72em;line-height:1.25">'
            f"{html.escape(pair.reason)}</div>"
        )
    return (
        f'<div style="display:flex;gap:8px;margin:4px 8px 0;padding-left:5px;border-left:3px solid {edge}">'
        f'<div class="pair-{index}" style="width:{THUMB_PX[0]}px;height:{THUMB_PX[1]}px;border-radius:3px;flex:none">'
        "</div>"
        f'<div style="flex:1;min-width:0;font-size:0.86em"><b>{html.escape(name)}</b>'
        f'<div style="font-size:0.86em;white-space:nowrap">{numbers}</div>'
        f"{bar(rms, worst_rms_m(snapshot), color)}{reason}</div></div>"
    )
