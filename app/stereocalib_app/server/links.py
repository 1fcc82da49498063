"""Our own line to each browser: where the page is and its picture, as fast as that browser can show them.

Nothing is queued: a browser that is busy is told the latest moment when it is ready again.
"""

from __future__ import annotations

import asyncio
import json
import logging
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from websockets.exceptions import ConnectionClosed

from stereocalib_app.drive.frame_views import FrameView
from stereocalib_app.drive.wire import packed, picture_head

LOG = logging.getLogger(__name__)
LONGEST_MESSAGE = 20_000
PATIENCE_S = 20.0
"""A browser that has not shown a picture after this long is sent the next one anyway."""
MOST_KINDS = 8
"""Kinds of questions of one browser that wait at a time."""


@dataclass(frozen=True)
class Shown:
    """A moment of a page: the head of its message, and the picture, which is sent again only when it is another."""

    head: Mapping[str, Any]
    view: FrameView | None


class Desk(Protocol):
    """Who answers a browser."""

    def client_of(self, number: int, key: str) -> Any | None:
        """viser's client of that number, if the key is the one that its page was given."""

    def arrived(self, link: Link) -> None:
        """A browser has said who it is."""

    def left(self, link: Link) -> None:
        """A browser has gone."""

    def drawn(self, link: Link, frame: int) -> None:
        """A browser has drawn the picture of a frame."""

    def asked(self, link: Link, message: Mapping[str, Any]) -> bytes | None:
        """What a browser asks for; called in a thread."""


class Link:
    """The line to one browser. client: viser's, None until the browser has said who it is."""

    def __init__(self, connection: Any, desk: Desk) -> None:
        self._connection, self._desk = connection, desk
        self._loop = asyncio.get_running_loop()
        self._wake, self._free = asyncio.Event(), asyncio.Event()
        self._free.set()
        self._next: Shown | None = None
        self._pictured: FrameView | None = None
        self._drawing: int | None = None
        self._pending: set[asyncio.Task[None]] = set()
        self._wishes: dict[str, Mapping[str, Any]] = {}
        self._granting = False
        self.client: Any | None = None
        self.hello: Mapping[str, Any] = {}

    def offer(self, shown: Shown) -> None:
        """Show this next, in place of what has not been sent yet. From any thread."""
        self._next = shown
        self._soon(self._wake.set)

    def send(self, message: bytes) -> None:
        """Send a message. From any thread."""
        self._soon(lambda: self._start(self._send(message)))

    def _soon(self, action: Callable[[], Any]) -> None:
        try:
            self._loop.call_soon_threadsafe(action)
        except RuntimeError:
            LOG.debug("the server has stopped")

    async def run(self) -> None:
        """Until the browser goes."""
        sender = asyncio.create_task(self._send_moments())
        try:
            async for text in self._connection:
                if not isinstance(text, str) or len(text) > LONGEST_MESSAGE:
                    await self._connection.close(1009, "too long")
                    return
                self._hear(text)
        except ConnectionClosed:
            pass
        finally:
            sender.cancel()
            for task in self._pending:
                task.cancel()
            self._desk.left(self)

    def _hear(self, text: str) -> None:
        try:
            message = json.loads(text)
        except (ValueError, RecursionError):
            return
        if not isinstance(message, dict):
            return
        if message.get("t") == "shown":
            self._free.set()
            if self._drawing is not None:
                self._desk.drawn(self, self._drawing)
        elif message.get("t") == "hello":
            number, key = message.get("client"), message.get("key")
            if isinstance(number, int) and isinstance(key, str):
                self.client = self._desk.client_of(number, key)
            self.hello = message
            self._start(asyncio.to_thread(self._desk.arrived, self))
        elif isinstance(message.get("t"), str) and (
            message["t"] in self._wishes or len(self._wishes) < MOST_KINDS
        ):
            # Of each kind the latest wish wins: who floods the line makes nobody wait.
            self._wishes[message["t"]] = message
            if not self._granting:
                self._granting = True
                self._start(self._grant())

    def _start(self, coroutine: Any) -> None:
        task = self._loop.create_task(coroutine)
        self._pending.add(task)
        task.add_done_callback(self._pending.discard)

    async def _grant(self) -> None:
        """Answer what is wished for, one at a time."""
        try:
            while self._wishes:
                message = self._wishes.pop(next(iter(self._wishes)))
                answer = await asyncio.to_thread(self._desk.asked, self, message)
                if answer is not None:
                    await self._send(answer)
        finally:
            self._granting = False

    async def _send(self, message: bytes) -> None:
        try:
            await self._connection.send(message)
        except ConnectionClosed:
            LOG.debug("gone before it was told")

    async def _send_moments(self) -> None:
        while True:
            await self._wake.wait()
            self._wake.clear()
            try:
                await asyncio.wait_for(self._free.wait(), PATIENCE_S)
            except TimeoutError:
                LOG.debug("a browser does not say that it has shown a picture")
            shown = self._next
            if shown is None:
                continue
            head, parts = dict(shown.head), []
            self._drawing = None if shown.view is None else shown.view.index
            if shown.view is not None and shown.view is not self._pictured:
                self._pictured = shown.view
                head["picture"] = picture_head(shown.view)
                parts = [shown.view.jpeg, shown.view.sheet]
            self._free.clear()
            await self._send(packed(head, *parts))


class Links:
    """The lines to all browsers."""

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self._lock = threading.Lock()
        self._links: set[Link] = set()

    async def talk(self, connection: Any) -> None:
        """Speak with a browser until it goes."""
        link = Link(connection, self._desk)
        with self._lock:
            self._links.add(link)
        try:
            await link.run()
        finally:
            with self._lock:
                self._links.discard(link)

    def all(self) -> list[Link]:
        """The lines that are open."""
        with self._lock:
            return list(self._links)
