"""The time line: transport, the numbers of the frame, and height, pitch and roll over time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from app import palette, plots, text
from app.moment import Moment
from app.panels.errors import ErrorsPanel
from app.plots import Chart, Curve
from app.session import Snapshot
from stereocalib_core.io import SavedRun

if TYPE_CHECKING:
    from app.page import Page

AXES = ("height", "pitch", "roll")
UNITS = (" m", "°", "°")
DIGITS = (3, 3, 3)
LEAST_SPAN = (0.12, 0.4, 0.4)
TRANSPORT = ("◀ failure", "◀ step", "play", "step ▶", "failure ▶")
SPEEDS = ("¼×", "½×", "1×", "2×", "4×")
SPEED_OF = dict(zip(SPEEDS, (0.25, 0.5, 1.0, 2.0, 4.0), strict=True))
PLOT_PX = 58


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


def saved_values(run: SavedRun | None, total: int) -> np.ndarray:
    """(total, 3) filtered height [m], pitch, roll [deg] of another run, NaN where it has none."""
    out = np.full((total, 3), np.nan)
    if run is not None:
        frames = np.asarray(run.extrinsics["frame"], dtype=np.int64)
        inside = (frames >= 0) & (frames < total)
        for axis, name in enumerate(("height_filtered_m", "pitch_filtered_deg", "roll_filtered_deg")):
            out[frames[inside], axis] = np.asarray(run.extrinsics[name])[inside]
    return out


def extrinsics_charts(
    snapshot: Snapshot,
    truth: np.ndarray | None,
    previous: list[tuple[float, float]] | None,
    compared: SavedRun | None = None,
) -> list[Chart]:
    """One chart per axis: this pair as dots, filtered with its sigma band, truth, failed spans."""
    x = np.arange(max(snapshot.total, 2), dtype=np.float64)
    raw = np.full((len(x), 3), np.nan)
    raw[: snapshot.total] = raw_values(snapshot)
    failed = np.zeros(len(x), dtype=bool)
    failed[snapshot.failures()] = True
    filtered = np.full((len(x), 3), np.nan)
    sigma = np.zeros((len(x), 3))
    if snapshot.analysis is not None and snapshot.analysis.filtered is not None:
        known = snapshot.analysis.filtered
        filtered[: len(known.state)] = axis_values(known.values)
        sigma[: len(known.state)] = axis_values(known.sigma)
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
            Curve("failed", top, palette.FAILED, hidden=True),
            Curve("", bottom, palette.FAILED, hidden=True),
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
        charts.append(Chart(x, tuple(curves), bands, y_range, f"{name} {UNITS[axis].strip()}"))
    return charts


def legend_line(with_truth: bool, with_compared: bool = False) -> str:
    """The legend of the charts as one line of Markdown."""

    def mark(symbol: str, color: palette.Rgb, name: str) -> str:
        return f'<span style="color:{palette.css(color)}">{symbol}</span> {name}'

    parts = [
        mark("●", palette.RAW, "this pair"),
        mark("━", palette.FILTERED, "filtered ± σ"),
        mark("█", palette.FAILED, "failed"),
        mark("┃", palette.NOW, "now"),
    ]
    if with_compared:
        parts.insert(2, mark("┅", palette.COMPARED, "other run"))
    if with_truth:
        parts.insert(2, mark("┅", palette.TRUTH, "truth"))
    return f'<span style="font-size:0.85em">{" &nbsp; ".join(parts)}</span>'


def now_table(moment: Moment) -> str:
    """The frame's numbers: this pair and filtered, with sigma."""
    result, filtered = moment.result, moment.filtered
    rows = []
    for axis, name in enumerate(AXES):
        pair = smooth = "–"
        if result is not None and result.road is not None:
            e, s = result.road.extrinsics, result.road.sigma
            value = (e.height_m, e.pitch_deg, e.roll_deg)[axis]
            pair = text.with_sigma(
                value, s[axis] if axis == 0 else np.rad2deg(s[axis]), DIGITS[axis], UNITS[axis]
            )
        if filtered is not None:
            e, s, state = filtered
            value = (e.height_m, e.pitch_deg, e.roll_deg)[axis]
            smooth = text.with_sigma(
                value, s[axis] if axis == 0 else np.rad2deg(s[axis]), DIGITS[axis], UNITS[axis]
            )
            if state == "predicted":
                smooth = f"*{smooth} (predicted)*"
        rows.append([f"**{name}**", pair, smooth])
    return text.table(["", "this pair", "filtered"], rows)


