"""Debug: every stage's numbers against their limits, why a frame failed, and the way to the next one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from app import palette, text
from app.moment import Moment
from app.remedies import REMEDIES
from app.session import Snapshot
from stereocalib_core.errors import FailureReason
from stereocalib_core.results import Check

if TYPE_CHECKING:
    from app.page import Page

NOWHERE = "–"
LISTED = 400


def limits(check: Check) -> str:
    """`10 … 20`, `≥ 10`, `≤ 20`."""
    if check.low is not None and check.high is not None:
        return f"{check.low:.4g} … {check.high:.4g}"
    if check.low is not None:
        return f"≥ {check.low:.4g}"
    return NOWHERE if check.high is None else f"≤ {check.high:.4g}"


def checks_table(checks: tuple[Check, ...]) -> str:
    """Every number with its limit; what is outside is marked in words and colour."""
    rows = []
    for check in checks:
        unit = f" {text.escape(check.unit)}" if check.unit else ""
        value = f"{check.value:.4g}{unit}"
        verdict = "ok"
        if not check.ok:
            verdict = f'<span style="color:{palette.css(palette.FAILED)}">**outside**</span>'
            value = f"**{value}**"
        rows.append([text.escape(check.stage), text.escape(check.name), value, limits(check), verdict])
    return text.table(["stage", "number", "value", "limit", ""], rows)


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
    shifts = [] if snapshot.analysis is None else snapshot.analysis.report.get("shifts") or []
    return tuple(f"{s['frame']} · {s['axis']} {s['size']:+.3g} {s['unit']} ({s['kind']})" for s in shifts)


def frame_of(option: str) -> int | None:
    """The frame that an entry leads to."""
    head = option.split()[0]
    return int(head) if head.isdigit() else None


class DebugPanel:
    """A folder of the guide tab."""

    def __init__(self, page: Page) -> None:
        gui = page.gui
        self._page = page
        self._verdict = gui.add_markdown("")
        self._failures = gui.add_dropdown(
            "Failures", (NOWHERE,), hint="All failed frames with their reason. Choose one to go there."
        )
        self._shifts = gui.add_dropdown(
            "Shifts", (NOWHERE,), hint="Where the mount moved. Choose one to go there."
        )
        self._jump = gui.add_button_group("", ("◀ failure", "failure ▶"))
        self._checks = gui.add_markdown("")
        for handle in (self._failures, self._shifts):
            page.on_input(handle, self._go)
        page.on_click(self._jump, lambda v: page.playback.seek_failure(1 if v.startswith("failure") else -1))

    def _go(self, option: Any) -> None:
        frame = frame_of(str(option))
        if frame is not None:
            self._page.playback.play(False)
            self._page.playback.seek(frame)

    def update(self, moment: Moment) -> None:
        """Show the frame's numbers and the lists."""
        self._verdict.content = verdict(moment)
        result = moment.result
        self._checks.content = "" if result is None else checks_table(result.checks)
        if moment.drive_changed:
            for handle, options in (
                (self._failures, failure_options(moment.snapshot)),
                (self._shifts, shift_options(moment.snapshot)),
            ):
                wanted = (NOWHERE, *options)
                if tuple(handle.options) != wanted:
                    handle.options = wanted
