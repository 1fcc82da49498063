"""Inspect: the answer first, then the numbers of the frame."""

from __future__ import annotations

from typing import TYPE_CHECKING

from app.card import card_markdown, card_text
from app.copy_button import copy_button
from app.moment import Moment
from app.panels.timeline import now_table

if TYPE_CHECKING:
    from app.page import Page


class InspectPanel:
    """A folder of the guide tab."""

    def __init__(self, page: Page) -> None:
        gui = page.gui
        self._card = gui.add_markdown("")
        self._copy = gui.add_html("")
        self._now = gui.add_markdown("")
        self._notices = gui.add_markdown("")

    def update(self, moment: Moment) -> None:
        """Show the card and the frame's numbers."""
        if moment.drive_changed:
            self._card.content = card_markdown(moment.snapshot)
            self._copy.content = copy_button(
                "Copy the card", card_text(moment.session.source.name, moment.snapshot)
            )
        self._now.content = f"**Frame {moment.frame}**\n\n" + now_table(moment)
