"""Brings drives, pages and browsers together: one shared page that is led, and one page per browser that left it."""

from __future__ import annotations

import logging
import threading
from typing import Any

import viser
from viser import _messages

from app import palette
from app.page import Page
from app.session import Session
from stereocalib_core.geometry import Extrinsics

LOG = logging.getLogger(__name__)
VIEWS_WIDTH_PX, MAIN_WIDTH_PX = 450, 345


class Hub:
    """Owns the server's pages and the drive that is open."""

    def __init__(self, server: viser.ViserServer, session: Session) -> None:
        self.server, self.session = server, session
        self._lock = threading.RLock()
        self._detached: dict[int, Page] = {}
        self.leader: int | None = None
        server.gui.configure_theme(
            dark_mode=True, show_logo=False, show_share_button=False, brand_color=palette.BRAND
        )
        server.initial_camera.position = (-6.0, -5.5, -9.5)
        server.initial_camera.look_at = (0.5, 3.6, 6.0)
        server.initial_camera.up = (0.0, -1.0, 0.0)
        server.gui.main_panel.dock_right()
        server.gui.main_panel.set_width(MAIN_WIDTH_PX)
        self.shared = Page(self, server, session, "lead")
        self.place(self.shared)
        server.on_client_connect(self._connected)
        server.on_client_disconnect(self._disconnected)

    def start(self) -> None:
        """Start computing and showing."""
        self.session.start()
        self.shared.start()

    def close(self) -> None:
        """Stop everything but the server."""
        with self._lock:
            pages = [self.shared, *self._detached.values()]
        for page in pages:
            page.playback.close()
        self.session.close()

    def place(self, page: Page) -> None:
        """Put the panels of a page where they belong."""
        views, _header, timeline = page.parts[0], page.parts[1], page.parts[2]
        views.panel.dock_left()
        views.panel.set_width(VIEWS_WIDTH_PX)
        timeline.panel.float(x=8, y=-8, width=460)

    def may_steer(self, page: Page, client_id: int | None) -> bool:
        """Whether a browser may change a page: its own always, the shared one unless another holds the lead."""
        return page.owner is not None or self.leader is None or self.leader == client_id

    def live_extrinsics(self, page: Page, frame: int) -> Extrinsics | None:
        """The road as the page's corrections see it, None while they are untouched."""
        return None

    def _connected(self, client: viser.ClientHandle) -> None:
        self.fit(client)
        sizes = (0, 0)

        @client.camera.on_update
        def _(_camera: Any) -> None:
            nonlocal sizes
            now = (client.camera.image_width, client.camera.image_height)
            if now != sizes:
                sizes = now
                self.fit(client)

    def fit(self, client: viser.ClientHandle) -> None:
        """Let the time line use the width that this browser has between the docked panels."""
        page = self._detached.get(client.client_id, self.shared)
        width = max(380, min(900, int(client.camera.image_width) - 16))
        panel = page.parts[2].panel
        message = _messages.GuiSetPanelWidthMessage(
            panel._impl.uuid, width, counter=page.gui._next_layout_counter(), run_id=page.gui._layout_run_id
        )
        client._websock_connection.queue_message(message)

    def _disconnected(self, client: viser.ClientHandle) -> None:
        with self._lock:
            page = self._detached.pop(client.client_id, None)
            if self.leader == client.client_id:
                self.leader = None
        if page is not None:
            page.playback.close()
