"""Only pages of this server may connect, and nothing is shared."""

from __future__ import annotations

import socket
import urllib.error
import urllib.request
from collections.abc import Iterator

import pytest
import viser._messages
from conftest import until
from stereocalib_app.benches.raw_client import LinkClient, RawClient
from stereocalib_app.server.hub import Hub
from stereocalib_app.server.security import (
    LocalServer,
    allowed_names,
    create_server,
    request_allowed,
    stop_server,
)
from stereocalib_app.server.site import WEB
from websockets.exceptions import ConnectionClosed, InvalidStatus

from stereocalib_core.errors import ConfigError


@pytest.fixture(scope="module")
def server() -> Iterator[LocalServer]:
    running = create_server("127.0.0.1", 0)
    yield running
    stop_server(running)


@pytest.mark.parametrize(
    "origin",
    [
        "http://evil.example",
        "http://127.0.0.1.evil.example:{port}",
        "http://localhost:1",
        "http://localhost:{port}",
        "https://localhost.evil.example",
        "null",
        "file://",
        None,
    ],
)
def test_foreign_look_alike_and_missing_origins_are_refused(server: LocalServer, origin: str | None) -> None:
    with pytest.raises(InvalidStatus) as refused:
        RawClient(server.get_port(), None if origin is None else origin.format(port=server.get_port()))
    assert refused.value.response.status_code == 403


@pytest.mark.parametrize("name", ["127.0.0.1", "localhost"])
def test_own_pages_connect(server: LocalServer, name: str) -> None:
    client = RawClient(server.get_port(), host=name)
    assert client.receive(5.0)
    client.close()


def test_a_name_that_somebody_pointed_at_this_machine_is_refused(server: LocalServer) -> None:
    request = urllib.request.Request(
        f"http://127.0.0.1:{server.get_port()}/", headers={"Host": f"evil.example:{server.get_port()}"}
    )
    with pytest.raises(urllib.error.HTTPError) as refused:
        urllib.request.urlopen(request, timeout=5)
    assert refused.value.code == 403


def test_listens_on_this_machine_only(server: LocalServer) -> None:
    addresses = {info[4][0] for info in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)}
    for address in addresses - {"127.0.0.1"}:
        if str(address).startswith("127."):
            continue
        with pytest.raises(OSError, match="refused|unreachable|timed out"):
            socket.create_connection((str(address), server.get_port()), timeout=1).close()


