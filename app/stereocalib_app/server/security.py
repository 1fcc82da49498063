"""A viser server for one machine: bound to one address, foreign pages refused, never shared to the internet.

viser 1.1 accepts any WebSocket Origin and lets any browser request a public tunnel. The check of Host and Origin is
put in front of viser's own request handler while the server starts.
"""

from __future__ import annotations

import ipaddress
import logging
import socket
from typing import Any
from urllib.parse import urlsplit

import viser

from stereocalib_app.server.inputs import guard
from stereocalib_app.server.viser_internals import requests_checked, silent
from stereocalib_core.errors import ConfigError

LOG = logging.getLogger(__name__)
LOCAL_NAMES = frozenset({"127.0.0.1", "localhost", "::1"})


def allowed_names(host: str) -> frozenset[str]:
    """Host names under which a server bound to `host` may be addressed."""
    if host in LOCAL_NAMES:
        return LOCAL_NAMES
    own = {socket.gethostname().lower(), socket.getfqdn().lower(), host.lower()}
    return LOCAL_NAMES | own


def _split(netloc: str) -> tuple[str, int]:
    try:
        parts = urlsplit(f"//{netloc}")
        return (parts.hostname or "").lower(), parts.port or 80
    except ValueError:
        return "", 0


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def request_allowed(headers: Any, names: frozenset[str], any_address: bool) -> bool:
    """Whether a request may pass: its Host is one of ours, a WebSocket comes from a page of the same port.

    `any_address` also lets numeric addresses pass, for a server bound to every interface: a name that an
    attacker points at this machine stays refused.
    """
    host, port = _split(headers.get("Host", ""))

    def known(name: str) -> bool:
        return name in names or (any_address and _is_address(name))

    if not known(host):
        return False
    if headers.get("Upgrade", "").lower() != "websocket":
        return True
    origin = urlsplit(headers.get("Origin", ""))
    origin_host, origin_port = _split(origin.netloc)
    return origin.scheme in {"http", "https"} and known(origin_host) and origin_port == port


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


def create_server(host: str, port: int) -> LocalServer:
    """Start a server; a busy port becomes the next free one (see `get_port()`).

    Raises ConfigError for a host that is not this machine's: viser would try its ports for ever.
    """
    _check_host(host)
    # Browsers open connections ahead and drop them unused; a traceback for each is no news for anybody.
    logging.getLogger("websockets.server").setLevel(logging.CRITICAL)
    names, any_address = allowed_names(host), host not in LOCAL_NAMES
    with requests_checked(lambda headers: request_allowed(headers, names, any_address)):
        server = LocalServer(host=host, port=port, label="stereocalib", verbose=False)
    guard(server.gui)
    return server


def stop_server(server: viser.ViserServer) -> None:
    """Stop it without viser's farewell on the terminal."""
    with silent():
        server.stop()
