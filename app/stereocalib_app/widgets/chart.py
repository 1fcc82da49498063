"""Time series for uPlot: fixed ranges, raw values as dots, bands for sigma and failures, `now` as a line above.

uPlot bridges NaN by a line, so what may be missing is drawn as dots, and lines are only drawn through what is
known at every frame.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereocalib_app.widgets import palette

MAX_COLUMNS = 1500
LABEL_PX = 16
MAX_EDGES = 200
"""With more of them nobody could see a slope."""
MARGIN_PX, AXIS_PX, PADDING_PX, TOP_PX = 9.25, 60, 8, 6
"""Of a plot in its panel: margin, y axis with its label, right padding, top padding."""
NOW_CSS = "var(--mantine-color-text)"
"""White on dark, black on light: no curve and no band is."""
AXIS_INK = "#8b929b"
GRID_INK = "rgba(139,146,155,0.22)"


@dataclass(frozen=True)
class Curve:
    """One series: `values` over x; `dots` draws points instead of a line, `marks` beside it; `hidden` only bounds a
    band; `step` does not slope between samples at the chart's edges."""

    name: str
    values: NDArray[np.float64]
    color: palette.Rgb
    dots: bool = False
    marks: bool = False
    hidden: bool = False
    width: float = 1.8
    dash: tuple[float, ...] = ()
    step: bool = False


@dataclass(frozen=True)
class Chart:
    """Curves over a common x with fixed ranges. bands: pairs of curve indices with their fill. edges: where
    curves that are steps jump."""

    x: NDArray[np.float64]
    curves: tuple[Curve, ...]
    bands: tuple[tuple[int, int, str], ...]
    y_range: tuple[float, float]
    y_label: str
    x_label: str = ""
    sync: str = "frames"
    edges: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))


def thinned(x: NDArray[np.float64], curves: tuple[Curve, ...]) -> tuple[NDArray[np.float64], list[NDArray]]:
    """At most MAX_COLUMNS columns."""
    step = int(np.ceil(len(x) / MAX_COLUMNS))
    if step <= 1:
        return x, [curve.values for curve in curves]
    return x[::step], [curve.values[::step] for curve in curves]


def edges(flags: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Where a band over `flags` has to rise and fall, so that it stands upright: half way between samples."""
    steps = np.flatnonzero(np.diff(flags.astype(np.int8))).astype(np.float64) + 0.5
    return steps if len(steps) <= MAX_EDGES else steps[:0]


def with_edges(
    x: NDArray[np.float64], at: NDArray[np.float64], values: NDArray[np.float64], kind: str
) -> NDArray[np.float64]:
    """`values` over `x` with two more samples at each place of `at`: a `step` from the sample before to the one
    after, points of a `line`, or nothing among `dots`."""
    places = np.repeat(np.searchsorted(x, at), 2)
    if kind == "step":
        before = np.searchsorted(x, at)
        new = np.stack([values[before - 1], values[before]], axis=1).ravel()
    elif kind == "line":
        new = np.repeat(np.interp(at, x, values), 2)
    else:
        new = np.full(len(places), np.nan)
    return np.asarray(np.insert(values, places, new), dtype=np.float64)


def chart_data(chart: Chart) -> tuple[NDArray[np.float64], ...]:
    """The arrays of uPlot for a chart."""
    x, columns = thinned(chart.x, chart.curves)
    if not len(chart.edges):
        return (x, *columns)
    kinds = ["dots" if c.dots else "step" if c.step else "line" for c in chart.curves]
    columns = [with_edges(x, chart.edges, v, kind) for v, kind in zip(columns, kinds, strict=True)]
    return (with_edges(x, chart.edges, x, "line"), *columns)


def now_line(chart: Chart, now: float | None, height: int) -> str:
    """HTML of a vertical line at `now` over the plots that follow it, `height` pixels high.

    It moves alone, so that a frame of playback does not send every curve again.
    """
    if now is None:
        return "<div></div>"
    share = (now - chart.x[0]) / max(float(chart.x[-1] - chart.x[0]), 1e-9)
    left = f"calc({MARGIN_PX + AXIS_PX}px + {share:.5f} * (100% - {2 * MARGIN_PX + AXIS_PX + PADDING_PX}px))"
    line = f"position:absolute;left:{left};top:{MARGIN_PX + TOP_PX}px;height:{height}px;width:2px;margin-left:-1px"
    return (
        '<div style="position:relative;height:0;z-index:3;pointer-events:none">'
        f'<div style="{line};background:{NOW_CSS}"></div></div>'
    )


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
            entry["points"] = {"show": True, "size": 5} if curve.marks else {"show": False}
        if curve.dash:
            entry["dash"] = curve.dash
        series.append(entry)
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
                "size": AXIS_PX - LABEL_PX,
                "font": font,
                "gap": 2,
                "label": chart.y_label,
                "labelSize": LABEL_PX,
                "labelFont": font,
                "labelGap": 0,
                "space": 15,
            },
        ),
        "legend": {"show": False},
        "cursor": {"sync": {"key": chart.sync}, "drag": {"x": False, "y": False}, "y": False},
        "height": height,
        "padding": (TOP_PX, PADDING_PX, 2, 0),
    }


class ChartView:
    """A chart in a panel, `height` pixels high; only what has changed is sent again."""

    def __init__(self, gui: Any, chart: Chart, height: int, show_x: bool = True) -> None:
        self._height, self._show_x = height, show_x
        self.chart = chart
        self._plot = gui.add_uplot(chart_data(chart), **chart_options(chart, height, show_x))

    def show(self, chart: Chart) -> None:
        """Draw the curves of `chart` instead; its labels and the number of its curves stay."""
        old, self.chart = self.chart, chart
        if (chart.y_range, chart.x[0], chart.x[-1]) != (old.y_range, old.x[0], old.x[-1]):
            self._plot.scales = chart_options(chart, self._height, self._show_x)["scales"]
        self._plot.data = chart_data(chart)
