"""What belongs to one browser alone: light or dark, following the lead or exploring, holding the lead."""

from __future__ import annotations

from typing import Any, Protocol

import viser

from stereocalib_app.widgets.page_base import set_theme


class Leading(Protocol):
    """Who leads, and which page a browser shows. leader: number of the browser that holds the lead, or None."""

    leader: int | None

    def detach(self, client: viser.ClientHandle) -> None:
        """Give a browser a page of its own."""

    def attach(self, client: viser.ClientHandle) -> None:
        """Bring it back to the shared page."""


def light_switch(gui: Any) -> None:
    """A checkbox that makes one browser's page light; `gui` is that client's."""
    light: Any = gui.add_checkbox("Light theme", False, hint="Only in this browser.")

    @light.on_update
    def _(_event: Any) -> None:
        set_theme(gui, dark=not light.value)


class BrowserPanel:
    """A folder of the main panel that only this browser has."""

    def show_own(self, own: bool) -> None:
        """Say whether this browser explores on its own."""
        self._own.value = own

    def __init__(self, hub: Leading, client: viser.ClientHandle) -> None:
        gui = client.gui
        with gui.add_folder("This browser", expand_by_default=False, order=1e6):
            self._own: Any = gui.add_checkbox(
                "Explore on my own",
                False,
                hint="Leave the shared time line; your changes stay in this browser.",
            )
            self._lead: Any = gui.add_checkbox(
                "Only I lead",
                hub.leader == client.client_id,
                hint="Others follow until they explore on their own.",
            )
            light_switch(gui)

        @self._own.on_update
        def _(event: Any) -> None:
            if event.client_id is not None:
                (hub.detach if self._own.value else hub.attach)(client)

        @self._lead.on_update
        def _(event: Any) -> None:
            if event.client_id is None:
                return
            if self._lead.value and hub.leader not in (None, client.client_id):
                self._lead.value = False
                client.add_notification(
                    "Somebody else leads", "One browser can hold the lead.", auto_close_seconds=6.0
                )
                return
            hub.leader = client.client_id if self._lead.value else None
