"""Several browsers at once, without browsers: raw WebSocket clients."""

from __future__ import annotations

import threading
import time
from typing import Any

import numpy as np
import psutil
import pytest
from conftest import until
from stereocalib_app.benches.raw_client import LinkClient, RawClient, Received, frames_in
from stereocalib_app.server.hub import Hub
from stereocalib_app.server.viser_internals import identifier


def connect(hub: Hub) -> tuple[RawClient, Any]:
    """A client that has said where its camera is, which makes it a browser for viser."""
    before = set(hub.server.get_clients())
    client = RawClient(hub.server.get_port())
    client.say_hello()
    number = until(lambda: set(hub.server.get_clients()) - before, what="client connected").pop()
    return client, hub.server.get_clients()[number]


def test_playback_sends_consistent_frames(fresh: Hub) -> None:
    """A message names one frame and brings its picture; the rate itself is a matter of the bench."""
    playback = fresh.shared.playback
    look = fresh.shared._look(0, fresh.shared.settings)
    for frame in range(playback.total):
        fresh.shared.session.views.get(frame, look, moving=True)
    client, line = RawClient(fresh.server.get_port()), LinkClient(fresh.server.get_port())
    client.listen(1.0)
    playback.set_loop(True)
    playback.play()
    windows: list[list[Received]] = []
    reader = threading.Thread(target=lambda: windows.extend(client.listen(4.0)))
    reader.start()
    told = [m for m in line.listen(4.0) if m.head["t"] == "now"]
    reader.join()
    playback.play(False)
    changes = [b for a, b in zip(told, told[1:], strict=False) if a.head["frame"] != b.head["frame"]]
    assert len(changes) >= 12
    assert all(change.pictured for change in changes)
    assert all(change.body[:2] == b"\xff\xd8" for change in changes)
    sliders = [
        (m.fields["updates"]["value"], frame)
        for window in windows
        for _, frame in frames_in([window])
        for m in window
        if m.kind == "GuiUpdateMessage"
        and m.fields["uuid"] == identifier(fresh.shared.parts["Time line"]._slider)
    ]
    assert sliders
    assert all(value == frame for value, frame in sliders)
    client.close()
    line.close()


def test_scrubbing_shows_everything_within_half_a_second(fresh: Hub) -> None:
    rng = np.random.default_rng(1)
    times = []
    for frame in rng.permutation(fresh.shared.playback.total)[:12]:
        begin = time.monotonic()
        fresh.shared.playback.seek(int(frame))
        until(lambda frame=frame: fresh.shared.shown_frame == frame, what="frame shown")
        times.append(time.monotonic() - begin)
    assert np.median(times) < 0.5


def test_a_slow_browser_slows_nobody(fresh: Hub) -> None:
    port = fresh.server.get_port()
    slow, quick = LinkClient(port), LinkClient(port)
    quick.listen(1.0)
    fresh.shared.playback.set_loop(True)
    fresh.shared.playback.play()
    shown = {told.head["frame"] for told in quick.listen(4.0) if told.pictured}
    fresh.shared.playback.play(False)
    assert len(shown) >= 8
    slow.close()
    quick.close()


def test_twenty_browsers_half_of_them_on_their_own(fresh: Hub, monkeypatch: pytest.MonkeyPatch) -> None:
    raised: list[Any] = []
    monkeypatch.setattr(threading, "excepthook", raised.append)
    clients = [connect(fresh) for _ in range(20)]
    stop = threading.Event()

    def drain(client: RawClient) -> None:
        while not stop.is_set():
            client.receive(0.2)

    readers = [threading.Thread(target=drain, args=(client,), daemon=True) for client, _ in clients]
    for reader in readers:
        reader.start()
    for _, handle in clients[:10]:
        fresh.detach(handle)
    assert fresh.count() == (20, 10)
    pages = list(fresh._own.values())
    memory = psutil.Process().memory_info().rss
    rng = np.random.default_rng(2)
    fresh.shared.playback.seek(4)
    for _ in range(3):
        wanted = {page: int(rng.integers(fresh.shared.playback.total)) for page in pages}
        for page, frame in wanted.items():
            page.playback.seek(frame)
        until(lambda w=wanted: all(p.shown_frame == f for p, f in w.items()), 60.0, "own frames")
    assert fresh.shared.shown_frame == 4
    assert psutil.Process().memory_info().rss - memory < 250e6
    stop.set()
    for reader in readers:
        reader.join()
    for client, _ in clients:
        client.close()
    until(lambda: fresh.count() == (0, 0), 30.0, "all gone")
    assert raised == []
