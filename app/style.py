"""The page's own style sheet: viser's elements set closer together, and the chosen preset filled in.

It only adds to viser's look: where a rule no longer fits a later viser, the element looks as viser made it.
"""

from __future__ import annotations

from app import palette

MARK = "stereocalib-chosen"

_RULES = """
div:has(> .uplot-container) { margin-bottom: -7px; }
.uplot-container { border: 0 !important; background: transparent !important; }
div:has(> p > label:empty) { display: none; }
"""

_CHOSEN = (
    f"div:has(> .{MARK}[data-n='%d']) + div button:nth-of-type(%d) "
    f"{{ background: {palette.css(palette.BRAND)}; border-color: {palette.css(palette.BRAND)}; color: #fff; }}"
)


def style_sheet(choices: int) -> str:
    """HTML with the rules; `choices` is the number of buttons in the largest marked group."""
    chosen = "\n".join(_CHOSEN % (n, n + 1) for n in range(choices))
    return f"<style>{_RULES}{chosen}</style>"


def chosen(index: int) -> str:
    """HTML that fills in the button `index` of the group that follows it."""
    return f'<span class="{MARK}" data-n="{index}"></span>'
