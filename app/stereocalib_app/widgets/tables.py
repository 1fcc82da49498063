"""HTML tables for the panels. Every cell is escaped here; callers pass plain strings."""

from __future__ import annotations

import html
from collections.abc import Iterable, Mapping, Sequence

from stereocalib_app.widgets import palette

NO_COLORS: Mapping[str, palette.Rgb] = {}
_TABLE = (
    "width:calc(100% - 1em);margin:0.1em 0.5em 0.5em;font-size:0.82em;border-spacing:0 0.1em;line-height:1.4"
)


def _cells(row: Sequence[str], tag: str = "td") -> str:
    first = f'<{tag} style="text-align:left;font-weight:600">{row[0]}</{tag}>'
    style = "text-align:right;white-space:nowrap;padding-left:0.6em;font-variant-numeric:tabular-nums"
    return first + "".join(f'<{tag} style="{style}">{cell}</{tag}>' for cell in row[1:])


def numbers_table(
    title: str,
    header: Sequence[str],
    rows: Iterable[Sequence[str]],
    colors: Mapping[str, palette.Rgb] = NO_COLORS,
) -> str:
    """Names at the left, numbers at the right, under a title. A cell that begins with `!` is marked; names with
    a colour get a dash of it."""

    def shown(cell: str) -> str:
        text = html.escape(cell.removeprefix("!"))
        if cell in colors:
            return f'<span style="color:{palette.css(colors[cell])}">▬</span> {text}'
        return f'<b style="color:{palette.css(palette.FAILED)}">{text}</b>' if cell.startswith("!") else text

    head = "".join(_cells([html.escape(cell) for cell in header], "th")) if any(header) else ""
    body = "".join(f"<tr>{_cells([shown(cell) for cell in row])}</tr>" for row in rows)
    caption = f'<div style="{TITLE}">{html.escape(title)}</div>' if title else ""
    return f'{caption}<table style="{_TABLE}"><tr style="opacity:0.7">{head}</tr>{body}</table>'


TITLE = "margin:0.5em 0.6em 0.1em;font-weight:700;font-size:0.85em"


def note(line: str) -> str:
    """A line of small print."""
    return f'<div style="margin:0 0.7em 0.5em;font-size:0.82em;opacity:0.75;line-height:1.4">{html.escape(line)}</div>'


_KEY = "display:flex;flex-wrap:wrap;column-gap:1em;margin:0 0.7em 0.5em;font-size:0.82em;line-height:1.4"


def color_scale(title: str, colors: Sequence[palette.Rgb], low: str, high: str) -> str:
    """What a range of colours means: a bar from `low` to `high`."""
    stops = ",".join(palette.css(color) for color in colors)
    bar = (
        f'<div style="flex:1;height:0.8em;border-radius:2px;background:linear-gradient(90deg,{stops})"></div>'
    )
    ends = f"<span>{html.escape(low)}</span>{bar}<span>{html.escape(high)}</span>"
    label = html.escape(f"{title}: from {low} to {high}", quote=True)
    style = f"{_KEY};flex-wrap:nowrap;align-items:center"
    return (
        f'<div style="{TITLE}">{html.escape(title)}</div>'
        f'<div role="img" aria-label="{label}" style="{style}">{ends}</div>'
    )


def color_key(title: str, entries: Iterable[tuple[str, palette.Rgb, str]]) -> str:
    """What colours mean: a mark in its colour before each name, as many a line as fit."""
    marks = "".join(
        f'<span style="white-space:nowrap"><span style="color:{palette.css(color)}">{mark}</span> '
        f"{html.escape(name)}</span>"
        for mark, color, name in entries
    )
    return f'<div style="{TITLE}">{html.escape(title)}</div><div style="{_KEY}">{marks}</div>'
