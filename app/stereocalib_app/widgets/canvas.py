"""Drawing primitives for the pictures: crisp text, legends, colour maps. Pure functions on RGB arrays."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from stereocalib_app.widgets.colour_maps import lookup_table
from stereocalib_app.widgets.palette import INK, INK_SOFT, PAPER, RULE, Rgb

Picture = NDArray[Any]

TEXT_PX = 22
ERRORS = "viridis"
"""The colours of an error along a path: even steps, and in order also for who does not tell red from green."""
BAR_PX = 34
"""Height of the title bar over each view."""


@lru_cache(maxsize=16)
def _font(size_px: int, bold: bool) -> ImageFont.FreeTypeFont:
    # by its place: matplotlib takes a quarter of a second to load, and would first read every font of the machine
    matplotlib = find_spec("matplotlib")
    assert matplotlib is not None and matplotlib.origin is not None
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(Path(matplotlib.origin).parent / "mpl-data" / "fonts" / "ttf" / name, size_px)


@lru_cache(maxsize=2048)
def _mask(text: str, size_px: int, bold: bool) -> NDArray[np.uint8]:
    """(h, w) uint8 coverage of one line of text."""
    font = _font(size_px, bold)
    width = max(1, int(np.ceil(font.getlength(text))))
    ascent, descent = font.getmetrics()
    image = Image.new("L", (width, ascent + descent))
    ImageDraw.Draw(image).text((0, 0), text, fill=255, font=font)
    return np.asarray(image)


def text_width(text: str, size_px: int = TEXT_PX, bold: bool = False) -> int:
    """Width of one line of text [px]."""
    return int(_mask(text, size_px, bold).shape[1])


def put_text(
    picture: Picture, text: str, x: int, y: int, color: Rgb = INK, size_px: int = TEXT_PX, bold: bool = False
) -> int:
    """Draw one line with its top left at (x, y), clipped; returns the x behind it. In place."""
    mask = _mask(text, size_px, bold)
    x0, y0 = max(x, 0), max(y, 0)
    x1, y1 = min(x + mask.shape[1], picture.shape[1]), min(y + mask.shape[0], picture.shape[0])
    if x1 > x0 and y1 > y0:
        cover = mask[y0 - y : y1 - y, x0 - x : x1 - x, None].astype(np.uint16)
        patch = picture[y0:y1, x0:x1]
        ink = np.array(color, dtype=np.uint16)
        picture[y0:y1, x0:x1] = ((patch * (255 - cover) + ink * cover) // 255).astype(np.uint8)
    return x + int(mask.shape[1])


def put_label(picture: Picture, text: str, x: int, y: int, color: Rgb = INK, size_px: int = 20) -> None:
    """A line of text on a dark tag, kept inside the picture. In place."""
    mask = _mask(text, size_px, False)
    h, w = mask.shape[0] + 6, mask.shape[1] + 14
    x = int(np.clip(x, 0, max(0, picture.shape[1] - w)))
    y = int(np.clip(y, 0, max(0, picture.shape[0] - h)))
    tag = picture[y : y + h, x : x + w]
    tag[:] = (tag // 4 + np.array(PAPER, dtype=np.uint8) // 2).astype(np.uint8)
    put_text(picture, text, x + 7, y + 3, color, size_px)


def title_bar(width: int, title: str, legend: Sequence[tuple[str, Rgb]] = (), note: str = "") -> Picture:
    """(BAR_PX, width, 3): the view's title, a note, and its legend at the right as far as it fits."""
    bar = np.full((BAR_PX, width, 3), PAPER, dtype=np.uint8)
    top = (BAR_PX - _mask("Ag", TEXT_PX, False).shape[0]) // 2
    x = put_text(bar, title, 8, top, INK, bold=True) + 14
    entries = list(legend)
    total = sum(text_width(name, 20) + 40 for name, _ in entries)
    while entries and x + total > width:
        name, _ = entries.pop()
        total -= text_width(name, 20) + 40
    if note and x + text_width(note, 20) + total < width:
        put_text(bar, note, x, top + 1, INK_SOFT, 20)
    x = width - total
    for name, color in entries:
        cv2.rectangle(bar, (x, BAR_PX // 2 - 7), (x + 14, BAR_PX // 2 + 7), color, -1, cv2.LINE_AA)
        x = put_text(bar, name, x + 20, top + 1, INK_SOFT, 20) + 20
    return bar


def titled(body: Picture, title: str, legend: Sequence[tuple[str, Rgb]] = (), note: str = "") -> Picture:
    """A view under its title bar."""
    return np.vstack([title_bar(body.shape[1], title, legend, note), body])


def colorize(
    values: NDArray[np.floating], low: float, high: float, name: str, invalid: Rgb = PAPER
) -> Picture:
    """(h, w) numbers to RGB; NaN becomes `invalid`."""
    scaled = (values - low) * (255.0 / max(high - low, 1e-9))
    index = np.nan_to_num(np.clip(scaled, 0, 255), nan=0.0).astype(np.uint8)
    picture = lookup_table(name)[index]
    picture[~np.isfinite(values)] = invalid
    return picture


def blend(picture: Picture, mask: NDArray[np.bool_], color: Rgb, alpha: float) -> None:
    """Tint the masked pixels. In place."""
    if mask.any():
        tint = np.array(color, dtype=np.float32) * alpha
        picture[mask] = (picture[mask] * np.float32(1 - alpha) + tint).astype(np.uint8)


@lru_cache(maxsize=16)
def _tint_table(colors: tuple[Rgb, ...], alphas: tuple[float, ...], gain: float) -> Picture:
    """(classes * 256, 3): the colour of each grey value in each class."""
    grey = np.arange(256, dtype=np.float32)[:, None] * gain
    rows = [
        grey * (1 - a) + np.array(color, dtype=np.float32) * a
        for color, a in zip(colors, alphas, strict=True)
    ]
    return np.concatenate(rows).clip(0, 255).astype(np.uint8)


def tinted(
    grey: Picture, classes: Picture, colors: tuple[Rgb, ...], alphas: tuple[float, ...], gain: float = 1.0
) -> Picture:
    """(h, w) grey and class numbers to RGB: each class tints the picture with its colour."""
    index = classes.astype(np.uint16) * np.uint16(256) + grey
    return np.take(_tint_table(colors, alphas, gain), index, axis=0)


def polyline(picture: Picture, points: NDArray[np.floating], color: Rgb, thickness: int = 2) -> None:
    """(N, 2) x, y with NaN gaps, anti-aliased at 1/16 px. In place."""
    good = np.isfinite(points).all(axis=1) & (np.abs(points) < 20000).all(axis=1)
    runs = np.split(np.arange(len(points)), np.flatnonzero(np.diff(good.astype(np.int8))) + 1)
    for run in runs:
        if len(run) > 1 and good[run[0]]:
            fixed = np.round(points[run] * 16).astype(np.int32).reshape(-1, 1, 2)
            cv2.polylines(picture, [fixed], False, color, thickness, cv2.LINE_AA, shift=4)


def dashed(
    picture: Picture, start: Sequence[float], end: Sequence[float], color: Rgb, thickness: int = 2
) -> None:
    """A dashed straight line. In place."""
    a, b = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    count = max(2, int(np.hypot(*(b - a)) / 12))
    steps = a + (b - a) * np.linspace(0, 1, count + 1)[:, None]
    for i in range(0, count, 2):
        polyline(picture, steps[i : i + 2], color, thickness)


def notice(width: int, height: int, line: str, detail: str = "") -> Picture:
    """A calm picture that says why there is nothing to see."""
    picture = np.full((height, width, 3), PAPER, dtype=np.uint8)
    cv2.rectangle(picture, (0, 0), (width - 1, height - 1), RULE, 1)
    put_text(picture, line, max(8, (width - text_width(line, 24)) // 2), height // 2 - 30, INK, 24)
    if detail:
        put_text(
            picture, detail, max(8, (width - text_width(detail, 20)) // 2), height // 2 + 6, INK_SOFT, 20
        )
    return picture


def encode_jpeg(picture: Picture, quality: int = 82) -> bytes:
    """RGB to JPEG bytes."""
    ok, data = cv2.imencode(".jpg", picture[:, :, ::-1], [int(cv2.IMWRITE_JPEG_QUALITY), quality])
    if not ok:
        raise ValueError("picture cannot be encoded")
    return data.tobytes()
