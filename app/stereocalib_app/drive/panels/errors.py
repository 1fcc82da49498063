"""Errors of every path against the distance travelled."""

from __future__ import annotations

import numpy as np

from stereocalib_app.drive.moment import Moment
from stereocalib_app.drive.panel import Host
from stereocalib_app.drive.summary import alike_words
from stereocalib_app.widgets import chart as plots
from stereocalib_app.widgets import palette, text
from stereocalib_app.widgets.chart import Chart, ChartView, Curve

NAMES = tuple(name for name in palette.VARIANT if name != "ground_truth")
DRAWN = (*(name for name in NAMES[::-1] if name != "live"), "live")
"""The last ones lie on top: the calibrated path over the others, and over it what is tried on it."""
PLOT_PX = 110
NOW_PX = 2 * PLOT_PX - 20


def error_charts(moment: Moment | None) -> list[Chart]:
    """Position and heading error over distance for every shown path."""
    errors = {} if moment is None else dict(moment.paths.errors)
    hidden = {} if moment is None else moment.settings.paths
    known = {n: e for n, e in errors.items() if e.distance_m is not None and hidden.get(n, True)}
    if not known:
        x = np.array([0.0, 1.0])
        empty = tuple(Curve(palette.VARIANT_NAME[n], np.full(2, np.nan), palette.VARIANT[n]) for n in DRAWN)
        labels = ("error m", "heading °")
        return [Chart(x, empty, (), (0.0, 1.0), label, "distance m", "metres") for label in labels]
    x = np.asarray(next(iter(known.values())).distance_m, dtype=np.float64)
    charts = []
    for label, pick in (("error m", "miss_m"), ("heading °", "heading_deg")):
        curves = []
        for name in DRAWN:
            values = getattr(known[name], pick) if name in known else None
            held = np.full(len(x), np.nan)
            if values is not None:
                held[: min(len(x), len(values))] = values[: len(x)]
            curves.append(Curve(palette.VARIANT_NAME[name], held, palette.VARIANT[name], width=2.0))
        every = np.concatenate([c.values for c in curves])
        top = max(0.5, 1.08 * float(np.nanmax(np.abs(every))))
        low = 0.0 if pick == "miss_m" else -top
        charts.append(Chart(x, tuple(curves), (), (low, top), label, "distance m", "metres"))
    return charts


class ErrorsPanel:
    """A tab of the time line's panel."""

    def __init__(self, host: Host) -> None:
        gui = host.gui
        self._note = gui.add_markdown("")
        self._now = gui.add_html("<div></div>")
        self._plots = [ChartView(gui, chart, PLOT_PX) for chart in error_charts(None)]
        self._shown: tuple[object, ...] = ()

    def update(self, moment: Moment) -> None:
        """Redraw where paths or the frame changed."""
        if not moment.paths.errors:
            self._note.content = "The paths appear as soon as some frames are computed."
            return
        if all(e.distance_m is None for e in moment.paths.errors.values()):
            self._note.content = "This drive has no true path to compare with: only the lengths are known."
            return
        marks = " &nbsp; ".join(
            f'<span style="color:{palette.css(palette.VARIANT[n])}">━</span> {palette.VARIANT_NAME[n]}'
            for n in moment.paths.errors
            if moment.settings.paths.get(n, True)
        )
        self._note.content = (
            "Distance from the truth, and error of heading, over metres travelled; laid together at the first "
            f'frame.\n\n<span style="font-size:0.85em">{marks}</span>'
        )
        if (alike := alike_words(moment.paths, moment.settings.corrections.model)) != "":
            self._note.content += f'\n\n<span style="font-size:0.85em">{text.escape(alike, 400)}</span>'
        shown = (moment.paths, moment.settings.paths)
        if len(self._shown) != len(shown) or any(a is not b for a, b in zip(shown, self._shown, strict=True)):
            for plot, chart in zip(self._plots, error_charts(moment), strict=True):
                plot.show(chart)
            self._shown = shown
        first = self._plots[0].chart
        self._now.content = plots.now_line(first, where(moment, first), NOW_PX)


def where(moment: Moment, chart: Chart) -> float | None:
    """The distance travelled at the frame on show, None past the end of the charts."""
    return float(chart.x[moment.frame]) if moment.frame < len(chart.x) > 2 else None
