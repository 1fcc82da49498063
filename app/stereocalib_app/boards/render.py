"""Pictures and rows of a set of chessboard poses: arrays in, RGB pictures or HTML out. Pure functions."""

from __future__ import annotations

import base64
import html
from pathlib import Path

import cv2
import numpy as np

from stereocalib_app.boards.session import LidarSnapshot, PairFiles
from stereocalib_app.widgets import canvas, palette, text
from stereocalib_app.widgets.canvas import Picture
from stereocalib_core.boards import BoardCamera, BoardSpec, PairObservation, PairResult
from stereocalib_core.boards.pictures import draw_board, overlay
from stereocalib_core.numeric.arrays import Array

WIDTH_PX = 840
DOT_PX, CLOSE_UP_DOT_PX = 4, 7
MOST_CLOSE_UP_PX = 6000
"""Widest picture that is drawn to cut a close-up out of it."""
THUMB_PX = (96, 60)
GOOD, REFUSED, OUT = palette.ROAD, palette.FAILED, palette.INK_SOFT


def color_of(pair: PairResult | None) -> palette.Rgb:
    """Used, refused, or left out by hand."""
    if pair is None:
        return OUT
    if pair.ok:
        return GOOD
    return OUT if pair.reason == "left out" else REFUSED


def _window(camera: BoardCamera, board: BoardSpec, T_camera_board: Array) -> tuple[float, Array]:
    """Width of a close-up of the board as a share of the picture's, and its centre as shares of both sides."""
    corners = board.outline_board @ T_camera_board[:3, :3].T + T_camera_board[:3, 3]
    size = np.array([camera.width, camera.height], dtype=np.float64)
    shares = camera.project(corners) / size
    if not np.isfinite(shares).all():
        return 1.0, np.array([0.5, 0.5])
    low, high = shares.min(axis=0), shares.max(axis=0)
    part = float(np.clip(1.5 * (high - low).max(), WIDTH_PX / MOST_CLOSE_UP_PX, 1.0))
    return part, np.clip((low + high) / 2, part / 2, 1 - part / 2)


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
    part, middle = 1.0, np.array([0.5, 0.5])
    if close_up and posed is not None:
        part, middle = _window(camera, board, posed)
    dot_px = DOT_PX if part == 1.0 else CLOSE_UP_DOT_PX
    drawn = overlay(files.picture, cloud, T_camera_lidar, camera, round(WIDTH_PX / part), dot_px)
    if posed is not None:
        drawn = draw_board(drawn, camera, posed, board, pair is not None and pair.ok)
    height = round(drawn.shape[0] * part)
    x = int(np.clip(middle[0] * drawn.shape[1] - WIDTH_PX / 2, 0, drawn.shape[1] - WIDTH_PX))
    y = int(np.clip(middle[1] * drawn.shape[0] - height / 2, 0, drawn.shape[0] - height))
    body = np.ascontiguousarray(drawn[y : y + height, x : x + WIDTH_PX, ::-1])
    if files.cloud is None:
        canvas.put_label(body, files.problem[:70] or "no cloud", 8, 8, palette.FAILED, 22)
    return canvas.titled(body, title, note=note)


def one_over_the_other(before: bytes, after: bytes, how: str) -> str:
    """HTML of two JPEGs of one size in one place.

    "blink" changes them each second, "wipe" draws a curtain over them to and fro.
    """
    motion = (
        "@keyframes over{0%,49.9%{opacity:1}50%,100%{opacity:0}}"
        if how == "blink"
        else "@keyframes over{from{clip-path:inset(0 0 0 0)}to{clip-path:inset(0 0 0 100%)}}"
    )
    pace = "over 2s infinite" if how == "blink" else "over 4s ease-in-out infinite alternate"
    first, second = (base64.b64encode(picture).decode() for picture in (before, after))
    # Over it the hand holds the motion: a place can be looked at.
    return (
        f"<style>{motion}.over{{animation:{pace}}}.compared:hover .over{{animation-play-state:paused}}</style>"
        f'<div class="compared" data-how="{how}" style="position:relative;margin:0.5em 1em">'
        f'<img alt="before" style="width:100%;display:block" src="data:image/jpeg;base64,{first}">'
        '<img alt="after" class="over" style="width:100%;position:absolute;left:0;top:0" '
        f'src="data:image/jpeg;base64,{second}"></div>'
    )


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
