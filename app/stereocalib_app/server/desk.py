"""Answers what our own scripts ask: seek, signals, a stage large, the disparity under the pointer."""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from stereocalib_app.drive.card import card_html, sections_html
from stereocalib_app.drive.hotkeys import COMMANDS
from stereocalib_app.drive.moment import Moment
from stereocalib_app.drive.page import Page
from stereocalib_app.drive.page_words import to_words
from stereocalib_app.drive.settings import LAYOUTS
from stereocalib_app.drive.signals.row import Known, Row
from stereocalib_app.drive.signals.table import all_rows
from stereocalib_app.drive.wire import now_head, packed, signals_message
from stereocalib_app.server.docking import Docked, read_docking
from stereocalib_app.server.links import Link, Links, Shown
from stereocalib_app.server.me import Names
from stereocalib_app.server.shelf import shelf, thumbnail
from stereocalib_core.errors import SourceError

MOST_ROWS = 40
FINEST = 64.0
"""Steps of disparity in a pixel, as the read-out has it."""


@dataclass(frozen=True)
class Asking:
    """Who asks, in the words of viser's events."""

    client: Any
    client_id: int | None


class Pages(Protocol):
    """Which page a browser shows, and who it is."""

    leader: int | None

    @property
    def shared(self) -> Page:
        """The page of all who follow."""

    def page_of(self, client_id: int) -> Page:
        """The page of one browser."""

    def settled_page_of(self, client_id: int | None) -> Page:
        """The same, None's is the shared one; while another drive is put in its place, the one that will be there."""

    def browser(self, number: int) -> Any | None:
        """viser's client of a number, None where it has gone."""

    def come_as(self, client: Any, words: list[str], frame: int | None, source: str, own: bool) -> None:
        """Show a browser what its address says."""

    def look_from(self, client: Any, camera: list[float]) -> None:
        """Place a browser's camera."""

    def dock(self, client: Any, panels: dict[str, Docked], moved: bool) -> None:
        """Remember where a browser has put its panels, and put them there unless they are."""