def headline(moment: Moment) -> str:
    """One line: where we are and how the frame fared."""
    total = moment.snapshot.total
    result = moment.result
    time_s = float(moment.session.source.timestamps_s[moment.frame]) if total else 0.0
    if result is None:
        state = "not computed yet"
    elif result.ok:
        state = "ok"
    else:
        color = palette.css(palette.FAILED)
        state = f'<span style="color:{color}">**failed: {text.escape(result.reason)}**</span>'
    playing = "▶" if moment.clock.playing else "❚❚"
    return f"{playing} **Frame {moment.frame}** of {max(0, total - 1)} · {time_s:.2f} s · {state}"


class TimelinePanel:
    """Floats at the bottom of the 3-D view."""

    def __init__(self, page: Page) -> None:
        self._page = page
        gui, clock = page.gui, page.playback
        self.panel = page.add_panel()
        self._ranges: list[tuple[float, float]] | None = None
        self._compared: SavedRun | None = None
        self._charts: list[Chart] = []
        truth = page.session.source.ground_truth
        self._truth = None if truth is None else truth.extrinsics
        with self.panel.add_tab("Time line"):
            self._headline = gui.add_markdown("")
            self._slider = gui.add_slider(
                "Frame", 0, max(1, clock.total - 1), 1, 0, hint="Drag, or type an exact frame number."
            )
            self._transport = gui.add_button_group(
                "", TRANSPORT, hint="Previous failure, step back, play or pause, step on, next failure."
            )
            self._plots = self._add_plots(gui)
            self._legend = gui.add_markdown(legend_line(self._truth is not None))
        with self.panel.add_tab("Path errors"):
            self._errors = ErrorsPanel(page)
        with self.panel.add_tab("Playback"):
            self._speed = gui.add_button_group("Speed", SPEEDS, hint="1× is the recording's own pace.")
            self._loop = gui.add_checkbox("Loop", False, hint="Start over at the end of the drive.")
            self._pause = gui.add_checkbox(
                "Pause on failure", False, hint="Playback stops at the next frame that failed."
            )
            gui.add_markdown(
                "Keys: **Space** play · **N** / **P** step · **Shift+N** / **Shift+P** ten · "
                "**F** next failure · **Home** / **End** · **1**–**3** presets · **Ctrl+K** every command"
            )
        page.on_input(self._slider, lambda value: clock.seek(int(value)))
        page.on_click(self._transport, self._on_transport)
        page.on_click(self._speed, lambda value: clock.set_speed(SPEED_OF[value]))
        page.on_input(self._loop, clock.set_loop)
        page.on_input(self._pause, clock.set_pause_on_failure)

    def _add_plots(self, gui: Any) -> list[Any]:
        self._charts = extrinsics_charts(self._page.session.snapshot, self._truth, None)
        self._ranges = [chart.y_range for chart in self._charts]
        return [
            gui.add_uplot(
                plots.chart_data(chart, 0.0),
                **plots.chart_options(chart, PLOT_PX + (18 if axis == 2 else 0), show_x=axis == 2),
            )
            for axis, chart in enumerate(self._charts)
        ]

    def _on_transport(self, value: str) -> None:
        clock = self._page.playback
        if value == TRANSPORT[0]:
            clock.seek_failure(-1)
        elif value == TRANSPORT[1]:
            clock.step(-1)
        elif value == TRANSPORT[2]:
            clock.toggle()
        elif value == TRANSPORT[3]:
            clock.step(1)
        else:
            clock.seek_failure(1)

    def update(self, moment: Moment) -> None:
        """Move `now`, and redraw the curves where the drive changed."""
        self._headline.content = headline(moment)
        self._slider.value = moment.frame
        self._loop.value = moment.clock.loop
        self._pause.value = moment.clock.pause_on_failure
        if moment.drive_changed or moment.compared is not self._compared:
            self._compared = moment.compared
            self._legend.content = legend_line(self._truth is not None, moment.compared is not None)
            self._charts = extrinsics_charts(moment.snapshot, self._truth, self._ranges, moment.compared)
            for plot, chart, old in zip(self._plots, self._charts, self._ranges or [], strict=False):
                if chart.y_range != old:
                    plot.scales = plots.chart_options(chart, PLOT_PX, False)["scales"]
            self._ranges = [chart.y_range for chart in self._charts]
        for plot, chart in zip(self._plots, self._charts, strict=True):
            plot.data = plots.chart_data(chart, float(moment.frame))
        self._errors.update(moment)
