"""A viser server for one machine: bound to one address, foreign pages refused, never shared to the internet.

viser 1.1 accepts any WebSocket Origin and lets any browser request a public tunnel. The check of Host and Origin is
put in front of viser's own request handler while the server starts.
"""

from __future__ import annotations

import http
import ipaddress
import logging
import secrets
import socket
from typing import Any
from urllib.parse import parse_qs, urlsplit

import viser
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from stereocalib_app.server.inputs import guard
from stereocalib_app.server.site import Site
from stereocalib_app.server.viser_internals import behind, silent
from stereocalib_core.errors import ConfigError

LOG = logging.getLogger(__name__)
LOCAL_NAMES = frozenset({"127.0.0.1", "localhost", "::1"})


def allowed_names(host: str) -> frozenset[str]:
    """Host names under which a server bound to `host` may be addressed."""
    if host in LOCAL_NAMES:
        return LOCAL_NAMES
    own = {socket.gethostname().lower(), socket.getfqdn().lower(), host.lower()}
    return LOCAL_NAMES | own


def _split(netloc: str, usual_port: int = 80) -> tuple[str, int]:
    try:
        parts = urlsplit(f"//{netloc}")
        return (parts.hostname or "").lower(), parts.port or usual_port
    except ValueError:
        return "", 0


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def request_allowed(headers: Any, names: frozenset[str], any_address: bool) -> bool:
    """Whether a request may pass: its Host is one of ours, a WebSocket comes from a page of that very Host.

    `any_address` also lets numeric hosts pass, for a server bound to every interface: a name that an attacker points
    at this machine stays refused.
    """
    host, port = _split(headers.get("Host", ""))
    if not (host in names or (any_address and _is_address(host))):
        return False
    if headers.get("Upgrade", "").lower() != "websocket":
        return True
    origin = urlsplit(headers.get("Origin", ""))
    # A browser leaves out the port that is usual for the scheme, in both.
    usual = {"http": 80, "https": 443}.get(origin.scheme)
    if usual is None:
        return False
    return _split(origin.netloc, usual) == _split(headers.get("Host", ""), usual)


class Gate:
    """Lets requests in or not: by Host and Origin, and by a token where there is one.

    Who brings the token in the address is given a cookie that says so from then on.
    """

    def __init__(self, host: str, token: str | None = None) -> None:
        self._names, self._any_address = allowed_names(host), host not in LOCAL_NAMES
        self.token = token

    def refusal(self, request: Request) -> Response | None:
        """403 and why, or None where the request may pass."""
        if not request_allowed(request.headers, self._names, self._any_address):
            return _answer(http.HTTPStatus.FORBIDDEN, b"foreign page refused\n")
        if self.token is None or self._brought(request) or self._known(request.headers):
            return None
        return _answer(
            http.HTTPStatus.FORBIDDEN,
            b"This page wants its token: open the whole address that was printed.\n",
        )

    def cookie(self, request: Request) -> str | None:
        """The value of Set-Cookie for who has just brought the token."""
        if self.token is None or not self._brought(request):
            return None
        return f"{self._cookie_name(request.headers)}={self.token}; Path=/; HttpOnly; SameSite=Strict"

    def _cookie_name(self, headers: Any) -> str:
        # Browsers do not keep the cookies of two ports apart.
        return f"stereocalib-{_split(headers.get('Host', ''))[1]}"

    def _brought(self, request: Request) -> bool:
        given = parse_qs(urlsplit(request.path).query).get("token", [""])[0]
        return secrets.compare_digest(given.encode(), (self.token or "").encode())

    def _known(self, headers: Any) -> bool:
        name = self._cookie_name(headers)
        for part in headers.get("Cookie", "").split(";"):
            key, _, value = part.strip().partition("=")
            if key == name and secrets.compare_digest(value.encode(), (self.token or "").encode()):
                return True
        return False


def _answer(status: http.HTTPStatus, body: bytes) -> Response:
    headers = Headers({"Content-Type": "text/plain; charset=utf-8", "Content-Length": str(len(body))})
    return Response(status.value, status.phrase, headers, body)


class LocalServer(viser.ViserServer):
    """A viser server that refuses to be shared."""

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Refused: nothing leaves this machine."""
        LOG.warning("a browser asked for a public share tunnel: refused")
        return None


def _check_host(host: str) -> None:
    try:
        family, kind, *_, address = socket.getaddrinfo(host or "?", 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind) as trial:
            trial.bind(address)
    except (OSError, UnicodeError) as error:
        remedy = "use 127.0.0.1, an address of this machine, or 0.0.0.0 for all of them"
        raise ConfigError("no host to listen on", host[:80], remedy) from error


def create_server(host: str, port: int, token: str | None = None, site: Site | None = None) -> LocalServer:
    """Start a server; a busy port becomes the next free one (see `get_port()`). token: what browsers must bring.

    Raises ConfigError for a host that is not this machine's: viser would try its ports for ever.
    """
    _check_host(host)
    # Browsers open connections ahead and drop them unused; a traceback for each is no news for anybody.
    logging.getLogger("websockets.server").setLevel(logging.CRITICAL)
    with behind(Guarded(Gate(host, token), site or Site())):
        server = LocalServer(host=host, port=port, label="stereocalib", verbose=False)
    guard(server.gui)
    # Lines and points reflect nothing, and without a graphics card a browser takes a second to prepare what they
    # would; before.js keeps it from beginning.
    server.scene.configure_environment_map(None)
    return server


class Guarded:
    """The gate, and behind it our own pages; then viser."""

    def __init__(self, gate: Gate, site: Site) -> None:
        self._gate, self._site = gate, site

    async def answer(self, request: Request) -> Response | None:
        """Refused, ours, or None."""
        refusal = self._gate.refusal(request)
        if refusal is not None or request.headers.get("Upgrade", "").lower() == "websocket":
            return refusal
        answer = await self._site.answer(request)
        cookie = self._gate.cookie(request)
        if answer is not None and cookie is not None:
            answer.headers["Set-Cookie"] = cookie
        return answer

    def talks(self, path: str) -> bool:
        """Whether a WebSocket is ours."""
        return self._site.talks(path)

    async def talk(self, connection: Any) -> None:
        """Speak with a browser."""
        await self._site.talk(connection)


def stop_server(server: viser.ViserServer) -> None:
    """Stop it without viser's farewell on the terminal."""
    with silent():
        server.stop()
