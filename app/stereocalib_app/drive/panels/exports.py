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
from stereocalib_app.drive.panels.corrections import describe
from stereocalib_app.drive.session import Session, Snapshot
from stereocalib_app.drive.settings import Settings
from stereocalib_app.widgets import text
from stereocalib_app.widgets.copy_button import copy_button
from stereocalib_app.widgets.long_work import LongWork
from stereocalib_core.errors import OutputError

Told = Callable[[int, int], None]
"""Hears how many parts of how many are done."""
Maker = Callable[[Session, Snapshot, Settings, Told], bytes]


def _quick(make: Callable[[Session, Snapshot, Settings], bytes]) -> Maker:
    """What is done before anybody would ask how far it is."""
    return lambda session, snapshot, settings, _told: make(session, snapshot, settings)


def _sheet(session: Session, snapshot: Snapshot, settings: Settings, told: Told) -> bytes:
    told(0, 1)
    return figure_sheet(session, snapshot, settings, card_text(session.source.name, snapshot))


FILES: tuple[tuple[str, str, Maker, str], ...] = (
    ("Trajectory, TUM", "trajectory.tum", _quick(exports.tum), "time x y z qx qy qz qw, no line in a gap"),
    ("Trajectory, KITTI", "trajectory.txt", _quick(exports.kitti), "12 numbers a line, one line a frame"),
    ("Extrinsics, CSV", "extrinsics.csv", _quick(exports.csv), "one row a frame, as from `stereocalib run`"),
    ("Report, JSON", "report.json", _quick(exports.report), "mount, rows of the pair, shifts, failures"),
    ("Figure sheet, PNG", "figures.png", _sheet, "mount, extrinsics and path on one page"),
    ("Recording, rrd", "recording.rrd", exports.recording, "opens in the rerun viewer"),
)


def made(host: Host, name: str, make: Maker, told: Told = lambda done, total: None) -> bytes:
    """A file of what is computed so far; raises OutputError where that is nothing."""
    snapshot = host.session.snapshot
    if not snapshot.results:
        raise OutputError("nothing computed yet", name, "wait for the first frames")
    return make(host.session, snapshot, host.settings, told)


def send_sheet(host: Host, client: Any) -> None:
    """The figure sheet as a download."""
    _send(host, "figures.png", _sheet, client)


def _send(host: Host, name: str, make: Maker, client: Any) -> None:
    """A file that says in its name which drive and which settings it holds."""
    full = exports.file_name(host.session, host.settings, name)
    with LongWork(client, f"Writing {name}") as work:
        content = made(host, name, make, work.at)
    client.send_file_download(full, content, save_immediately=True)


def holds(moment: Moment) -> str:
    """What an export made now holds, in words. Markdown."""
    frames = f"{len(moment.snapshot.results)} of {moment.snapshot.total} frames"
    corrections = moment.settings.corrections
    if not corrections.touched:
        return f"{frames}, as measured."
    return (
        f"{frames}. **Path, report and figures: {text.escape(describe(corrections))}.** Extrinsics: as measured, "
        "whatever the corrections."
    )


class ExportPanel:
    """A tab of the main panel."""

    def __init__(self, host: Host) -> None:
        self._host = host
        gui = host.gui
        self._holds = gui.add_markdown("")
        for label, name, make, hint in FILES:
            self._add(gui.add_button(label, hint=hint), name, make)
        self._copy_page, self._page_command = gui.add_html(""), gui.add_markdown("")
        self._copy, self._command = gui.add_html(""), gui.add_markdown("")

    def _add(self, button: Any, name: str, make: Maker) -> None:
        host = self._host

        @button.on_click
        def _(event: Any) -> None:
            host.run_for_client(event, partial(_send, host, name, make))

    def update(self, moment: Moment) -> None:
        """Say what the files will hold, and show the commands."""
        if moment.settings_changed or moment.drive_changed:
            self._holds.content = holds(moment)
        tolerance = self._host.doors.tolerance
        if (
            moment.settings_changed
            or moment.drive_changed
            or (moment.frame_changed and not moment.clock.playing)
        ):
            line = exports.page_command(moment.session, moment.settings, moment.frame, tolerance)
            self._copy_page.content = copy_button("Copy the command that shows this page", line)
            self._page_command.content = _fenced(line)
        if moment.drive_changed or moment.settings_changed:
            line = exports.command(moment.session, tolerance)
            self._copy.content = copy_button("Copy the command that computes these numbers", line)
            self._command.content = _fenced(line) + (
                AS_MEASURED if moment.settings.corrections.touched else ""
            )


AS_MEASURED = (
    "\n\nA run measures; it takes no corrections. The command above this one shows the live path with them."
)


def _fenced(line: str) -> str:
    """A command as a block of Markdown."""
    return f"```\n{line.replace('`', ' ')}\n```"
