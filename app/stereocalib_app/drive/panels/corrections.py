"""Corrections: how much of each angle is used, an error injected on purpose, and the path that follows."""

from __future__ import annotations

from functools import partial
from typing import Any

from stereocalib_app.drive.moment import Moment
from stereocalib_app.drive.panel import Host
from stereocalib_app.drive.settings import ERROR_LIMIT_DEG, ERROR_LIMIT_M, EXTRINSICS, MODELS, Corrections
from stereocalib_app.widgets import palette, text

AXES = ("yaw", "pitch", "roll", "height")


def error_field(axis: str) -> str:
    """The field of `Corrections` that holds an axis' injected error."""
    return "height_error_m" if axis == "height" else f"{axis}_error_deg"


class CorrectionsPanel:
    """Lives in a tab of the main panel."""

    def __init__(self, host: Host) -> None:
        self._host = host
        gui = host.gui
        self._strength: dict[str, Any] = {}
        self._error: dict[str, Any] = {}
        words = "How much of each estimate the odometry uses, and an error put in on purpose."
        if not host.session.tracks:
            words = "This run holds no tracks to correct. Open the drive itself to try corrections."
        gui.add_markdown(words)
        for axis in AXES:
            unit, limit, step = (
                ("m", ERROR_LIMIT_M, 0.005) if axis == "height" else ("°", ERROR_LIMIT_DEG, 0.01)
            )
            self._strength[axis] = gui.add_slider(
                f"{axis} used %",
                0,
                100,
                1,
                100,
                hint=f"0 % takes the {axis} as {'the median of the drive' if axis == 'height' else 'zero'}.",
            )
            self._error[axis] = gui.add_slider(
                f"{axis} added {unit}", -limit, limit, step, 0.0, hint=f"Added to the {axis} in every frame."
            )
            host.on_input(self._strength[axis], partial(self._set_strength, axis))
            host.on_input(self._error[axis], partial(self._set_error, error_field(axis)))
        self._source = gui.add_dropdown(
            "Extrinsics", EXTRINSICS, initial_value="filtered", hint="After the filter, or each pair alone."
        )
        self._model = gui.add_dropdown(
            "Motion",
            MODELS,
            initial_value="full",
            hint="full: six degrees of freedom, road depth from the extrinsics and the disparity. planar: the paper's, "
            "on the plane. nonholonomic: planar, no side slip at the rear axle.",
        )
        self._buttons = gui.add_button_group(
            "", ("A / B", "Reset"), hint="A / B swaps with the setting before the last change."
        )
        self._state = gui.add_markdown("")
        host.on_input(self._source, lambda value: host.what_if.set(source=value))
        host.on_input(self._model, lambda value: host.what_if.set(model=value))
        what_if = host.what_if
        host.on_click(self._buttons, lambda value: what_if.reset() if value == "Reset" else what_if.swap())

    def _set_strength(self, axis: str, percent: float) -> None:
        self._host.what_if.set(**{f"{axis}_strength": percent / 100.0})

    def _set_error(self, name: str, value: float) -> None:
        self._host.what_if.set(**{name: float(value)})

    def update(self, moment: Moment) -> None:
        """Show what is set."""
        if not moment.settings_changed:
            return
        c = moment.settings.corrections
        for axis in AXES:
            self._strength[axis].value = round(100 * getattr(c, f"{axis}_strength"))
            self._error[axis].value = getattr(c, error_field(axis))
        self._source.value, self._model.value = c.source, c.model
        live = f'<span style="color:{palette.css(palette.LIVE)}">▬</span>'
        self._state.content = (
            f"{live} **live: {text.escape(describe(c))}**" if c.touched else "live: as measured"
        )


def describe(corrections: Corrections) -> str:
    """The corrections in words."""
    plain = Corrections()
    parts = []
    for axis in AXES:
        strength = getattr(corrections, f"{axis}_strength")
        if strength != 1.0:
            parts.append(f"{axis} {100 * strength:.0f} %")
        unit = "m" if axis == "height" else "°"
        error = getattr(corrections, error_field(axis))
        if error:
            parts.append(f"{axis} {error:+.3g} {unit}")
    if corrections.source != plain.source:
        parts.append(corrections.source)
    if corrections.model != plain.model:
        parts.append(corrections.model)
    return ", ".join(parts) or "as measured"