def test_a_share_request_makes_no_tunnel(server: LocalServer, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_tunnel(*_args: object, **_kwargs: object) -> None:
        raise AssertionError("a tunnel was started")

    monkeypatch.setattr("viser._viser.ViserTunnel", no_tunnel)
    assert server.request_share_url() is None
    handlers = server._websock_server._incoming_handlers[viser._messages.ShareUrlRequest]
    for handler in handlers:
        handler(0, viser._messages.ShareUrlRequest())
    assert server._share_tunnel is None


def test_other_interfaces_take_numeric_hosts_but_no_foreign_names() -> None:
    names = allowed_names("0.0.0.0")
    page = {"Host": "192.168.1.7:8080", "Upgrade": "websocket", "Origin": "http://192.168.1.7:8080"}
    assert request_allowed(page, names, any_address=True)
    assert not request_allowed({**page, "Origin": "http://192.168.1.8:8080"}, names, any_address=True)
    assert not request_allowed({**page, "Origin": "http://127.0.0.1:8080"}, names, any_address=True)
    behind_tls = {"Host": "192.168.1.7", "Upgrade": "websocket", "Origin": "https://192.168.1.7"}
    assert request_allowed(behind_tls, names, any_address=True)
    assert not request_allowed({**page, "Origin": "http://192.168.1.7:9"}, names, any_address=True)
    assert not request_allowed({**page, "Host": "evil.example:8080"}, names, any_address=True)
    assert not request_allowed(page, allowed_names("127.0.0.1"), any_address=False)


def test_start_prints_nothing_of_its_own(capsys: pytest.CaptureFixture[str]) -> None:
    running = create_server("127.0.0.1", 0)
    stop_server(running)
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize("host", ["999.1.1.1", "203.0.113.7", "", "a" * 300])
def test_a_host_that_is_not_this_machine_is_bad_usage(host: str) -> None:
    with pytest.raises(ConfigError, match="no host to listen on"):
        create_server(host, 0)


OWN = sorted(path.name for path in WEB.iterdir())


@pytest.mark.parametrize("name", OWN)
def test_our_own_files_are_served_to_our_own_pages_alone(server: LocalServer, name: str) -> None:
    address = f"http://127.0.0.1:{server.get_port()}/own/{name}"
    with urllib.request.urlopen(address, timeout=5) as answer:
        assert answer.status == 200
        assert answer.headers["X-Content-Type-Options"] == "nosniff"
        assert len(answer.read()) > 100
    with pytest.raises(urllib.error.HTTPError) as refused:
        urllib.request.urlopen(urllib.request.Request(address, headers={"Host": "evil.example"}), timeout=5)
    assert refused.value.code == 403


def test_a_thumbnail_is_for_our_own_pages_alone(fresh: Hub) -> None:
    address = f"http://127.0.0.1:{fresh.server.get_port()}/own/thumb?path=kitti_odometry/sequences/06"
    with urllib.request.urlopen(address, timeout=20) as answer:
        assert answer.read()[:2] == b"\xff\xd8"
    for outside in ("..", "/etc", "kitti_odometry/../../..", "no%00such"):
        with pytest.raises(urllib.error.HTTPError) as refused:
            urllib.request.urlopen(address.partition("path=")[0] + "path=" + outside, timeout=20)
        assert refused.value.code == 404
    with pytest.raises(urllib.error.HTTPError) as refused:
        urllib.request.urlopen(urllib.request.Request(address, headers={"Host": "evil.example"}), timeout=5)
    assert refused.value.code == 403


@pytest.mark.parametrize("path", ["own/../security.py", "own/%2e%2e/server/site.py", "own/", "own/no<b>such"])
def test_nothing_else_lies_below_our_own_path(server: LocalServer, path: str) -> None:
    with pytest.raises(urllib.error.HTTPError) as refused:
        urllib.request.urlopen(f"http://127.0.0.1:{server.get_port()}/{path}", timeout=5)
    assert refused.value.code == 404


@pytest.mark.parametrize("origin", ["http://evil.example", "http://localhost:1", "null", None])
def test_our_own_line_refuses_foreign_origins(fresh: Hub, origin: str | None) -> None:
    with pytest.raises(InvalidStatus) as refused:
        LinkClient(fresh.server.get_port(), origin=origin)
    assert refused.value.response.status_code == 403


def test_hostile_words_on_our_own_line_stop_nothing(fresh: Hub, capfd: pytest.CaptureFixture[str]) -> None:
    line = LinkClient(fresh.server.get_port())
    nonsense: list[object] = [None, True, -5, 1e400, "x" * 3000, [1], {"a": 1}, float("nan")]
    for kind in ("seek", "stage", "signals", "disparity", "hello", "no such", None):
        for value in nonsense:
            line.say(
                {"t": kind, "frame": value, "name": value, "names": value, "client": value, "key": value}
            )
    line.say({"t": "hello", "client": 0, "key": "guessed", "state": {"at": 7, "set": ["preset=Debug"]}})
    line._socket.send("[" * 9000)
    line.say({"t": "seek", "frame": 7})
    until(lambda: fresh.shared.shown_frame == 7, what="still alive")
    assert fresh.shared.settings.preset == "Inspect"
    line._socket.send("x" * 50_000)
    with pytest.raises(ConnectionClosed):
        for _ in range(200):
            line._socket.recv(timeout=5)
    assert "Traceback" not in capfd.readouterr().err


def test_a_page_beyond_this_machine_wants_its_token() -> None:
    running = create_server("127.0.0.1", 0, token="s3cret")
    address = f"http://127.0.0.1:{running.get_port()}/"

    def status(path: str = "", cookie: str = "") -> tuple[int, str]:
        request = urllib.request.Request(
            address + path, headers={"Cookie": cookie, "Accept-Encoding": "gzip"}
        )
        try:
            with urllib.request.urlopen(request, timeout=5) as answer:
                return answer.status, answer.headers.get("Set-Cookie") or ""
        except urllib.error.HTTPError as error:
            return error.code, ""

    try:
        assert status() == (403, "")
        assert status("?token=guessed") == (403, "")
        assert status("own/own.js")[0] == 403
        code, cookie = status("?token=s3cret")
        assert code == 200
        assert "HttpOnly" in cookie
        assert "SameSite=Strict" in cookie
        kept = cookie.partition(";")[0]
        assert status("", kept)[0] == 200
        assert status("own/own.js", kept)[0] == 200
        assert status("", kept + "x")[0] == 403
        with pytest.raises(InvalidStatus):
            RawClient(running.get_port())
    finally:
        stop_server(running)
