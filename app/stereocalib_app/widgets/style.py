"""The page's own style sheet: viser's elements set closer together, and the chosen preset filled in.

It only adds to viser's look: where a rule no longer fits a later viser, the element looks as viser made it.
"""

from __future__ import annotations

MARK = "stereocalib-chosen"
MOST_CHOICES = 5
"""Buttons in the largest group of which one is chosen: the speeds of playback."""

_RULES = """
div:has(> .uplot-container) { margin-bottom: -7px; }
.uplot-container { border: 0 !important; background: transparent !important; }
div:has(> p > label:empty) { display: none; }
[role=tab][aria-selected=true] { color: var(--mantine-color-text) !important; }
:root:root[data-mantine-color-scheme=dark] { --mantine-color-dimmed: #9a9da3; }
:root:root[data-mantine-color-scheme=light] { --mantine-color-dimmed: #656d75;
  --mantine-primary-color-filled: #005c94; --mantine-color-custom-filled: #005c94;
  --mantine-color-custom-outline: #005c94; }
.equations mfrac > * { padding: 0.1em 0.2em; }
.equations math { font-family: inherit; }
"""

_CHOSEN = (
    f"div:has(> .{MARK}[data-n='%d']) + div button:nth-of-type(%d) "
    "{ background: var(--mantine-primary-color-filled); border-color: transparent; color: #fff; }"
)


def style_sheet() -> str:
    """HTML with the rules. Every panel has its own: what is in a panel that is folded away counts for nothing."""
    chosen = "\n".join(_CHOSEN % (n, n + 1) for n in range(MOST_CHOICES))
    return f"<style>{_RULES}{chosen}</style>"


def chosen(index: int) -> str:
    """HTML that fills in the button `index` of the group that follows it."""
    return f'<span class="{MARK}" data-n="{index}"></span>'
