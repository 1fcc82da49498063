"""The time line: transport, the numbers of the frame, and height, pitch and roll over time."""

from __future__ import annotations

import html

import numpy as np

from stereocalib_app.drive.moment import Moment
from stereocalib_app.drive.panel import Host
from stereocalib_app.drive.panels.playback import SPEED_NAME
from stereocalib_app.drive.signals.extrinsics import axis_values
from stereocalib_app.widgets import palette, text
from stereocalib_app.widgets.style import style_sheet
from stereocalib_app.widgets.tables import numbers_table
from stereocalib_core.geometry import Extrinsics

AXES = ("height", "pitch", "roll")
UNITS = (" m", "°", "°")
DIGITS = (3, 3, 3)
TRANSPORT = ("◀ failure", "◀ step", "play", "step ▶", "failure ▶")
TRANSPORT_PLAYING = tuple("pause" if name == "play" else name for name in TRANSPORT)


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


class TimelinePanel:
    """Where we are, the way to go elsewhere, and the signals of the drive."""

    def __init__(self, host: Host) -> None:
        self._host = host
        gui, clock = host.gui, host.playback
        self._headline = gui.add_html("")
        self._slider = gui.add_slider(
            "Frame", 0, max(1, clock.total - 1), 1, 0, hint="Drag, or type an exact frame number."
        )
        self._transport = gui.add_button_group(
            "", TRANSPORT, hint="Previous failure, step back, play or pause, step on, next failure."
        )
        gui.add_html(f"<stereocalib-timeline></stereocalib-timeline>{style_sheet()}")
        host.on_input(self._slider, lambda value: clock.seek(int(value)))
        host.on_click(self._transport, self._on_transport)

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
        """Say where we are; the signals come on our own line."""
        self._headline.content = headline(moment)
        transport = TRANSPORT_PLAYING if moment.clock.playing else TRANSPORT
        if self._transport.options != transport:
            self._transport.options = transport
        self._slider.value = moment.frame
