"""Time series for uPlot: fixed ranges, raw values as dots, bands for sigma and failures, `now` as a spike.

uPlot bridges NaN by a line, so what may be missing is drawn as dots, and lines are only drawn through what is
known at every frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app import palette

MAX_COLUMNS = 1200
AXIS_INK = "#8b929b"
GRID_INK = "rgba(139,146,155,0.22)"


@dataclass(frozen=True)
class Curve:
    """One series: `values` over x; `dots` draws points instead of a line; `hidden` only bounds a band."""

    name: str
    values: NDArray[np.float64]
    color: palette.Rgb
    dots: bool = False
    hidden: bool = False
    width: float = 1.8
    dash: tuple[float, ...] = ()


@dataclass(frozen=True)
class Chart:
    """Curves over a common x with fixed ranges. bands: pairs of curve indices with their fill."""

    x: NDArray[np.float64]
    curves: tuple[Curve, ...]
    bands: tuple[tuple[int, int, str], ...]
    y_range: tuple[float, float]
    y_label: str
    x_label: str = ""
    sync: str = "frames"


def fixed_range(
    values: NDArray[np.float64], least_span: float, previous: tuple[float, float] | None = None
) -> tuple[float, float]:
    """A range that holds nearly all values with some air; an earlier range is kept while it still fits."""
    good = values[np.isfinite(values)]
    if len(good) == 0:
        return previous or (-least_span / 2, least_span / 2)
    low, high = np.percentile(good, [1.0, 99.0])
    span = max(high - low, least_span)
    middle = (low + high) / 2
    wanted = (middle - 0.72 * span, middle + 0.72 * span)
    if previous is not None:
        fits = previous[0] <= low - 0.05 * span and previous[1] >= high + 0.05 * span
        if fits and previous[1] - previous[0] < 2.2 * span:
            return previous
    return wanted


def unbridged(values: NDArray[np.float64], low: float) -> NDArray[np.float64]:
    """Gaps inside a line go below the plot, where uPlot would bridge them; unknown ends stay NaN."""
    known = np.flatnonzero(np.isfinite(values))
    out = values.copy()
    if len(known):
        inner = out[known[0] : known[-1] + 1]
        inner[~np.isfinite(inner)] = low - 1000.0
    return out


def below(y_range: tuple[float, float]) -> float:
    """A value that is out of sight under the plot."""
    return y_range[0] - 10.0 * (y_range[1] - y_range[0])


def failed_band(failed: NDArray[np.bool_], y_range: tuple[float, float]) -> tuple[NDArray, NDArray]:
    """Upper and lower edge of a band that covers the whole height where `failed`."""
    low, high = y_range
    return np.where(failed, high, low), np.full(len(failed), low)


def thinned(x: NDArray[np.float64], curves: tuple[Curve, ...]) -> tuple[NDArray[np.float64], list[NDArray]]:
    """At most MAX_COLUMNS columns."""
    step = int(np.ceil(len(x) / MAX_COLUMNS))
    if step <= 1:
        return x, [curve.values for curve in curves]
    return x[::step], [curve.values[::step] for curve in curves]


def with_now(
    x: NDArray[np.float64], columns: list[NDArray], dots: list[bool], now: float, y_range: tuple[float, float]
) -> tuple[NDArray[np.float64], ...]:
    """The columns and, as a last one, a narrow spike at `now`, its feet between the samples."""
    high = y_range[1]
    low = below(y_range)
    foot = 0.0012 * max(float(x[-1] - x[0]), 1e-9) if len(x) > 1 else 0.01
    at = np.array([now - foot, now, now + foot])
    places = np.searchsorted(x, at)
    new_x = np.insert(x, places, at)
    out: list[NDArray[np.float64]] = [new_x]
    for values, is_dots in zip(columns, dots, strict=True):
        extra = np.full(3, np.nan) if is_dots else np.interp(at, x, values)
        out.append(np.insert(values, places, extra))
    out.append(np.insert(np.full(len(x), low), places, [low, high, low]))
    return tuple(out)


def chart_data(chart: Chart, now: float | None) -> tuple[NDArray[np.float64], ...]:
    """The arrays of uPlot for a chart; without `now` the spike stays flat."""
    x, columns = thinned(chart.x, chart.curves)
    dots = [curve.dots for curve in chart.curves]
    if now is None:
        return (x, *columns, np.full(len(x), below(chart.y_range)))
    return with_now(x, columns, dots, now, chart.y_range)


def chart_options(chart: Chart, height: int, show_x: bool) -> dict[str, Any]:
    """Keyword arguments of `gui.add_uplot` but for the data."""
    series: list[dict[str, Any]] = [{"label": chart.x_label or "frame"}]
    for curve in chart.curves:
        stroke = "transparent" if curve.hidden else palette.css(curve.color)
        entry: dict[str, Any] = {"label": curve.name, "stroke": stroke, "width": curve.width}
        if curve.dots:
            entry["width"] = 0
            entry["points"] = {"show": True, "size": 4, "stroke": stroke, "fill": stroke, "space": 0}
        else:
            entry["points"] = {"show": False}
        if curve.dash:
            entry["dash"] = curve.dash
        series.append(entry)
    series.append({"label": "now", "stroke": palette.css(palette.NOW), "width": 2, "points": {"show": False}})
    x_low, x_high = float(chart.x[0]), float(chart.x[-1])
    ink = {"stroke": AXIS_INK, "grid": {"stroke": GRID_INK, "width": 1}, "ticks": {"show": False}}
    font = "11px system-ui, sans-serif"
    return {
        "series": tuple(series),
        "bands": tuple({"series": (a + 1, b + 1), "fill": fill} for a, b, fill in chart.bands) or None,
        "scales": {
            "x": {"time": False, "range": (x_low, max(x_high, x_low + 1e-6))},
            "y": {"range": chart.y_range},
        },
        "axes": (
            {
                **ink,
                "size": 22 if show_x else 4,
                "font": font,
                "gap": 2,
                **({} if show_x else {"values": ()}),
            },
            {
                **ink,
                "size": 44,
                "font": font,
                "gap": 2,
                "label": chart.y_label,
                "labelSize": 16,
                "labelFont": font,
                "labelGap": 0,
                "space": 22,
            },
        ),
        "legend": {"show": False},
        "cursor": {"sync": {"key": chart.sync}, "drag": {"x": False, "y": False}, "y": False},
        "height": height,
        "padding": (6, 8, 2, 0),
    }
