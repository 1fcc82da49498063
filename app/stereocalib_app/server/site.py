"""Our own pages beside viser's: the scripts of the time line and the picture, and what they ask for.

Everything of ours lies below /own/. The page that viser sends is given our script, title and icon on its way.
"""

from __future__ import annotations

import asyncio
import gzip
import http
import mimetypes
from collections.abc import Awaitable, Callable
from functools import cache
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, unquote, urlsplit

from websockets.datastructures import Headers
from websockets.http11 import Request, Response
from websockets.protocol import State

from stereocalib_app.server.viser_internals import client_page

WEB = Path(__file__).resolve().parents[1] / "web"
OWN = "/own/"
LINK = "/own/link"
WAIT_S = 0.03
"""Between two looks whether the drive of a page is open by now."""
TYPES = {".js": "text/javascript; charset=utf-8", ".css": "text/css; charset=utf-8", ".svg": "image/svg+xml"}
BEFORE = "before.js"
"""Stands in the page itself: it has to run before viser's script."""
HEAD = (
    '<link rel="icon" type="image/svg+xml" href="/own/icon.svg" /><link rel="stylesheet" href="/own/own.css" />'
    '<script type="module" src="/own/own.js"></script>'
)
"""What is added to the head of viser's page."""

Content = Callable[[dict[str, str]], Awaitable[tuple[str, bytes] | None]]
"""From the query of a request to (type, bytes), or None where there is nothing."""


@cache
def page_html() -> bytes:
    """viser's page with our script, title and icon, compressed."""
    html = client_page().decode()
    start, end = html.index("<link"), html.index("/>", html.index("<link")) + 2
    html = f"{html[:start]}<script>{(WEB / BEFORE).read_text('utf-8')}</script>{HEAD}{html[end:]}"
    html = html.replace("<title>Viser</title>", "<title>stereocalib</title>", 1)
    return gzip.compress(html.encode(), 1)


@cache
def static_files() -> dict[str, tuple[str, bytes]]:
    """Type and bytes of every file of ours, by its name."""
    found = {}
    for path in sorted(WEB.iterdir()):
        if path.is_file():
            kind = TYPES.get(path.suffix) or mimetypes.guess_type(path.name)[0] or "application/octet-stream"
            found[path.name] = (kind, path.read_bytes())
    return found


class Site:
    """Answers below /own/; `contents` are made when they are asked for.

    line: whether there is a WebSocket of ours, on which a talker speaks as soon as there is one.
    """

    def __init__(self, line: bool = False) -> None:
        self._line = line
        self.contents: dict[str, Content] = {}
        self._talker: Callable[[Any], Awaitable[None]] | None = None

    def open_line(self, talker: Callable[[Any], Awaitable[None]]) -> None:
        """From now on `talker` speaks with browsers; those that called before have waited for it."""
        self._talker = talker

    async def answer(self, request: Request) -> Response | None:
        """What is ours, or None."""
        parts = urlsplit(request.path)
        path = unquote(parts.path)
        if path in ("/", "/index.html") and "gzip" in request.headers.get("Accept-Encoding", ""):
            return respond("text/html; charset=utf-8", page_html(), {"Content-Encoding": "gzip"})
        if not path.startswith(OWN):
            return None
        name = path.removeprefix(OWN)
        found = static_files().get(name)
        if found is None and name in self.contents:
            query = {key: values[0] for key, values in parse_qs(parts.query).items()}
            found = await self.contents[name](query)
        if found is None:
            return respond("text/plain", b"not found\n", status=http.HTTPStatus.NOT_FOUND)
        return respond(*found)

    def talks(self, path: str) -> bool:
        """Whether a WebSocket is ours."""
        return self._line and urlsplit(path).path == LINK

    async def talk(self, connection: Any) -> None:
        """Speak with a browser."""
        while self._talker is None:
            if connection.state is not State.OPEN:
                return
            await asyncio.sleep(WAIT_S)
        await self._talker(connection)


def respond(
    kind: str, body: bytes, more: dict[str, str] | None = None, status: http.HTTPStatus = http.HTTPStatus.OK
) -> Response:
    """A response that browsers take for nothing but what it says it is."""
    headers = {
        "Content-Type": kind,
        "Content-Length": str(len(body)),
        "X-Content-Type-Options": "nosniff",
        "Cache-Control": "no-cache",
        **(more or {}),
    }
    return Response(status.value, status.phrase, Headers(headers), body)
