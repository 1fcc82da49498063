"""Numbers and foreign strings as Markdown that is safe to show: viser passes raw HTML through."""

from __future__ import annotations

import html
import re

import numpy as np

_MARKDOWN = re.compile(r"([\\`*_{}\[\]()#+\-.!|~>$])")


def escape(text: object, limit: int = 300) -> str:
    """A string from outside as one inert line of Markdown."""
    line = " ".join(str(text).split())
    if len(line) > limit:
        line = line[: limit - 1] + "…"
    return _MARKDOWN.sub(r"\\\1", html.escape(line, quote=False))


def code(text: object, limit: int = 300) -> str:
    """A string from outside as a span of code: nothing in it is Markdown or HTML."""
    line = " ".join(str(text).replace("`", "'").split())
    return f"`{line if len(line) <= limit else line[: limit - 1] + '…'}`"


def number(value: float | None, digits: int, unit: str = "") -> str:
    """A number with its unit, or a dash."""
    if value is None or not np.isfinite(value):
        return "–"
    text = f"{value:.{digits}f}".replace("-", "−")
    if float(text.replace("−", "-")) == 0:
        text = text.removeprefix("−")
    return f"{text}{unit}"


def with_sigma(value: float | None, sigma: float | None, digits: int, unit: str) -> str:
    """`1.652 ± 0.012 m`, or a dash."""
    if value is None or not np.isfinite(value):
        return "–"
    if sigma is None or not np.isfinite(sigma):
        return number(value, digits, unit)
    return f"{number(value, digits)} ± {number(sigma, digits)}{unit}"


def table(header: list[str], rows: list[list[str]]) -> str:
    """A Markdown table; the cells are Markdown already, and every header stands over the left edge of its column."""
    lines = ["| " + " | ".join(header) + " |", "|" + " :--- |" * len(header)]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows])


def duration(seconds: float) -> str:
    """`40 s`, `3 min 20 s`, `1 h 5 min`."""
    whole = max(0, round(seconds))
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"
