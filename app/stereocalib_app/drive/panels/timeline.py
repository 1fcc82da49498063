"""The time line: transport, the numbers of the frame, and height, pitch and roll over time."""

from __future__ import annotations

import html
from typing import Any

import numpy as np

from stereocalib_app.drive.moment import Moment
from stereocalib_app.drive.panel import Host
from stereocalib_app.drive.panels.playback import SPEED_NAME
from stereocalib_app.drive.session import Snapshot
from stereocalib_app.widgets import chart as plots
from stereocalib_app.widgets import palette, text
from stereocalib_app.widgets.chart import Chart, ChartView, Curve
from stereocalib_app.widgets.style import style_sheet
from stereocalib_app.widgets.tables import numbers_table
from stereocalib_core.geometry import Extrinsics
from stereocalib_core.results import Drive

AXES = ("height", "pitch", "roll")
UNITS = (" m", "°", "°")
DIGITS = (3, 3, 3)
LEAST_SPAN = (0.12, 0.4, 0.4)
TRANSPORT = ("◀ failure", "◀ step", "play", "step ▶", "failure ▶")
TRANSPORT_PLAYING = tuple("pause" if name == "play" else name for name in TRANSPORT)
PLOT_PX = 58
NOW_PX = 3 * PLOT_PX - 4
"""Height of the line at `now`, over all three plots."""


def axis_values(values: np.ndarray) -> np.ndarray:
    """(N, 3) height [m], pitch, roll [rad] in the units of the page (m, degrees)."""
    out = np.array(values, dtype=np.float64)
    out[:, 1:] = np.rad2deg(out[:, 1:])
    return out


def raw_values(snapshot: Snapshot) -> np.ndarray:
    """(total, 3) height [m], pitch, roll [deg] of the frames computed so far, NaN elsewhere."""
    out = np.full((snapshot.total, 3), np.nan)
    for result in snapshot.results:
        if result.road is not None:
            e = result.road.extrinsics
            out[result.frame] = e.height_m, e.pitch_deg, e.roll_deg
    return out


def saved_values(run: Drive | None, total: int) -> np.ndarray:
    """(total, 3) filtered height [m], pitch, roll [deg] of another run, NaN where it has none."""
    out = np.full((total, 3), np.nan)
    if run is not None:
        frames = run.frames.frame
        inside = (frames >= 0) & (frames < total)
        out[frames[inside]] = axis_values(run.frames.filtered[inside])
    return out


def extrinsics_charts(
    snapshot: Snapshot,
    truth: np.ndarray | None,
    previous: list[tuple[float, float]] | None,
    compared: Drive | None = None,
) -> list[Chart]:
    """One chart per axis: this pair as dots, filtered with its sigma band, truth, failed spans."""
    x = np.arange(max(snapshot.total, 2), dtype=np.float64)
    raw = np.full((len(x), 3), np.nan)
    raw[: snapshot.total] = raw_values(snapshot)
    failed = np.zeros(len(x), dtype=bool)
    failed[snapshot.failures()] = True
    filtered = np.full((len(x), 3), np.nan)
    sigma = np.zeros((len(x), 3))
    if snapshot.drive is not None:
        known = snapshot.drive.frames
        filtered[: len(known)] = axis_values(known.filtered)
        sigma[: len(known)] = axis_values(known.filtered_sigma)
    other = saved_values(compared, len(x))
    charts = []
    for axis, name in enumerate(AXES):
        true_values = np.zeros(0) if truth is None else axis_values(truth[:, :3])[:, axis]
        y_range = plots.fixed_range(
            np.concatenate([raw[:, axis], filtered[:, axis], true_values]),
            LEAST_SPAN[axis],
            None if previous is None else previous[axis],
        )
        low = y_range[0]
        held = plots.unbridged(filtered[:, axis], low)
        top, bottom = plots.failed_band(failed, y_range)
        curves = [
            Curve("failed", top, palette.FAILED, hidden=True, step=True),
            Curve("", bottom, palette.FAILED, hidden=True, step=True),
            Curve("+σ", held + sigma[:, axis], palette.FILTERED, hidden=True),
            Curve("−σ", held - sigma[:, axis], palette.FILTERED, hidden=True),
            Curve("this pair", raw[:, axis], palette.RAW, dots=True),
            Curve("filtered", held, palette.FILTERED, width=2.0),
            Curve("compared", plots.unbridged(other[:, axis], low), palette.COMPARED, dash=(6, 3)),
        ]
        if truth is not None:
            shown = np.full(len(x), np.nan)
            shown[: len(truth)] = axis_values(truth[:, :3])[: len(x), axis]
            curves.append(Curve("truth", plots.unbridged(shown, low), palette.TRUTH, dash=(4, 4)))
        bands = ((0, 1, palette.css(palette.FAILED, 0.30)), (2, 3, palette.css(palette.FILTERED, 0.28)))
        label = f"{name} {UNITS[axis].strip()}"
        charts.append(Chart(x, tuple(curves), bands, y_range, label, edges=plots.edges(failed)))
    return charts


def legend_line(with_truth: bool, with_compared: bool = False) -> str:
    """The legend of the charts as HTML."""

    def mark(symbol: str, color: palette.Rgb | str, name: str) -> str:
        css = color if isinstance(color, str) else palette.css(color)
        return f'<span style="margin-left:1em"><span style="color:{css}">{symbol}</span> {name}</span>'

    parts = [
        mark("●", palette.RAW, "this pair"),
        mark("━", palette.FILTERED, "filtered ± σ"),
        mark("█", palette.FAILED, "failed"),
        mark("┃", plots.NOW_CSS, "now"),
    ]
    if with_compared:
        parts.insert(2, mark("┅", palette.COMPARED, "other run"))
    if with_truth:
        parts.insert(2, mark("┅", palette.TRUTH, "truth"))
    return f'<div style="{LEGEND}">{"".join(parts)}</div>{style_sheet()}'


