"""Debug: every stage's numbers against their limits, why a frame failed, and the way to the next one."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import Any

import numpy as np

from stereocalib_app.drive.card import shift_words
from stereocalib_app.drive.moment import Moment
from stereocalib_app.drive.panel import Host
from stereocalib_app.drive.panels.faults import FaultsPanel
from stereocalib_app.drive.session import Snapshot
from stereocalib_app.widgets import palette, text
from stereocalib_core.back.causes import changes_at
from stereocalib_core.back.remedies import REMEDIES
from stereocalib_core.back.rig.shift_alarm import UNSEEN
from stereocalib_core.back.spans import failed_spans
from stereocalib_core.errors import FailureReason
from stereocalib_core.results import Cause, Check

NOWHERE = "–"
LISTED = 400
MOST_CHANGES = 5
GO_THERE = ": choose where to go"


def shown(value: float, unit: str = "") -> str:
    """Lengths and angles to a thousandth, other numbers with three digits or all before the point; with unit."""
    if not np.isfinite(value):
        return NOWHERE
    digits = (
        f"{value:.3f}" if unit in ("m", "deg") else f"{value:.3g}" if abs(value) < 100 else f"{value:.0f}"
    )
    return digits.replace("-", "−") + ("°" if unit == "deg" else f" {unit}" if unit else "")


def limits(check: Check) -> str:
    """`10 … 20`, `≥ 10`, `≤ 20`, with the unit."""
    unit = "°" if check.unit == "deg" else f" {check.unit}" if check.unit else ""
    low, high = (
        None if edge is None else f"{edge:.3g}".replace("-", "−") for edge in (check.low, check.high)
    )
    if low is not None and high is not None:
        return f"{low} … {high}{unit}"
    if low is not None:
        return f"≥ {low}{unit}"
    return NOWHERE if high is None else f"≤ {high}{unit}"


def checks_html(checks: Sequence[Check]) -> str:
    """Every number with its limit, stage by stage; what is outside is marked in words and colour."""
    color = palette.css(palette.FAILED)
    rows: list[str] = []
    stage = ""
    for check in checks:
        if check.stage != stage:
            stage = check.stage
            rows.append(
                f'<tr><td colspan="3" style="padding-top:0.5em;font-weight:600">{html.escape(stage)}</td></tr>'
            )
        value, limit = html.escape(shown(check.value, check.unit)), html.escape(limits(check))
        name = html.escape(check.name)
        if not check.ok:
            name = f'<b style="color:{color}">✗ {name} is outside</b>'
            value = f'<b style="color:{color}">{value}</b>'
        rows.append(
            f"<tr><td>{name}</td><td style='text-align:right;white-space:nowrap'>{value}</td>"
            f"<td style='text-align:right;white-space:nowrap;opacity:0.7;padding-left:0.8em'>{limit}</td></tr>"
        )
    head = "<tr style='opacity:0.7'><td>number</td><td style='text-align:right'>value</td>"
    head += "<td style='text-align:right'>limit</td></tr>"
    style = "width:100%;font-size:0.82em;border-spacing:0 0.1em;padding:0 1.2em 0 0.5em"
    return f"<table style='{style}'>{head}{''.join(rows)}</table>"


def ranked(moment: Moment) -> list[Cause]:
    """What the drive as a whole says of this frame, likeliest first; what speaks of fewer frames says more."""
    drive = moment.snapshot.drive
    if drive is None:
        return []
    return [cause for cause in drive.causes if cause.first <= moment.frame <= cause.last]


def changes_words(moment: Moment) -> str:
    """What moved for the worse in this stretch against the good frames, with both numbers; Markdown."""
    result = moment.result
    if result is None or result.ok:
        return ""
    found = changes_at(moment.snapshot.results, moment.frame)[:MOST_CHANGES]
    if not found:
        return ""
    lines = "\n".join(f"- {text.escape(change.words)}" for change in found)
    return f"\n\n**What changed against the good frames**, what tells most first:\n\n{lines}"


def verdict(moment: Moment) -> str:
    """What happened in this frame and what to do."""
    result = moment.result
    if result is None:
        return "This frame is not computed yet."
    causes = ranked(moment)
    if result.failure is None:
        if causes:
            found = "\n\n".join(
                f"{text.escape(c.cause)}. **What to do:** {text.escape(c.remedy)}." for c in causes
            )
            return f"**Frame {moment.frame} is measured, but doubtful.**\n\n{found}"
        return f"**Frame {moment.frame} is ok.** Every number is within its limits."
    reason = FailureReason(result.failure.reason)
    cause, remedy = REMEDIES[reason]
    color = palette.css(palette.FAILED)
    return (
        f'<span style="color:{color}">**Frame {moment.frame} failed: {text.escape(reason)}**</span>\n\n'
        f"{text.escape(result.failure.detail)}\n\n{_causes_words(causes) or _one_cause(cause, remedy)}"
        f"{changes_words(moment)}"
    )


def _one_cause(cause: str, remedy: str) -> str:
    return f"**Likely cause:** {cause}.\n\n**What to do:** {remedy}."


def _causes_words(causes: list[Cause]) -> str:
    """The causes of a stretch, likeliest first."""
    if not causes:
        return ""
    first, *others = causes
    words = _one_cause(text.escape(first.cause, 600), text.escape(first.remedy, 400))
    if others:
        words += "\n\n**Or:** " + "; ".join(text.escape(c.cause) for c in others[:3]) + "."
    return words


def shift_options(snapshot: Snapshot) -> tuple[str, ...]:
    """One entry per shift of the mount."""
    shifts = () if snapshot.drive is None else snapshot.drive.shifts
    return tuple(f"{s.frame} · {shift_words(s).partition(' at frame')[0]}" for s in shifts)


def frame_of(option: str) -> int | None:
    """The frame that an entry leads to."""
    head = option.split()[0]
    return int(head) if head.isdigit() and not option.endswith(GO_THERE) else None


def failures_head(snapshot: Snapshot) -> str:
    """The first entry of the list of failures, which leads nowhere."""
    count = len(snapshot.failures())
    return "none" if count == 0 else f"{count} {'frame' if count == 1 else 'frames'}{GO_THERE}"


def shifts_head(count: int) -> str:
    """The first entry of the list of shifts, which leads nowhere."""
    return "none" if count == 0 else f"{count} {'shift' if count == 1 else 'shifts'}{GO_THERE}"


class DebugPanel:
    """A folder of the guide tab."""

    def __init__(self, host: Host) -> None:
        gui = host.gui
        self._host = host
        self._told: tuple[int, int] | None = None
        self._verdict = gui.add_markdown("")
        self._failures = gui.add_dropdown(
            "Failures", ("none",), hint="All failed frames with their reason. Choose one to go there."
        )
        self._shifts = gui.add_dropdown(
            "Shifts", ("none",), hint=f"Where the mount moved. Choose one to go there. {UNSEEN}"
        )
        self._jump = gui.add_button_group("", ("◀ failure", "failure ▶"))
        self._checks = gui.add_html("")
        self._faults: FaultsPanel | None = None
        if host.session.spec.startswith("synthetic"):
            with gui.add_folder("Break this synthetic drive"):
                self._faults = FaultsPanel(host)
        for handle in (self._failures, self._shifts):
            host.on_input(handle, self._go)
        host.on_click(self._jump, lambda v: host.seek_failure(1 if v.startswith("failure") else -1))

    def _go(self, option: Any) -> None:
        frame = frame_of(str(option))
        if frame is not None:
            self._host.playback.play(False)
            self._host.playback.seek(frame)

    def update(self, moment: Moment) -> None:
        """Show the frame's numbers and the lists."""
        result = moment.result
        key = moment.frame, moment.snapshot.version
        if key != self._told and (moment.settings.preset == "Debug" or not moment.clock.playing):
            # Its folder is folded away in the other presets: what nobody sees need not be written ten times a second.
            self._told, self._verdict.content = key, verdict(moment)
            self._checks.content = "" if result is None else checks_html(result.checks)
        if self._faults is not None:
            self._faults.update(moment)
        if moment.drive_changed:
            shifts = shift_options(moment.snapshot)
            for handle, wanted in (
                (
                    self._failures,
                    (
                        failures_head(moment.snapshot),
                        *(s.words for s in failed_spans(moment.snapshot.results)[:LISTED]),
                    ),
                ),
                (self._shifts, (shifts_head(len(shifts)), *shifts)),
            ):
                if tuple(handle.options) != wanted:
                    handle.options = wanted
