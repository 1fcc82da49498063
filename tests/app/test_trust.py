"""Nothing exhausts the page's server, and nobody is in another's way."""

from __future__ import annotations

import asyncio
import io
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
from conftest import shown_frame, start_page, stop_page, tab, text_entry, until
from stereocalib_app.benches.raw_client import RawClient
from stereocalib_app.drive.earlier_run import open_run
from stereocalib_app.server import inputs, library
from stereocalib_app.server.hub import Hub
from stereocalib_app.server.inputs import UPLOAD_BYTES
from stereocalib_app.server.library import Library, unpack

from stereocalib_core.config import PipelineConfig
from stereocalib_core.errors import SourceError
from stereocalib_core.run.synth import synth


def free_port() -> int:
    with socket.socket() as trial:
        trial.bind(("127.0.0.1", 0))
        return int(trial.getsockname()[1])


def uploads() -> set[Path]:
    return set(Path(tempfile.gettempdir()).glob("stereocalib-upload-*"))


@pytest.fixture(scope="module")
def archive(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A drive of three frames, with 90 MB of zeros beside it that no drive needs."""
    folder = tmp_path_factory.mktemp("zip")
    synth(folder / "drive", "plane", {"frames": "3"}, [], None)
    (folder / "drive" / "zeros.dat").write_bytes(bytes(90_000_000))
    return Path(shutil.make_archive(str(folder / "mine"), "zip", folder / "drive")).read_bytes()


@pytest.fixture
def hub(tmp_path: Path) -> Iterator[Hub]:
    running = start_page("synthetic:plane?frames=3", tmp_path)
    assert running.shared.session.wait(120.0)
    yield running
    stop_page(running)


def test_two_who_open_at_once_get_one_page(hub: Hub) -> None:
    """Each as from a double click: the page that was there when they asked is gone for the second."""
    before = hub.shared
    first_is_open, go_on = threading.Event(), threading.Event()
    opened = hub.library.open

    def slow(text: str) -> object:
        session = opened(text)
        if "frames=4" in text:
            first_is_open.set()
            go_on.wait(20.0)
        return session

    hub.library.open = slow  # type: ignore[method-assign, assignment]
    one = threading.Thread(target=hub.open, args=(before, "synthetic:plane?frames=4"))
    one.start()
    assert first_is_open.wait(60.0)
    hub.open(before, "synthetic:plane?frames=5")
    last = hub.shared
    go_on.set()
    one.join(30.0)
    assert hub.shared is last
    assert hub.shared.playback.total == 5
    until(lambda: not before.playback._thread.is_alive(), what="the old page's clock at rest")
    assert len(hub._sessions) == 1
    hub.open(before, "synthetic:plane?frames=2")
    assert hub.shared.playback.total == 2
    until(lambda: not last.playback._thread.is_alive(), what="one page, one clock")


def upload_button(client: RawClient) -> str:
    """The name of the page's button for uploads."""
    found: list[str] = []

    def heard() -> bool:
        found.extend(
            m.fields["uuid"]
            for m in client.receive(1.0)
            if (m.fields.get("props") or {}).get("label") == "Upload a zip"
        )
        return bool(found)

    until(heard, what="the button")
    return found[0]


@pytest.mark.browser
def test_double_clicks_and_two_browsers_open_one_page(hub: Hub, open_page: Any, tmp_path: Path) -> None:
    """Real clicks: a double click, then two browsers at once. One set of panels, one clock, and the later wish."""
    for name, frames in (("one", "4"), ("two", "5")):
        synth(tmp_path / name, "plane", {"frames": frames}, [], None)
    pages = [open_page(hub), open_page(hub)]
    tab(pages[0], "Open")
    entry = text_entry(pages[0], "Source")
    entry.fill("synthetic:plane?frames=6")
    entry.press("Tab")
    before = hub.shared
    pages[0].get_by_role("button", name="Open", exact=True).dblclick()
    until(lambda: hub.shared is not before and hub.shared.playback.total == 6, what="opened")
    until(lambda: len(hub._sessions) == 1, what="one drive")
    order: list[str] = []
    done: list[str] = []
    asked, show = hub.library.open, hub._show

    def heard(text: str) -> object:
        order.append(text)
        return asked(text)

    def shown(*given: Any, **named: Any) -> None:
        show(*given, **named)
        done.append("a wish")

    hub.library.open = heard  # type: ignore[method-assign, assignment]
    hub._show = shown  # type: ignore[method-assign]
    between = hub.shared
    for page, name in zip(pages, ("one", "two"), strict=True):
        tab(page, "Open")
        page.locator(".sc-shelf button", has_text=f"{name}/").first.wait_for()
    for page, name in zip(pages, ("one", "two"), strict=True):
        page.locator(".sc-shelf button", has_text=f"{name}/").first.evaluate("b => { b.click(); b.click(); }")
    until(
        lambda: {wish.split("/")[0] for wish in order} == {"one", "two"},
        what="both asked, whatever is replaced",
    )
    until(
        lambda: len(done) == len(order) and not any(link._granting for link in hub.desk.links.all()),
        what="nothing is left to be done",
    )
    until(lambda: hub.shared is not between and hub.shared.playback.total in (4, 5), what="opened")
    until(
        lambda: hub.shared.playback.total == (4 if order[-1].startswith("one") else 5), what="the later wish"
    )
    until(lambda: len(hub._sessions) == 1, what="one drive")
    for page in pages:
        for part in ("stereocalib-timeline", "stereocalib-picture"):
            until(lambda page=page, part=part: page.locator(part).count() == 1, what=f"one {part}")
        until(lambda page=page: shown_frame(page) >= 0, what="a page that lives")
    for gone in (before, between):
        until(lambda gone=gone: not gone.playback._thread.is_alive(), what="no clock of a page that is gone")
    hub.shared.playback.play(False)
    hub.shared.playback.seek(1)
    for page in pages:
        until(lambda page=page: shown_frame(page) == 1, what="the panels that are there follow it")
    tab(pages[0], "Time line")
    pages[0].get_by_role("button", name="step ▶").click()
    until(lambda: hub.shared.playback.state.frame == 2, what="and steer it")


def test_a_line_that_breaks_is_up_again_with_the_same_browser(hub: Hub, open_page: Any) -> None:
    """Whoever asks for something meanwhile is heard, and followers stay followers."""
    page = open_page(hub)
    until(lambda: any(link.client is not None for link in hub.desk.links.all()), what="it says who it is")
    broken = next(link for link in hub.desk.links.all() if link.client is not None)
    client = broken.client
    hub.shared.playback.play(False)
    hub.shared.playback.seek(0)
    asyncio.run_coroutine_threadsafe(broken._connection.close(), broken._loop).result(30.0)
    tab(page, "Time line")
    page.get_by_role("button", name="step ▶").click()
    until(lambda: hub.shared.playback.state.frame == 1, what="the step is heard")
    until(lambda: [link.client for link in hub.desk.links.all()] == [client], what="it says who it is again")


def test_an_upload_that_stops_half_way_is_dropped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    name = "idle"
    monkeypatch.setattr(inputs, "IDLE_UPLOAD_S", 0.5)
    running = start_page("synthetic:plane?frames=3", tmp_path)
    client = RawClient(running.server.get_port())
    client.say_hello()
    button = upload_button(client)
    client._socket.send(
        msgspec.msgpack.encode(
            {"type": "FileTransferStartUpload", "source_component_uuid": button, "transfer_uuid": name,
             "filename": "x.zip", "mime_type": "application/zip", "part_count": 2, "size_bytes": 10}
        )
    )  # fmt: skip
    held = running.server.gui._current_file_upload_states
    until(lambda: name in held, what="taken")
    until(lambda: not held, what="dropped, though no other begins")
    client.close()
    stop_page(running)


def test_a_clock_whose_page_is_gone_ends(hub: Hub) -> None:
    page = hub.shared
    page._closed = True
    page.playback.play()
    until(lambda: not page.playback._thread.is_alive(), 20.0, "clock at rest")


def test_an_announced_upload_that_is_too_large_is_refused_at_once(hub: Hub) -> None:
    client = RawClient(hub.server.get_port())
    client.say_hello()
    button = upload_button(client)

    def announce(name: str, size: int, parts: int) -> None:
        client._socket.send(
            msgspec.msgpack.encode(
                {"type": "FileTransferStartUpload", "source_component_uuid": button, "transfer_uuid": name,
                 "filename": "x.zip", "mime_type": "application/zip", "part_count": parts, "size_bytes": size}
            )
        )  # fmt: skip

    def part(name: str, index: int, content: bytes) -> None:
        client._socket.send(
            msgspec.msgpack.encode(
                {"type": "FileTransferPart", "source_component_uuid": button, "transfer_uuid": name,
                 "part_index": index, "content": content}
            )
        )  # fmt: skip

    held = hub.server.gui._current_file_upload_states
    announce("huge", 10**11, 1000)
    announce("more than it may", UPLOAD_BYTES + 1, 10)
    announce("small", 10, 2)
    until(lambda: "small" in held, what="the small one taken")
    assert set(held) == {"small"}
    part("huge", 0, bytes(100_000))
    part("small", 0, bytes(50))
    until(lambda: not held, what="what brings more than it announced is dropped")
    client.close()


def test_an_upload_leaves_nothing_behind(archive: bytes, tmp_path: Path) -> None:
    before = uploads()
    shelf = Library(tmp_path, PipelineConfig())
    session = shelf.open_upload("mine.zip", archive)
    (folder,) = uploads() - before
    assert not list(folder.rglob("zeros.dat"))
    assert sum(p.stat().st_size for p in folder.rglob("*") if p.is_file()) < 10_000_000
    shelf.forget(session)
    assert uploads() == before
    with pytest.raises(SourceError):
        shelf.open_upload("broken.zip", archive[: len(archive) // 2])
    empty = io.BytesIO()
    with zipfile.ZipFile(empty, "w") as made:
        made.writestr("readme.txt", "no drive")
    with pytest.raises(SourceError, match="no stereo drive"):
        shelf.open_upload("empty.zip", empty.getvalue())
    assert uploads() == before
    session.close()


def test_all_uploads_together_are_capped(
    archive: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = uploads()
    shelf = Library(tmp_path, PipelineConfig())
    monkeypatch.setattr(library, "ALL_UPLOADS_BYTES", len(archive) + 1_200_000)
    first = shelf.open_upload("one.zip", archive)
    with pytest.raises(SourceError, match=r"too many uploads|unpacks to too much"):
        for _ in range(8):
            shelf.open_upload("more.zip", archive)
    shelf.close()
    assert uploads() == before
    first.close()


def test_a_text_that_unpacks_to_too_much_is_refused(tmp_path: Path) -> None:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as made:
        made.writestr("times.txt", "0.1\n" * 40_000_000)
    with pytest.raises(SourceError, match=r"times\.txt of 152 MB"):
        unpack("bomb.zip", buffer.getvalue(), tmp_path / "unpacked")
    assert not (tmp_path / "unpacked").exists()


def test_a_run_opens_its_source_through_the_same_door(hub: Hub, tmp_path: Path) -> None:
    from stereocalib_core.run.drive import run_drive

    outside = tmp_path / "outside"
    synth(outside, "plane", {"frames": "3"}, [], None)
    root = tmp_path / "root"
    root.mkdir()
    run_drive(str(outside / "sequences" / "00"), root / "run")
    assert open_run(root / "run").source[0].left is not None
    session = Library(root, PipelineConfig()).open("run")
    assert session.source[0].left is None
    assert any("outside the folder" in notice for notice in session.source.notices)


def test_sigterm_leaves_no_upload_behind(tmp_path: Path) -> None:
    """As a service manager stops it."""
    code = (
        "import sys, tempfile; from pathlib import Path; from stereocalib_app.drive import serve as s;"
        "from stereocalib_app.server import until_stopped as u; real = u.until_stopped\n"
        "def patched():\n"
        "    folder = Path(tempfile.mkdtemp(prefix='stereocalib-upload-')); print(folder, flush=True)\n"
        "    hubs[0].library._uploads[0] = folder; real()\n"
        "hubs = []; start = s.start\n"
        "def started(*a, **k):\n    hubs.append(start(*a, **k)); return hubs[0]\n"
        "s.start = started; u.until_stopped = patched\n"
        "from stereocalib_app.cli.main import main\n"
        f"sys.argv = ['stereocalib', 'view', 'synthetic:plane?frames=2', '--port', '{free_port()}']; sys.exit(main())\n"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline().startswith("http://")
        folder = Path(process.stdout.readline().strip())
        assert folder.is_dir()
        time.sleep(0.5)
        process.send_signal(signal.SIGTERM)
        assert process.wait(30) == 143
    assert not folder.exists()
