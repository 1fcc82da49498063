"""Everything that leans on viser's privates, in one place: no other file of the app touches them.

viser 1.1 lacks a public way for what stands here; the version is pinned, and `tests/app/test_viser_internals.py` fails
where a later one has moved something.
"""

from __future__ import annotations

import inspect
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol

import rich
import viser
import websockets.asyncio.server
from viser import GuiApi, _messages
from websockets.http11 import Request, Response

# A browser that leaves while its page is being built is no news: what was meant for it goes nowhere.
warnings.filterwarnings("ignore", message="Queued a .* on a closed connection", category=UserWarning)

_STARTING = threading.Lock()


def held_value(control: Any) -> Any:
    """What a control is set to, as its browsers know it."""
    return control._impl.value


def identifier(handle: Any) -> str:
    """The name by which messages speak of an element."""
    return str(handle._impl.uuid)


def check_values(gui: GuiApi, allowed: Callable[[Any, Any], bool], refused: Callable[[int], None]) -> None:
    """Before viser takes over what a browser says: only `{"value": …}` of a control of `gui`, and only where
    `allowed(control, value)`; for all else `refused(client_id)` is called and the browser is told the old value."""
    original = gui._handle_gui_updates

    async def checked(client_id: int, message: _messages.GuiUpdateMessage) -> None:
        control = gui._gui_input_handle_from_uuid.get(message.uuid)
        if control is None:
            return
        if message.updates.keys() == {"value"} and allowed(control, message.updates["value"]):
            await original(client_id, message)  # type: ignore[arg-type]
            return
        refused(client_id)
        held = _messages.GuiUpdateMessage(message.uuid, {"value": held_value(control)})
        gui._websock_interface.queue_message(held)

    gui._websock_interface.unregister_handler(_messages.GuiUpdateMessage, original)
    gui._websock_interface.register_handler(_messages.GuiUpdateMessage, checked)


def limit_uploads(
    gui: GuiApi, most_bytes: int, patience_s: float, refused: Callable[[int, str], None]
) -> None:
    """An upload that is announced as larger than `most_bytes`, or brings more than it announced, is dropped at once,
    and `refused(client_id, name)` is called; one that has been idle for `patience_s` is dropped too."""
    start, part = gui._handle_file_transfer_start, gui._handle_file_transfer_part
    heard: dict[str, float] = {}

    def forget(transfer: str) -> None:
        gui._current_file_upload_states.pop(transfer, None)
        heard.pop(transfer, None)

    def watch(transfer: str, wait_s: float) -> None:
        timer = threading.Timer(wait_s, look, (transfer,))
        timer.daemon = True
        timer.start()

    def look(transfer: str) -> None:
        since = heard.get(transfer)
        if since is not None:
            rest = patience_s - (time.monotonic() - since)
            if rest > 0:
                watch(transfer, rest)
            else:
                forget(transfer)

    def begin(client_id: int, message: _messages.FileTransferStartUpload) -> None:
        if not 0 <= message.size_bytes <= most_bytes or not 0 <= message.part_count <= message.size_bytes:
            refused(client_id, str(message.filename))
            return
        heard[message.transfer_uuid] = time.monotonic()
        watch(message.transfer_uuid, patience_s)
        start(client_id, message)  # type: ignore[arg-type]

    async def take(client_id: int, message: _messages.FileTransferPart) -> None:
        state = gui._current_file_upload_states.get(message.transfer_uuid)
        if state is None:
            heard.pop(message.transfer_uuid, None)
            return
        if state["transferred_bytes"] + len(message.content) > state["total_bytes"]:
            forget(message.transfer_uuid)
            refused(client_id, state["filename"])
            return
        heard[message.transfer_uuid] = time.monotonic()
        answer: Any = part(client_id, message)  # type: ignore[arg-type]
        if inspect.isawaitable(answer):
            await answer

    handlers: tuple[tuple[Any, Any, Any], ...] = (
        (_messages.FileTransferStartUpload, start, begin),
        (_messages.FileTransferPart, part, take),
    )
    for kind, old, new in handlers:
        gui._websock_interface.unregister_handler(kind, old)
        gui._websock_interface.register_handler(kind, new)


def show_elements(client: Any, handles: Iterable[Any], visible: bool) -> None:
    """Show or hide elements that all browsers share in one browser only."""
    for handle in handles:
        message = _messages.GuiUpdateMessage(identifier(handle), {"visible": visible})
        client._websock_connection.queue_message(message)


def show_node(client: Any, name: str, visible: bool) -> None:
    """Show or hide a node of the shared scene in one browser only."""
    client._websock_connection.queue_message(_messages.SetSceneNodeVisibilityMessage(name, visible))


def set_width(client: Any, gui: GuiApi, panel: Any, width_px: int) -> None:
    """Set the width of a panel of `gui`, the main one among them, in one browser only."""
    message = _messages.GuiSetPanelWidthMessage(
        panel._placement_uuid, width_px, counter=gui._next_layout_counter(), run_id=gui._layout_run_id
    )
    client._websock_connection.queue_message(message)


def set_place(client: Any, gui: GuiApi, panel: Any, edge: str | None, x: float = 0.0, y: float = 0.0) -> None:
    """Dock a panel of `gui` to an edge (`left`, `right`), or float it at x, y [px], in one browser only."""
    place: Any = {"kind": "float", "x": x, "y": y} if edge is None else {"kind": "edge", "edge": edge}
    message = _messages.GuiSetPanelPositionMessage(
        panel._placement_uuid, place, counter=gui._next_layout_counter(), run_id=gui._layout_run_id
    )
    client._websock_connection.queue_message(message)


def set_encoded(image: Any, jpeg: bytes) -> None:
    """Hand encoded bytes to an image, so that one encoding serves every browser."""
    image._format = "jpeg"
    image._data = jpeg


class Door(Protocol):
    """What stands before viser's own server: it sees every request first."""

    async def answer(self, request: Request) -> Response | None:
        """The answer to a request, or None where viser shall answer or a WebSocket shall be opened."""

    def talks(self, path: str) -> bool:
        """Whether a WebSocket of this path is ours."""

    async def talk(self, connection: Any) -> None:
        """Speak with a browser on a WebSocket of ours until it closes."""


@contextmanager
def behind(door: Door) -> Iterator[None]:
    """A server that starts inside stands behind `door`, and prints no banner."""
    original = websockets.asyncio.server.serve

    def serve(handler: Any, *args: Any, process_request: Any = None, **kwargs: Any) -> Any:
        async def first(connection: Any, request: Request) -> Response | None:
            answer = await door.answer(request)
            if answer is not None or door.talks(request.path) or process_request is None:
                return answer
            return process_request(connection, request)

        async def handled(connection: Any) -> None:
            await (door.talk if door.talks(connection.request.path) else handler)(connection)

        return original(handled, *args, process_request=first, **kwargs)

    with silent():
        websockets.asyncio.server.serve = serve  # type: ignore[assignment,misc]
        try:
            yield
        finally:
            websockets.asyncio.server.serve = original  # type: ignore[misc]


def client_page() -> bytes:
    """The page that viser sends to browsers, as HTML."""
    return (Path(viser.__file__).parent / "client" / "build" / "index.html").read_bytes()


@contextmanager
def silent() -> Iterator[None]:
    """What viser says of its starting and stopping stays off the terminal. One thread at a time."""
    with _STARTING:
        original = rich.print
        rich.print = lambda *args, **kwargs: None
        try:
            yield
        finally:
            rich.print = original
