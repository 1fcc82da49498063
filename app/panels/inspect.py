"""Inspect: the answer first, then the numbers of the frame."""

from __future__ import annotations

from typing import TYPE_CHECKING

from app.moment import Moment
from app.panels.timeline import now_table

if TYPE_CHECKING:
    from app.page import Page


class InspectPanel:
    """A part of the main panel."""

    def __init__(self, page: Page) -> None:
        gui = page.gui
        self._now = gui.add_markdown("")

    def update(self, moment: Moment) -> None:
        """Show the frame's numbers."""
        self._now.content = f"**This frame** ({moment.frame})\n\n" + now_table(moment)
