"""Exports: files of the drive, a figure sheet, a recording, and the command that reproduces this."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from stereocalib_app.drive import exports
from stereocalib_app.drive.card import card_text
from stereocalib_app.drive.figure_sheet import figure_sheet
from stereocalib_app.drive.moment import Moment
from stereocalib_app.drive.panel import Host
from stereocalib_app.drive.session import Session, Snapshot
from stereocalib_app.drive.settings import Settings
from stereocalib_app.widgets.copy_button import copy_button
from stereocalib_core.errors import OutputError

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


def made(host: Host, name: str, make: Maker) -> bytes:
    """A file of what is computed so far; raises OutputError where that is nothing."""
    snapshot = host.session.snapshot
    if not snapshot.results:
        raise OutputError("nothing computed yet", name, "wait for the first frames")
    return make(host.session, snapshot, host.settings)


def send_sheet(host: Host, client: Any) -> None:
    """The figure sheet as a download."""
    name = "figures.png"
    client.send_file_download(name, made(host, name, _sheet), save_immediately=True)


class ExportPanel:
    """A tab of the main panel."""

    def __init__(self, host: Host) -> None:
        self._host = host
        gui = host.gui
        gui.add_markdown("What is computed so far, with the corrections that are set.")
        for label, name, make, hint in FILES:
            host.on_download(gui.add_button(label, hint=hint), name, partial(made, host, name, make))
        self._copy_page, self._page_command = gui.add_html(""), gui.add_markdown("")
        self._copy, self._command = gui.add_html(""), gui.add_markdown("")

    def update(self, moment: Moment) -> None:
        """Show the command."""
        tolerance = self._host.doors.tolerance
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