def now_table(moment: Moment) -> str:
    """The frame's numbers as HTML: this pair and filtered, with sigma."""
    result, filtered = moment.result, moment.filtered
    pair: tuple[str, ...] = ("–",) * 3
    smooth = pair
    if result is not None and result.road is not None:
        pair = _with_sigma(result.road.extrinsics, result.road.sigma)
    state = "filtered"
    if filtered is not None:
        smooth = _with_sigma(*filtered[:2])
        state = "predicted" if filtered[2] == "predicted" else state
    rows = list(zip(AXES, pair, smooth, strict=True))
    return numbers_table(f"Frame {moment.frame}", ("", "this pair", state), rows)


def _with_sigma(e: Extrinsics, sigma: np.ndarray) -> tuple[str, ...]:
    """Height, pitch and roll, each with its sigma."""
    values = zip((e.height_m, e.pitch_deg, e.roll_deg), axis_values(sigma[None])[0], strict=True)
    return tuple(
        text.with_sigma(value, s, DIGITS[axis], UNITS[axis]) for axis, (value, s) in enumerate(values)
    )


def headline(moment: Moment) -> str:
    """One line of HTML: where we are and how the frame fared."""
    total = moment.snapshot.total
    result = moment.result
    time_s = float(moment.session.source.timestamps_s[moment.frame]) if total else 0.0
    if result is None:
        state = "not computed yet"
    elif result.ok:
        state = "ok"
    else:
        color = palette.css(palette.FAILED)
        state = f'<b style="color:{color}">failed: {html.escape(result.reason)}</b>'
    playing = "▶" if moment.clock.playing else "❚❚"
    where = f"{playing} <b>Frame {moment.frame}</b> of {max(0, total - 1)} · {time_s:.2f} s · {state}"
    speed = "" if moment.clock.speed == 1.0 else f" · {SPEED_NAME.get(moment.clock.speed, '')}"
    return f'<p style="{HEADLINE}">{where}{speed}</p>'


HEADLINE = (
    "margin:0.1em 0.8em 0.3em;font-size:0.875em;line-height:1.5;white-space:nowrap;overflow:hidden;"
    "text-overflow:ellipsis"
)
LEGEND = "display:flex;justify-content:flex-end;margin:-0.1em 1em -0.5em;font-size:0.75em;white-space:nowrap"


class TimelinePanel:
    """Where we are, the way to go elsewhere, and height, pitch and roll over the drive."""

    def __init__(self, host: Host) -> None:
        self._host = host
        gui, clock = host.gui, host.playback
        self._ranges: list[tuple[float, float]] | None = None
        self._compared: Drive | None = None
        self._charts: list[Chart] = []
        truth = host.session.source.ground_truth
        self._truth = None if truth is None else truth.extrinsics
        self._headline = gui.add_html("")
        self._slider = gui.add_slider(
            "Frame", 0, max(1, clock.total - 1), 1, 0, hint="Drag, or type an exact frame number."
        )
        self._transport = gui.add_button_group(
            "",
            TRANSPORT,
            hint="Previous failure, step back, play or pause, step on, next failure.",
        )
        self._legend = gui.add_html(legend_line(self._truth is not None))
        self._plots = self._add_plots(gui)
        host.on_input(self._slider, lambda value: clock.seek(int(value)))
        host.on_click(self._transport, self._on_transport)

    def _add_plots(self, gui: Any) -> list[ChartView]:
        self._charts = extrinsics_charts(self._host.session.snapshot, self._truth, None)
        self._ranges = [chart.y_range for chart in self._charts]
        self._now = gui.add_html(plots.now_line(self._charts[0], 0.0, NOW_PX))
        return [
            ChartView(gui, chart, PLOT_PX + (18 if axis == 2 else 0), show_x=axis == 2)
            for axis, chart in enumerate(self._charts)
        ]

    def _on_transport(self, value: str) -> None:
        clock = self._host.playback
        if value == TRANSPORT[0]:
            self._host.seek_failure(-1)
        elif value == TRANSPORT[1]:
            clock.step(-1)
        elif value in ("play", "pause"):
            clock.toggle()
        elif value == TRANSPORT[3]:
            clock.step(1)
        else:
            self._host.seek_failure(1)

    def update(self, moment: Moment) -> None:
        """Move `now`, and redraw the curves where the drive changed."""
        self._headline.content = headline(moment)
        self._legend.content = legend_line(self._truth is not None, moment.compared is not None)
        transport = TRANSPORT_PLAYING if moment.clock.playing else TRANSPORT
        if self._transport.options != transport:
            self._transport.options = transport
        self._slider.value = moment.frame
        if moment.drive_changed or moment.compared is not self._compared:
            self._compared = moment.compared
            self._charts = extrinsics_charts(moment.snapshot, self._truth, self._ranges, moment.compared)
            self._ranges = [chart.y_range for chart in self._charts]
            for plot, chart in zip(self._plots, self._charts, strict=True):
                plot.show(chart)
        self._now.content = plots.now_line(self._charts[0], float(moment.frame), NOW_PX)
