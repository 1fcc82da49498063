"""What leans on viser's privates, each on a viser of the pinned version; and that it stands in one file only."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import stereocalib_app
from conftest import until
from stereocalib_app.benches.raw_client import RawClient, Received
from stereocalib_app.server import viser_internals
from stereocalib_app.server.security import LocalServer, create_server, stop_server

APP = Path(stereocalib_app.__file__).parent
PRIVATE = re.compile(
    r"viser\._(?!_version__)|_messages\b|\._(?:impl|websock\w*|gui_\w+|next_layout\w*|layout_run_id|format|data)\b"
)


@pytest.fixture(scope="module")
def server() -> Iterator[LocalServer]:
    running = create_server("127.0.0.1", 0)
    yield running
    stop_server(running)


@pytest.fixture
def browser_of(server: LocalServer) -> Iterator[tuple[RawClient, Any]]:
    before = set(server.get_clients())
    client = RawClient(server.get_port())
    client.say_hello()
    number = until(lambda: set(server.get_clients()) - before, what="client").pop()
    yield client, server.get_clients()[number]
    client.close()


def messages(client: RawClient, kind: str) -> list[Received]:
    return [m for window in client.listen(0.8) for m in window if m.kind == kind]


def test_privates_stand_in_one_file() -> None:
    leaning = {
        path.name
        for path in APP.rglob("*.py")
        if PRIVATE.search(re.sub(r'""".*?"""', "", path.read_text(), flags=re.DOTALL))
    }
    assert leaning == {"viser_internals.py"}


def test_a_control_tells_what_it_holds_and_its_name(server: LocalServer) -> None:
    slider, other = server.gui.add_slider("s", 0, 10, 1, 5), server.gui.add_markdown("m")
    assert viser_internals.held_value(slider) == 5
    slider.value = 7
    assert viser_internals.held_value(slider) == 7
    names = viser_internals.identifier(slider), viser_internals.identifier(other)
    assert all(names)
    assert names[0] != names[1]


def test_values_from_browsers_are_checked(server: LocalServer, browser_of: tuple[RawClient, Any]) -> None:
    client, handle = browser_of
    refused: list[int] = []
    gui = handle.gui
    viser_internals.check_values(gui, lambda _control, value: value == "good", refused.append)
    words = gui.add_text("t", "old")
    name = viser_internals.identifier(words)
    client.send_update(name, {"value": "good"})
    until(lambda: words.value == "good", what="taken over")
    client.listen(0.3)
    for updates in ({"value": "bad"}, {"value": "good", "label": "x"}, {"label": "x"}):
        client.send_update(name, updates)
    until(lambda: len(refused) >= 3, what="refused")
    told = [m for m in messages(client, "GuiUpdateMessage") if m.fields["uuid"] == name]
    assert {m.fields["updates"].get("value") for m in told} == {"good"}
    assert words.value == "good"


def test_one_browser_alone_is_told(server: LocalServer, browser_of: tuple[RawClient, Any]) -> None:
    """Elements and nodes hidden, and panels made wider, in one browser and no other."""
    client, handle = browser_of
    other = RawClient(server.get_port())
    other.say_hello()
    note, panel = server.gui.add_markdown("n"), server.gui.add_panel()
    server.scene.add_frame("/lead")
    for each in (client, other):
        each.listen(0.5)
    viser_internals.show_elements(handle, [note], False)
    viser_internals.show_node(handle, "/lead", False)
    viser_internals.set_width(handle, server.gui, panel, 432)
    got = [m for window in client.listen(0.8) for m in window]
    hidden = [m for m in got if m.kind == "GuiUpdateMessage"]
    assert [(m.fields["uuid"], m.fields["updates"]) for m in hidden] == [
        (viser_internals.identifier(note), {"visible": False})
    ]
    nodes = [m for m in got if m.kind == "SetSceneNodeVisibilityMessage"]
    assert [(m.fields["name"], m.fields["visible"]) for m in nodes] == [("/lead", False)]
    widths = [m for m in got if m.kind == "GuiSetPanelWidthMessage"]
    assert [(m.fields["uuid"], m.fields["width"]) for m in widths] == [
        (viser_internals.identifier(panel), 432)
    ]
    assert not [m for window in other.listen(0.5) for m in window]
    other.close()


def test_an_image_shows_the_bytes_it_was_given(
    server: LocalServer, browser_of: tuple[RawClient, Any]
) -> None:
    client, _ = browser_of
    image = server.gui.add_image(np.zeros((4, 4, 3), np.uint8), format="jpeg")
    client.listen(0.5)
    viser_internals.set_encoded(image, b"\xff\xd8 encoded already")
    (message,) = messages(client, "GuiUpdateMessage")[-1:]
    assert bytes(message.fields["updates"]["_data"]) == b"\xff\xd8 encoded already"


def test_nothing_is_printed_inside_and_all_again_after(capsys: pytest.CaptureFixture[str]) -> None:
    import rich

    with viser_internals.silent():
        rich.print("inside")
    rich.print("after")
    assert capsys.readouterr().out == "after\n"
