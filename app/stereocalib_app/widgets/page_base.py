"""What the page of a drive and the page of boards do alike: hear what people do, and tell them kindly what is wrong."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import Any

from stereocalib_app.widgets import palette
from stereocalib_app.widgets.long_work import LongWork
from stereocalib_core.errors import StereoCalibError
from stereocalib_core.system import opening

LOG = logging.getLogger(__name__)


def set_theme(gui: Any, dark: bool = True) -> None:
    """The look of every page."""
    gui.configure_theme(dark_mode=dark, show_logo=False, show_share_button=False, brand_color=palette.BRAND)


class PageBase:
    """The inputs of one page. `gui` is of viser's server or of one of its clients."""

    def __init__(self, gui: Any) -> None:
        self.gui = gui
        self._acting = threading.RLock()
        self._notes: dict[int, Any] = {}

    def may_act(self, event: Any) -> bool:
        """Whether the browser that an event is from may change this page; a page that refuses says so itself."""
        return True

    def on_input(self, handle: Any, action: Callable[[Any], Any]) -> None:
        """Run `action(value)` when a person (not the program) changes an input."""

        @handle.on_update
        def _(event: Any) -> None:
            if event.client_id is not None:
                self.run_for_client(event, lambda _client: self.one_by_one(action, handle.value))

    def on_click(self, handle: Any, action: Callable[[Any], Any]) -> None:
        """Run `action(value)` when a person presses a button or one of a group."""

        @handle.on_click
        def _(event: Any) -> None:
            if event.client_id is not None:
                value = getattr(handle, "value", None)
                self.run_for_client(event, lambda _client: self.one_by_one(action, value))

    def on_download(self, handle: Any, name: str, make: Callable[[], bytes]) -> None:
        """Send what `make` gives to the browser that pressed the button."""

        @handle.on_click
        def _(event: Any) -> None:
            self.run_for_client(
                event, lambda client: client.send_file_download(name, make(), save_immediately=True)
            )

    def one_by_one(self, action: Callable[[Any], Any], value: Any) -> None:
        """viser calls back from many threads: what reads and writes the settings must not interleave."""
        with self._acting:
            action(value)

    def run_for_client(self, event: Any, action: Callable[[Any], Any]) -> None:
        """`action(client)`, which a person asked for, where it is allowed; errors are told kindly, and of a recording
        that takes its time to open, how far it is."""
        client = event.client
        if client is None or not self.may_act(event):
            return
        try:
            with LongWork(client, "Opening") as work, opening.told_to(work.at):
                action(client)
        except StereoCalibError as error:
            LOG.info("%s", error)
            body = f"{error.what}: {error.where}. {error.remedy}"
            self.tell(client, "That did not work", body, 15.0, "red")

    def tell(self, client: Any, title: str, body: str, seconds: float = 6.0, color: Any = None) -> None:
        """A note in one browser, in place of the one before."""
        with self._acting:
            old = self._notes.pop(client.client_id, None)
        if old is not None:
            old.remove()
        note = client.add_notification(title, body, color=color, auto_close_seconds=seconds)
        with self._acting:
            self._notes[client.client_id] = note
