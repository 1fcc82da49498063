"""Debug: every stage's numbers against their limits, why a frame failed, and the way to the next one."""

from __future__ import annotations

import html
from typing import TYPE_CHECKING, Any

from app import palette, text
from app.card import shift_words
from app.moment import Moment
from app.panels.faults import FaultsPanel
from app.remedies import REMEDIES
from app.session import Snapshot
from stereocalib_core.errors import FailureReason
from stereocalib_core.results import Check

if TYPE_CHECKING:
    from app.page import Page

NOWHERE = "–"
LISTED = 400


def shown(value: float) -> str:
    """Three digits, or all before the point."""
    return f"{value:.3g}" if abs(value) < 100 else f"{value:.0f}"


def limits(check: Check) -> str:
    """`10 … 20`, `≥ 10`, `≤ 20`."""
    if check.low is not None and check.high is not None:
        return f"{check.low:.4g} … {check.high:.4g}"
    if check.low is not None:
        return f"≥ {check.low:.4g}"
    return NOWHERE if check.high is None else f"≤ {check.high:.4g}"


def checks_html(checks: tuple[Check, ...]) -> str:
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
        unit = "°" if check.unit == "deg" else f" {html.escape(check.unit)}" if check.unit else ""
        value, limit = f"{shown(check.value)}{unit}", html.escape(limits(check))
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


def verdict(moment: Moment) -> str:
    """What happened in this frame and what to do."""
    result = moment.result
    if result is None:
        return "This frame is not computed yet."
    if result.failure is None:
        return f"**Frame {moment.frame} is ok.** Every number is within its limits."
    reason = FailureReason(result.failure.reason)
    cause, remedy = REMEDIES[reason]
    color = palette.css(palette.FAILED)
    return (
        f'<span style="color:{color}">**Frame {moment.frame} failed: {text.escape(reason)}**</span>\n\n'
        f"{text.escape(result.failure.detail)}\n\n**Likely cause:** {cause}.\n\n**What to do:** {remedy}."
    )


def failure_options(snapshot: Snapshot) -> tuple[str, ...]:
    """One entry per run of failed frames with the same reason."""
    options: list[str] = []
    first = last = None
    reason = ""
    for result in (*snapshot.results, None):
        same = result is not None and not result.ok and result.reason == reason and last == result.frame - 1
        if same and result is not None:
            last = result.frame
            continue
        if first is not None:
            options.append(f"{first} · {reason}" if first == last else f"{first} to {last} · {reason}")
        first = None
        if result is not None and not result.ok:
            first = last = result.frame
            reason = result.reason
    return tuple(options[:LISTED])


def shift_options(snapshot: Snapshot) -> tuple[str, ...]:
    """One entry per shift of the mount."""
    shifts = snapshot.report.get("shifts") or []
    return tuple(f"{s['frame']} · {shift_words(s).partition(' at frame')[0]}" for s in shifts)


def frame_of(option: str) -> int | None:
    """The frame that an entry leads to."""
    head = option.split()[0]
    return int(head) if head.isdigit() and "found:" not in option else None


def list_head(count: int) -> str:
    """The first entry of a list, which leads nowhere."""
    return "none" if count == 0 else f"{count} found: choose one to go there"


class DebugPanel:
    """A folder of the guide tab."""

    def __init__(self, page: Page) -> None:
        gui = page.gui
        self._page = page
        self._verdict = gui.add_markdown("")
        self._failures = gui.add_dropdown(
            "Failures", (list_head(0),), hint="All failed frames with their reason. Choose one to go there."
        )
        self._shifts = gui.add_dropdown(
            "Shifts", (list_head(0),), hint="Where the mount moved. Choose one to go there."
        )
        self._jump = gui.add_button_group("", ("◀ failure", "failure ▶"))
        self._checks = gui.add_html("")
        self._faults: FaultsPanel | None = None
        if page.session.spec.startswith("synthetic"):
            with gui.add_folder("Break this synthetic drive"):
                self._faults = FaultsPanel(page)
        for handle in (self._failures, self._shifts):
            page.on_input(handle, self._go)
        page.on_click(self._jump, lambda v: page.seek_failure(1 if v.startswith("failure") else -1))

    def _go(self, option: Any) -> None:
        frame = frame_of(str(option))
        if frame is not None:
            self._page.playback.play(False)
            self._page.playback.seek(frame)

    def update(self, moment: Moment) -> None:
        """Show the frame's numbers and the lists."""
        self._verdict.content = verdict(moment)
        result = moment.result
        self._checks.content = "" if result is None else checks_html(result.checks)
        if self._faults is not None:
            self._faults.update(moment)
        if moment.drive_changed:
            for handle, options in (
                (self._failures, failure_options(moment.snapshot)),
                (self._shifts, shift_options(moment.snapshot)),
            ):
                wanted = (list_head(len(options)), *options)
                if tuple(handle.options) != wanted:
                    handle.options = wanted
