"""Every command of the palette with its key; keys that move viser's camera (WASDQE, arrows) stay free."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from stereocalib_app.drive.page import Page
from stereocalib_app.drive.panels.exports import send_sheet
from stereocalib_app.drive.settings import PRESETS


@dataclass(frozen=True)
class Command:
    """One entry: what it is called, its key, and what it does to a page."""

    label: str
    key: str | None
    modifier: str | None
    run: Callable[[Page], Any]


def _preset(name: str) -> Callable[[Page], Any]:
    return lambda page: page.choose(name)


def _toggle(axis: str) -> Callable[[Page], Any]:
    return lambda page: page.what_if.toggle(axis)


COMMANDS: tuple[Command, ...] = (
    Command("Play or pause", "space", None, lambda page: page.playback.toggle()),
    Command("Next frame", "N", None, lambda page: page.playback.step(1)),
    Command("Previous frame", "P", None, lambda page: page.playback.step(-1)),
    Command("Ten frames on", "N", "shift", lambda page: page.playback.step(10)),
    Command("Ten frames back", "P", "shift", lambda page: page.playback.step(-10)),
    Command("Next failure", "F", None, lambda page: page.seek_failure(1)),
    Command("Previous failure", "F", "shift", lambda page: page.seek_failure(-1)),
    Command("First frame", "home", None, lambda page: page.playback.seek(0)),
    Command("Last frame", "end", None, lambda page: page.playback.seek(page.playback.total - 1)),
    *(Command(f"View: {name}", str(i + 1), None, _preset(name)) for i, name in enumerate(PRESETS)),
    Command("Yaw correction on or off", "Y", None, _toggle("yaw")),
    Command("Pitch correction on or off", "T", None, _toggle("pitch")),
    Command("Roll correction on or off", "R", None, _toggle("roll")),
    Command("A / B against the previous correction", "B", None, lambda page: page.what_if.swap()),
    Command("Reset corrections", "0", None, lambda page: page.what_if.reset()),
    Command(
        "Follow the car or show the whole drive",
        "C",
        None,
        lambda page: page.set_follow(not page.settings.follow),
    ),
    Command("Export the figure sheet", "X", None, lambda page: None),
)
EXPORT = "Export the figure sheet"


def register(gui: Any, page_of: Callable[[int], Page]) -> None:
    """Register every command once; each acts on the page that its browser shows."""
    for command in COMMANDS:
        _register(gui, command, page_of)


def _register(gui: Any, command: Command, page_of: Callable[[int], Page]) -> None:
    handle = gui.add_command(command.label, hotkey=command.key, modifier=command.modifier)

    @handle.on_trigger
    def _(event: Any) -> None:
        page = page_of(event.client_id)
        if command.label == EXPORT:
            page.run_for_client(event, partial(send_sheet, page))
        else:
            page.run_for_client(event, lambda _client: page.one_by_one(command.run, page))
