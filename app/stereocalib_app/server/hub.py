"""Drives, pages and browsers: one shared page that is led, and one page per browser that explores on its own."""

from __future__ import annotations

import logging
import threading
from pathlib import Path
from typing import Any

import viser

from stereocalib_app.drive import hotkeys
from stereocalib_app.drive.debut import Debut
from stereocalib_app.drive.moment import Moment
from stereocalib_app.drive.page import Page
from stereocalib_app.drive.page_words import from_words
from stereocalib_app.drive.session import Session
from stereocalib_app.drive.settings import Settings
from stereocalib_app.drive.viewpoint import Viewpoint, place_camera
from stereocalib_app.server.browser_panel import BrowserPanel
from stereocalib_app.server.desk import Asking, Desk
from stereocalib_app.server.docking import MAIN_WIDTH_PX, Docked, timeline_width, views_width
from stereocalib_app.server.inputs import guard
from stereocalib_app.server.library import Library
from stereocalib_app.server.viser_internals import set_place, set_width, show_elements, show_node
from stereocalib_core.errors import ConfigError, SourceError
from stereocalib_core.files.run_folder import load_run

LOG = logging.getLogger(__name__)


class Hub:
    """Owns the server's pages and the drives that are open."""

    def __init__(
        self,
        server: viser.ViserServer,
        session: Session,
        library: Library,
        settings: Settings | None = None,
        debut: Debut | None = None,
    ) -> None:
        self.server, self.library = server, library
        self._lock = threading.RLock()
        self._own: dict[int, Page] = {}
        self._browsers: dict[int, BrowserPanel] = {}
        self._views_px: dict[int, tuple[Page | None, int]] = {}
        self._docked: dict[int, dict[str, Docked]] = {}
        self._sessions: list[Session] = [session]
        self._wishes: dict[int | None, int] = {}
        self.leader: int | None = None
        self.desk = Desk(self)
        self.closed = False
        hotkeys.register(server.gui, self.page_of)
        self.shared = Page(self, server, session, "lead", settings=settings, debut=debut)
        self._place(self.shared)
        server.on_client_connect(self._connected)
        server.on_client_disconnect(self._disconnected)

    def start(self) -> None:
        """Start computing and showing."""
        for session in self._sessions:
            session.start()
        self.shared.start()

    def close(self, timeout_s: float = 10.0) -> None:
        """Stop everything but the server; wait at most `timeout_s` for each worker."""
        with self._lock:
            self.closed = True
            pages, sessions = [self.shared, *self._own.values()], list(self._sessions)
        for page in pages:
            page.playback.close(timeout_s)
        for session in sessions:
            session.close(timeout_s)
        self.library.close()

    def page_of(self, client_id: int) -> Page:
        """The page that a browser shows."""
        return self._own.get(client_id, self.shared)

    def settled_page_of(self, client_id: int | None) -> Page:
        """The page that a browser shows, None's is the shared one; while another drive is put in its place, the one
        that will be there."""
        with self._lock:
            return self.shared if client_id is None else self.page_of(client_id)

    def browser(self, number: int) -> viser.ClientHandle | None:
        """viser's client of a number, None where it has gone."""
        return self.server.get_clients().get(number)

    def shown(self, page: Page, moment: Moment, version: int) -> None:
        """A page shows a moment."""
        self.desk.shown(page, moment, version)

    def come_as(
        self, client: viser.ClientHandle, words: list[str], frame: int | None, source: str, own: bool
    ) -> None:
        """Show a browser what its address says: on the shared page where it is alone there, else on its own."""
        page = self.page_of(client.client_id)
        try:
            settings = from_words(words)
        except ConfigError:
            settings = page.settings
        frame = page.playback.state.frame if frame is None else frame
        elsewhere = bool(source) and source != self.library.name_of(page.session)
        if (frame, settings) == (page.playback.state.frame, page.settings) and not (elsewhere or own):
            return
        if page.owner is None and (own or len(self.viewers(page)) > 1):
            if not own and not elsewhere and page.playback.state.playing:
                return
            self.detach(client)
            page = self.page_of(client.client_id)
        asking = Asking(client, client.client_id)
        if elsewhere:
            page.run_for_client(asking, lambda _client: self.open(page, source))
            page = self.page_of(client.client_id)
        page.run_for_client(asking, lambda _client: page.restore(settings, frame))

    def look_from(self, client: viser.ClientHandle, camera: list[float]) -> None:
        """Place a browser's camera."""
        x, y, z, *target = camera
        place_camera(client, Viewpoint((x, y, z), (target[0], target[1], target[2])))

    def viewers(self, page: Page) -> list[viser.ClientHandle]:
        """The browsers that show a page."""
        clients = self.server.get_clients()
        return [client for number, client in clients.items() if self.page_of(number) is page]

    def may_steer(self, page: Page, client_id: int | None) -> bool:
        """Whether a browser may change a page: its own always, the shared one unless another leads."""
        return page.owner is not None or self.leader is None or self.leader == client_id

    # --- drives

    def open(self, page: Page, text: str) -> None:
        """Open what was typed on the page; raises SourceError."""
        wish = self._wish(page)
        self._show(page, self.library.open(text), wish=wish)

    def open_upload(self, page: Page, upload: Any) -> None:
        """Open a zip that was uploaded; raises SourceError."""
        wish = self._wish(page)
        self._show(page, self.library.open_upload(upload.name, upload.content), wish=wish)

    def reopen(self, page: Page, spec: str, frame: int, same_before: int = 0) -> None:
        """Open a variation of the drive on show, which begins to differ at frame `same_before`, and go to a
        frame; raises SourceError."""
        wish = self._wish(page)
        self._show(page, self.library.vary(page.session, spec, same_before), frame, wish)

    def compare(self, page: Page, text: str) -> None:
        """Lay an earlier run beside the drive on show; an empty text takes it away. Raises SourceError."""
        if not text.strip():
            page.set_compared(None)
            return
        folder = Path(self.library.resolve(text))
        if not folder.is_dir():
            raise SourceError("no such folder", text[:200], "name the output folder of an earlier run")
        page.set_compared(load_run(folder))

    def _wish(self, page: Page) -> int:
        """The number of a wish for another drive on a page; the latest one wins."""
        with self._lock:
            self._wishes[page.owner] = self._wishes.get(page.owner, 0) + 1
            return self._wishes[page.owner]

    def _show(self, page: Page, session: Session, frame: int | None = None, wish: int = 0) -> None:
        """Replace the drive of a page, at a frame; without one, a drive that is still computed plays.

        The page may have been replaced since somebody asked for this: its owner has one page, and the later wish wins.
        """
        with self._lock:
            current = self.shared if page.owner is None else self._own.get(page.owner)
            if self.closed or current is None or wish < self._wishes.get(page.owner, 0):
                self._drop(session)
                return
            page = current
            settings = page.settings
            page.close()
            self._sessions.append(session)
            session.start()
            if page.owner is None:
                self.shared = fresh = Page(self, self.server, session, "lead", settings=settings)
                self._place(fresh)
                for client_id in self._own:
                    self._set_shared_visible(client_id, False)
            else:
                client = page.api
                fresh = Page(self, client, session, page.name, page.owner, settings)
                self._own[page.owner] = fresh
                self._place(fresh)
            if frame is not None:
                fresh.playback.seek(frame)
            fresh.start()
            if frame is None and session.run_folder is None:
                fresh.playback.play()
            self._drop_unused()
        for client in self.server.get_clients().values():
            self.fit(client)
            self.desk.told_again(client)

    def _drop_unused(self) -> None:
        used = {id(page.session) for page in (self.shared, *self._own.values())}
        for session in [s for s in self._sessions if id(s) not in used]:
            self._sessions.remove(session)
            threading.Thread(target=self._drop, args=(session,), daemon=True).start()

    def _drop(self, session: Session) -> None:
        """Stop a drive that no page shows any more, and remove what was uploaded of it."""
        session.close()
        self.library.forget(session)

    # --- browsers

    def detach(self, client: viser.ClientHandle) -> None:
        """Give a browser a page of its own, at the frame and settings of the shared one."""
        with self._lock:
            if client.client_id in self._own or self.closed:
                return
            shared = self.shared
            self._set_shared_visible(client.client_id, False)
            page = Page(
                self, client, shared.session, f"own{client.client_id}", client.client_id, shared.settings
            )
            self._own[client.client_id] = page
            self._place(page)
            page.playback.seek(shared.playback.state.frame)
            page.start()
        self._say_own(client, True)
        self.fit(client)
        self.desk.told_again(client)

    def attach(self, client: viser.ClientHandle) -> None:
        """Bring a browser back to the shared page."""
        with self._lock:
            page = self._own.pop(client.client_id, None)
            if page is None:
                return
            page.close()
            self._set_shared_visible(client.client_id, True)
            self._drop_unused()
        self._say_own(client, False)
        self.fit(client)
        self.desk.told_again(client)

    def _say_own(self, client: viser.ClientHandle, own: bool) -> None:
        browser = self._browsers.get(client.client_id)
        if browser is not None:
            browser.show_own(own)

    def _set_shared_visible(self, client_id: int, visible: bool) -> None:
        """Show or hide the shared page in one browser only."""
        client = self.server.get_clients().get(client_id)
        if client is None:
            return
        show_elements(client, self.shared.roots, visible)
        show_node(client, f"/{self.shared.name}", visible)

    def _place(self, page: Page) -> None:
        """Put the panels of a page where they belong."""
        page.views.panel.dock_left()
        page.views.panel.set_width(views_width(720, 1280))
        page.plots.panel.float(x=8, y=-8, width=460)

    def dock(self, client: viser.ClientHandle, panels: dict[str, Docked], moved: bool) -> None:
        """A browser says where it has put its panels. moved: they are there already."""
        with self._lock:
            self._docked[client.client_id] = panels
        if not moved:
            self._views_px.pop(client.client_id, None)
            self.fit(client)

    def _put(self, client: viser.ClientHandle, page: Page) -> None:
        """Put the panels of a page where this browser has had them."""
        panels = {"views": page.views.panel, "plots": page.plots.panel, "main": self.server.gui.main_panel}
        for name, docked in self._docked.get(client.client_id, {}).items():
            gui = self.server.gui if name == "main" else page.gui
            edge = None if docked.at == "float" else docked.at
            set_place(client, gui, panels[name], edge, docked.x, docked.y)
            set_width(client, gui, panels[name], docked.width_px)

    def fit(self, client: viser.ClientHandle) -> None:
        """Give the pictures the height that this browser has, and the time line what is left between the panels,
        where the browser has not put them elsewhere."""
        page = self.page_of(client.client_id)
        if self._docked.get(client.client_id):
            fitted, _ = self._views_px.get(client.client_id, (None, 0))
            if fitted is not page:
                self._views_px[client.client_id] = page, 0
                self._put(client, page)
            return
        height, between = int(client.camera.image_height), int(client.camera.image_width)
        fitted, docked = self._views_px.get(client.client_id, (None, views_width(720, 1280)))
        if fitted is not None and fitted is not page:
            # A fresh panel is as wide as every panel begins, whatever the one before was dragged to.
            docked = views_width(720, 1280)
        views = views_width(height, between + docked + MAIN_WIDTH_PX)
        if fitted is not page or docked != views:
            # Only then: a width that somebody has dragged must stay.
            self._views_px[client.client_id] = page, views
            set_width(client, page.gui, page.views.panel, views)
        set_width(client, page.gui, page.plots.panel, timeline_width(between + docked - views))

    def _connected(self, client: viser.ClientHandle) -> None:
        guard(client.gui)
        self.desk.names.name(client)
        self._browsers[client.client_id] = BrowserPanel(self, client)
        self.fit(client)
        known = (client.camera.image_width, client.camera.image_height)

        @client.camera.on_update
        def _(_camera: Any) -> None:
            nonlocal known
            self.desk.camera_moved(client)
            size = (client.camera.image_width, client.camera.image_height)
            if size != known:
                known = size
                self.fit(client)

    def _disconnected(self, client: viser.ClientHandle) -> None:
        with self._lock:
            page = self._own.pop(client.client_id, None)
            self._browsers.pop(client.client_id, None)
            self.desk.names.forget(client.client_id)
            self._views_px.pop(client.client_id, None)
            self._docked.pop(client.client_id, None)
            self._wishes.pop(client.client_id, None)
            if self.leader == client.client_id:
                self.leader = None
            self._drop_unused()
        if page is not None:
            page.playback.close()
            page.detach_for_good()

    def count(self) -> tuple[int, int]:
        """Browsers connected, and how many of them explore on their own."""
        return len(self._browsers), len(self._own)
