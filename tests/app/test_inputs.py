"""Messages that no page could have sent change nothing and stop nothing."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest
from conftest import until
from stereocalib_app.benches.page import Watcher, consistent
from stereocalib_app.drive.settings import Settings
from stereocalib_app.server.clock import ClockState, Playback
from stereocalib_app.server.hub import Hub
from stereocalib_app.server.inputs import acceptable
from stereocalib_app.server.security import create_server, stop_server

HOSTILE: tuple[Any, ...] = (
    *(float("nan"), float("inf"), -1e300, 1e300, -5, 2**63, "no such option", "x" * 5000, None),
    *([], {"a": 1}, {"value": 1}, [[1]], b"\x00\xff"),
)
CONTROLS = (
    *("Frame", "play", "Speed", "Loop", "Pause on failure", "Show", "View", "Step", "Failures", "Shifts"),
    *(
        "yaw used %",
        "pitch added °",
        "height added m",
        "Extrinsics",
        "Motion",
        "Follow the car",
        "Point cloud",
    ),
    *("Source", "Run", "Explore on my own", "Only I lead", "Light theme"),
)


def test_only_values_that_a_person_can_set_pass() -> None:
    server = create_server("127.0.0.1", 0)
    gui = server.gui
    slider, number = gui.add_slider("s", 0, 10, 1, 5), gui.add_number("n", 0.5)
    box, words = gui.add_checkbox("c", False), gui.add_text("t", "")
    choice, buttons = gui.add_dropdown("d", ("a", "b")), gui.add_button_group("g", ("x", "y"))
    stop_server(server)
    assert all(acceptable(slider, v) for v in (0, 10, 3.0))
    assert not any(acceptable(slider, v) for v in (-1, 11, float("nan"), True, "3", None))
    assert acceptable(number, -7)
    assert not any(acceptable(number, v) for v in (float("inf"), "", []))
    assert acceptable(box, True)
    assert not any(acceptable(box, v) for v in (1, "True", None))
    assert acceptable(words, "synthetic:town")
    assert not any(acceptable(words, v) for v in ("x" * 5000, 5, b"x"))
    assert acceptable(choice, "b")
    assert acceptable(buttons, "y")
    assert not any(acceptable(handle, v) for handle in (choice, buttons) for v in ("z", 0, None))


def test_hostile_messages_stop_nothing(fresh: Hub, capfd: pytest.CaptureFixture[str]) -> None:
    port = fresh.server.get_port()
    evil = Watcher(port)
    for label in CONTROLS:
        uuid = evil.controls[label]["uuid"]
        for value in HOSTILE:
            evil.client.send_update(uuid, {"value": value})
        for updates in ({}, {"label": "<b>"}, {"visible": False}, {"value": 1, "disabled": True}, {"zzz": 1}):
            evil.client.send_update(uuid, updates)
    evil.client.send_update("no such control", {"value": 1})
    evil.listen(1.0)
    assert fresh.shared.settings == Settings()
    assert fresh.shared.playback.state == ClockState()
    student = Watcher(port)
    student.set("Frame", 7)
    student.until(lambda window: consistent(window, 7, student.controls["Frame"]["uuid"]))
    for watcher in (evil, student):
        watcher.client.close()
    assert "Traceback" not in capfd.readouterr().err


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_the_page_outlives_an_error_in_showing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stereocalib_app.server.clock.AFTER_ERROR_S", 0.05)
    shown: list[int] = []

    def show(state: ClockState) -> None:
        shown.append(state.frame)
        if state.frame == 3:
            raise KeyError("a picture that cannot be shown")

    playback = Playback(np.arange(10) * 0.1, lambda: 10, lambda: np.zeros(0, np.int64), show)
    playback.start()
    playback.seek(3)
    until(lambda: 3 in shown, what="error")
    time.sleep(0.1)
    playback.seek(5)
    until(lambda: 5 in shown, what="life after it")
    playback.close()
