"""Exports: files of the drive, a figure sheet, a recording, and the command that reproduces this."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from stereocalib_app.drive import exports
from stereocalib_app.drive.card import card_text
from stereocalib_app.drive.figure_sheet import figure_sheet
from stereocalib_app.drive.moment import Moment
from stereocalib_app.drive.session import Session, Snapshot
from stereocalib_app.drive.settings import Settings
from stereocalib_app.widgets.copy_button import copy_button
from stereocalib_core.errors import OutputError

if TYPE_CHECKING:
    from stereocalib_app.drive.page import Page

Maker = Callable[[Session, Snapshot, Settings], bytes]


def _sheet(session: Session, snapshot: Snapshot, settings: Settings) -> bytes:
    return figure_sheet(session, snapshot, settings, card_text(session.source.name, snapshot))


FILES: tuple[tuple[str, str, Maker, str], ...] = (
    ("Trajectory, TUM", "trajectory.tum", exports.tum, "time x y z qx qy qz qw, one line a frame"),
    ("Trajectory, KITTI", "trajectory.txt", exports.kitti, "12 numbers a line, one line a frame"),
    ("Extrinsics, CSV", "extrinsics.csv", exports.csv, "one row a frame, as from `stereocalib run`"),
    ("Report, JSON", "report.json", exports.report, "mount, rows of the pair, shifts, failures"),
    ("Figure sheet, PNG", "figures.png", _sheet, "mount, extrinsics and path on one page"),
    ("Recording, rrd", "recording.rrd", exports.recording, "opens in the rerun viewer"),
)


class ExportPanel:
    """A tab of the main panel."""

    def __init__(self, page: Page) -> None:
        self._page = page
        gui = page.gui
        gui.add_markdown("What is computed so far, with the corrections that are set.")
        for label, name, make, hint in FILES:
            button = gui.add_button(label, hint=hint)
            self._connect(button, name, make)
        self._copy_page, self._page_command = gui.add_html(""), gui.add_markdown("")
        self._copy, self._command = gui.add_html(""), gui.add_markdown("")

    def send_sheet(self, client: Any) -> None:
        """The figure sheet as a download."""
        self._send(client, "figures.png", _sheet)

    def _connect(self, button: Any, name: str, make: Maker) -> None:
        page = self._page

        @button.on_click
        def _(event: Any) -> None:
            page.run_for_client(event, lambda client: self._send(client, name, make))

    def _send(self, client: Any, name: str, make: Maker) -> None:
        page = self._page
        snapshot = page.session.snapshot
        if not snapshot.results:
            raise OutputError("nothing computed yet", name, "wait for the first frames")
        client.send_file_download(name, make(page.session, snapshot, page.settings), save_immediately=True)

    def update(self, moment: Moment) -> None:
        """Show the command."""
        tolerance = self._page.hub.library.tolerance
        if (
            moment.settings_changed
            or moment.drive_changed
            or (moment.frame_changed and not moment.clock.playing)
        ):
            line = exports.page_command(moment.session, moment.settings, moment.frame, tolerance)
            self._copy_page.content = copy_button("Copy the command that shows this page", line)
            self._page_command.content = _fenced(line)
        if moment.drive_changed:
            line = exports.command(moment.session, tolerance)
            self._copy.content = copy_button("Copy the command that computes these numbers", line)
            self._command.content = _fenced(line)


def _fenced(line: str) -> str:
    """A command as a block of Markdown."""
    return f"```\n{line.replace('`', ' ')}\n```"
