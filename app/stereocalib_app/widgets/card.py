"""The answer first: lines of name, value and verdict as a card on a page, or as text to be copied."""

from __future__ import annotations

import html
from collections.abc import Sequence
from dataclasses import dataclass

from stereocalib_app.widgets import palette


@dataclass(frozen=True)
class CardRow:
    """One line of the card. limit: the verdict on a tolerance, or empty; `bad` marks what needs attention."""

    name: str
    value: str
    limit: str = ""
    bad: bool = False

    @property
    def line(self) -> str:
        """The line as text."""
        return f"{self.name}: {self.value}" + (f" ({self.limit})" if self.limit else "")


def _cell(value: str, bad: bool, style: str = "") -> str:
    shown = html.escape(value)
    if bad:
        mark = "" if value.startswith(("✗", "not ")) else "⚠ "
        shown = f'<b style="color:{palette.css(palette.FAILED)}">{mark}{shown}</b>'
    return f'<td style="{style}">{shown}</td>'


def _row(row: CardRow, wide: bool) -> str:
    name = f'<td style="opacity:0.75;padding-right:0.8em;white-space:nowrap">{html.escape(row.name)}</td>'
    if row.limit:
        value = _cell(row.value, False, "font-weight:600;white-space:nowrap")
        return f"<tr>{name}{value}{_cell(row.limit, row.bad, 'font-size:0.88em;padding-left:0.7em')}</tr>"
    span = ' colspan="2"' if wide else ""
    value = _cell(row.value, row.bad, "font-weight:600")
    return f"<tr>{name}{value.replace('<td', f'<td{span}', 1)}</tr>"


def card(title: str, rows: Sequence[CardRow], notes: Sequence[str] = ()) -> str:
    """HTML of a card; every string in it is escaped here."""
    wide = any(row.limit for row in rows)
    small = "".join(
        f'<div style="font-size:0.85em;opacity:0.7;margin-top:0.35em">{html.escape(note)}</div>'
        for note in notes
        if note
    )
    return (
        '<div style="margin:0.2em 0.5em 0.4em;padding:0.5em 0.7em;border-radius:6px;font-size:0.85em;'
        f'line-height:1.5;border:1px solid rgba(128,128,128,0.45);background:rgba(128,128,128,0.08)">'
        f'<div style="font-weight:700;margin-bottom:0.25em">{html.escape(title)}</div>'
        f'<table style="border-spacing:0;width:100%;vertical-align:top">{"".join(_row(r, wide) for r in rows)}'
        f"</table>{small}</div>"
    )
