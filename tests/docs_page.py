"""The blocks of code of a page of docs/, so that tests run what readers copy."""

from __future__ import annotations

import re
from pathlib import Path

DOCS = Path(__file__).resolve().parents[1] / "docs"
BLOCK = re.compile(r'^```python(?: title="([^"]+)")?\n(.*?)^```$', re.MULTILINE | re.DOTALL)


def blocks(page: str) -> list[tuple[str, str]]:
    """Title (or empty) and code of every Python block, in order."""
    return BLOCK.findall((DOCS / page).read_text(encoding="utf-8"))


def block(page: str, title: str) -> str:
    """The block of that title."""
    (code,) = [code for name, code in blocks(page) if name == title]
    return code
