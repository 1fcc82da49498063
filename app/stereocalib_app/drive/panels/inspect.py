"""Inspect: the answer first, then the numbers of the frame and of the drive."""

from __future__ import annotations

from stereocalib_app.drive.card import card_html, card_text, sections_html
from stereocalib_app.drive.moment import Moment
from stereocalib_app.drive.panel import Host
from stereocalib_app.drive.panels.timeline import now_table
from stereocalib_app.drive.summary import drive_summary, path_legend
from stereocalib_app.widgets.copy_button import copy_button


class InspectPanel:
    """A folder of the guide tab."""

    def __init__(self, host: Host) -> None:
        gui = host.gui
        self._card = gui.add_html("")
        self._copy = gui.add_html("")
        self._now = gui.add_html("")
        self._drive = gui.add_html("")
        self._sections = gui.add_html("")
        self._legend = gui.add_html("")

    def update(self, moment: Moment) -> None:
        """Show the card, the frame's numbers and the drive's."""
        if moment.drive_changed:
            self._card.content = card_html(moment.snapshot)
            self._copy.content = copy_button(
                "Copy the card", card_text(moment.session.source.name, moment.snapshot)
            )
            self._drive.content = drive_summary(moment.snapshot, moment.paths)
            source = moment.session.source
            notices = (*moment.session.notices, *source.notices)
            self._sections.content = sections_html(moment.snapshot, source.ground_truth, notices)
        if moment.drive_changed or moment.settings_changed:
            self._legend.content = path_legend(
                moment.paths, moment.settings.paths, moment.settings.color_by_error
            )
        self._now.content = now_table(moment)