class Signals:
    """The rows of a page, made once for every browser and version."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._made: dict[str, tuple[Any, int, list[Row]]] = {}

    def rows(self, name: str, known: Known, version: int) -> list[Row]:
        """All rows of the page of that name."""
        with self._lock:
            made = self._made.get(name)
            if made is None or made[0] is not known.snapshot or made[1] != version:
                made = self._made[name] = (known.snapshot, version, all_rows(known))
            return made[2]


class Desk:
    """Stands between the lines to the browsers and the pages."""

    def __init__(self, pages: Pages) -> None:
        self._pages = pages
        self.links, self.names = Links(self), Names()
        self._signals = Signals()
        self._last: dict[str, tuple[Moment, Shown]] = {}
        self._asked: dict[str, Callable[[Link, Page, Mapping[str, Any]], bytes | None]] = {
            "seek": self._seek,
            "stage": self._stage,
            "signals": self._rows,
            "disparity": self._disparity,
            "shelf": self._shelf,
            "open": self._open,
            "move": self._move,
            "card": self._card,
            "docking": self._docking,
        }

    # --- to the browsers

    def shown(self, page: Page, moment: Moment, version: int) -> None:
        """A page shows a moment: tell its browsers."""
        known = self._last.get(page.name)
        view = moment.view
        if view is None and known is not None and known[0].session is moment.session:
            view = known[1].view
        shown = Shown({**now_head(moment, version), "state": address(page, moment)}, view)
        self._last[page.name] = moment, shown
        for link in self.links.all():
            if self._page(link) is page:
                link.offer(shown)

    def told_again(self, client: Any) -> None:
        """A browser has changed its page."""
        for link in self.links.all():
            if link.client is client:
                self._welcome(link)

    def camera_moved(self, client: Any) -> None:
        """Say where a browser looks from, for its address."""
        camera = client.camera
        values = [*map(float, camera.position), *map(float, camera.look_at)]
        message = packed({"t": "camera", "camera": [round(v, 2) for v in values]})
        for link in self.links.all():
            if link.client is client:
                link.send(message)

    def _page(self, link: Link) -> Page:
        return self._pages.shared if link.client is None else self._pages.page_of(link.client.client_id)

    def _welcome(self, link: Link) -> None:
        page = self._page(link)
        keys = [[c.label, c.key, c.modifier] for c in COMMANDS if c.key]
        head = {
            "t": "page",
            "name": page.session.source.name,
            "total": len(page.session.source),
            "stages": list(LAYOUTS),
            "keys": keys,
            "camera": camera_head(page),
        }
        link.send(packed(head))
        last = self._last.get(page.name)
        if last is not None and last[0].session is page.session:
            link.offer(last[1])

    # --- Desk of the lines

    def client_of(self, number: int, key: str) -> Any | None:
        """viser's client of that number, if the key is its own."""
        return self._pages.browser(number) if self.names.knows(number, key) else None

    def arrived(self, link: Link) -> None:
        """A browser has said who it is, and what its address wants to see."""
        state = link.hello.get("state")
        docked = read_docking(link.hello.get("docking"))
        if link.client is not None and docked:
            self._pages.dock(link.client, docked, moved=False)
        if link.client is not None and isinstance(state, dict):
            words = [w for w in state.get("set", []) if isinstance(w, str)][:60]
            frame = state.get("at")
            frame = frame if isinstance(frame, int) and frame >= 0 else None
            source = state.get("source")
            self._pages.come_as(
                link.client, words, frame, source if isinstance(source, str) else "", state.get("own") is True
            )
            camera = state.get("camera")
            if isinstance(camera, list) and len(camera) == 6 and all(map(_number, camera)):
                self._pages.look_from(link.client, camera)
        self._welcome(link)

    def left(self, link: Link) -> None:
        """A browser has gone."""

    def drawn(self, link: Link, frame: int) -> None:
        """A browser has drawn the picture of a frame."""
        self._page(link).debut.drawn(frame)

    def asked(self, link: Link, message: Mapping[str, Any]) -> bytes | None:
        """The answer to a message, None where there is nothing to say."""
        action = self._asked.get(str(message.get("t")))
        return None if action is None else action(link, self._page(link), message)

    # --- what can be asked

    def _act(self, link: Link, action: Callable[[Page], Any]) -> None:
        """Do what a person asked for, where that person may: on the page that is there when it is done."""
        client, begun = link.client, False

        def act(page: Page) -> None:
            nonlocal begun
            begun = True
            action(page)

        def ask(page: Page) -> None:
            if client is not None:
                asking = Asking(client, client.client_id)
                page.run_for_client(asking, lambda _client: page.one_by_one(act, page))
            elif self._pages.leader is None:
                page.one_by_one(act, page)

        for _ in range(MOST_PAGES):
            page = self._pages.settled_page_of(None if client is None else client.client_id)
            ask(page)
            if begun or not page.closed:
                return

    def _seek(self, link: Link, page: Page, message: Mapping[str, Any]) -> None:
        frame = message.get("frame")
        if isinstance(frame, int) and not isinstance(frame, bool) and abs(frame) < 1e9:
            self._act(link, lambda page: page.playback.seek(frame))

    def _stage(self, link: Link, page: Page, message: Mapping[str, Any]) -> None:
        name = message.get("name")
        if name in LAYOUTS:
            self._act(link, lambda page: page.change(layout=name))

    def _move(self, link: Link, page: Page, message: Mapping[str, Any]) -> None:
        action = MOVES.get(str(message.get("what")))
        if action is not None:
            self._act(link, action)

    def _card(self, link: Link, page: Page, message: Mapping[str, Any]) -> bytes | None:
        last = self._last.get(page.name)
        if last is None:
            return None
        snapshot, session = last[0].snapshot, last[0].session
        notices = (*session.notices, *session.source.notices)
        html = card_html(snapshot) + sections_html(snapshot, session.source.ground_truth, notices)
        return packed({"t": "card", "html": html})

    def _docking(self, link: Link, page: Page, message: Mapping[str, Any]) -> None:
        if link.client is not None:
            self._pages.dock(link.client, read_docking(message.get("panels")), moved=True)

    def _rows(self, link: Link, page: Page, message: Mapping[str, Any]) -> bytes | None:
        wanted, last = message.get("names"), self._last.get(page.name)
        if last is None or not isinstance(wanted, list):
            return None
        moment, shown = last
        times = np.asarray(moment.session.source.timestamps_s, dtype=np.float64)
        known = Known(
            moment.snapshot, times, moment.session.source.ground_truth, moment.paths, moment.compared
        )
        version = int(shown.head["version"])
        rows = self._signals.rows(page.name, known, version)
        names = [str(name) for name in wanted[:MOST_ROWS]]
        return signals_message(rows, names, moment.snapshot, list(times), version)

    def _shelf(self, link: Link, page: Page, message: Mapping[str, Any]) -> bytes | None:
        found = [[e.path, e.kind, e.frames, round(e.changed_s)] for e in shelf(page.doors.root)]
        return packed({"t": "shelf", "root": str(page.doors.root), "found": found})

    def _open(self, link: Link, page: Page, message: Mapping[str, Any]) -> None:
        path = message.get("path")
        if isinstance(path, str):
            self._act(link, lambda page: page.doors.open(path))

    async def thumb(self, query: dict[str, str]) -> tuple[str, bytes] | None:
        """The first picture of a drive below the root, small."""
        try:
            folder = Path(self._pages.shared.doors.resolve(query.get("path", "")))
        except SourceError:
            return None
        made = await asyncio.to_thread(thumbnail, folder)
        return None if made is None else ("image/jpeg", made)

    def _disparity(self, link: Link, page: Page, message: Mapping[str, Any]) -> bytes | None:
        frame = message.get("frame")
        if not isinstance(frame, int) or not 0 <= frame < len(page.session.source):
            return None
        found = page.session.views_with(page.settings.broken_stage).stages(frame)
        last = self._last.get(page.name)
        best = None if last is None or last[0].frame != frame else last[0].best
        head: dict[str, Any] = {"t": "disparity", "frame": frame, "road": None, "size": [0, 0]}
        if best is not None:
            e = best[0]
            head["road"] = [e.height_m, e.pitch_rad, e.roll_rad]
        if found.stages is None:
            return packed(head)
        values = found.stages.disparity.values
        head |= {"size": list(values.shape[::-1]), "step": found.stages.disparity.step_px, "scale": FINEST}
        steps = np.nan_to_num(np.clip(values * FINEST, 0, 65535), nan=0.0)
        return packed(head, steps.astype("<u2").tobytes())


MOST_PAGES = 5
"""So often another page may take the place of the one that a person meant, before it is given up."""
MOVES: Mapping[str, Callable[[Page], Any]] = {
    "play": lambda page: page.playback.toggle(),
    "back": lambda page: page.playback.step(-1),
    "on": lambda page: page.playback.step(1),
    "failure": lambda page: page.seek_failure(1),
    "failure before": lambda page: page.seek_failure(-1),
}
"""What the buttons of our own pages do."""


def _number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e6


def camera_head(page: Page) -> list[float]:
    """Width, height, focal length, principal point [px], baseline [m]."""
    c = page.session.source.camera
    return [c.width, c.height, c.focal_px, c.cx_px, c.cy_px, c.baseline_m]


def address(page: Page, moment: Moment) -> str:
    """What a link to this moment says, as JSON: frame, settings, drive."""
    state: dict[str, Any] = {"at": moment.frame, "set": to_words(moment.settings)}
    source = page.doors.name_of(moment.session)
    if source:
        state["source"] = source
    if not page.shared:
        state["own"] = True
    return json.dumps(state)
