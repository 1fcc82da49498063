"""What a part of the page is, and what it may use of the page: `Panel`, `Host` and `Doors`.

A panel is built once, inside the tab or folder that the table in `panels/table.py` gives it, and is told of every
moment afterwards. It knows its host by this protocol alone, so that no panel needs the page.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from stereocalib_app.drive.moment import Moment
from stereocalib_app.drive.session import Session
from stereocalib_app.drive.settings import Settings
from stereocalib_app.drive.what_if import WhatIf
from stereocalib_app.server.clock import Playback


class Panel(Protocol):
    """A part of the page."""

    def update(self, moment: Moment) -> None:
        """Show a moment. Called from one thread, once a tick; `moment` says what has changed."""


@dataclass(frozen=True)
class Doors:
    """Where a panel may lead the page to: other drives below `root`. tolerance: the file the mount is judged by."""

    root: Path
    tolerance: Path | None
    open: Callable[[str], None]
    open_upload: Callable[[Any], None]
    reopen: Callable[[str, int, int], None]
    compare: Callable[[str], None]
    resolve: Callable[[str], str]
    """A path below `root` that was typed, whole; raises for one that is not."""
    name_of: Callable[[Session], str]
    """What to open a drive by from the page, empty where that is not possible."""


class Host(Protocol):
    """The page, as far as its parts may use it."""

    gui: Any
    session: Session
    settings: Settings
    playback: Playback
    doors: Doors
    what_if: WhatIf
    shared: bool

    def change(self, **changes: Any) -> None:
        """Change fields of `Settings` and show the result."""

    def choose(self, preset: str) -> None:
        """Change the preset; each starts with its own view."""

    def seek_failure(self, direction: int) -> None:
        """Go to the next (+1) or previous (-1) failed frame."""

    def set_follow(self, follow: bool) -> None:
        """Follow the car, or stand back."""

    def on_input(self, handle: Any, action: Callable[[Any], Any]) -> None:
        """Run `action(value)` when a person changes an input."""

    def on_click(self, handle: Any, action: Callable[[Any], Any]) -> None:
        """Run `action(value)` when a person presses a button."""

    def on_download(self, handle: Any, name: str, make: Callable[[], bytes]) -> None:
        """Send what `make` gives to the browser that pressed a button."""

    def run_for_client(self, event: Any, action: Callable[[Any], Any]) -> None:
        """Run `action(client)` for the browser that an event is from, if it may steer."""

    def add_panel(self) -> Any:
        """A movable panel that belongs to this page."""

    def add_root(self, handle: Any) -> Any:
        """Remember an outermost element, to hide or remove it with the page."""


PanelMaker = Callable[[Host], Panel]
