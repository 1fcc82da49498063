"""Everything that leans on viser's privates, in one place: no other file of the app touches them.

viser 1.1 lacks a public way for what stands here; the version is pinned, and `tests/app/test_viser_internals.py` fails
where a later one has moved something.
"""

from __future__ import annotations

import http
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import rich
import websockets.asyncio.server
from viser import GuiApi, _messages
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

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


def show_elements(client: Any, handles: Iterable[Any], visible: bool) -> None:
    """Show or hide elements that all browsers share in one browser only."""
    for handle in handles:
        message = _messages.GuiUpdateMessage(identifier(handle), {"visible": visible})
        client._websock_connection.queue_message(message)


def show_node(client: Any, name: str, visible: bool) -> None:
    """Show or hide a node of the shared scene in one browser only."""
    client._websock_connection.queue_message(_messages.SetSceneNodeVisibilityMessage(name, visible))


def set_width(client: Any, gui: GuiApi, panel: Any, width_px: int) -> None:
    """Set the width of a panel of `gui` in one browser only."""
    message = _messages.GuiSetPanelWidthMessage(
        identifier(panel), width_px, counter=gui._next_layout_counter(), run_id=gui._layout_run_id
    )
    client._websock_connection.queue_message(message)


def set_encoded(image: Any, jpeg: bytes) -> None:
    """Hand encoded bytes to an image, so that one encoding serves every browser."""
    image._format = "jpeg"
    image._data = jpeg


@contextmanager
def requests_checked(allowed: Callable[[Any], bool]) -> Iterator[None]:
    """A server that starts inside answers 403 to a request whose headers are not `allowed`, and prints no banner."""
    original = websockets.asyncio.server.serve

    def serve(*args: Any, process_request: Callable[..., Any] | None = None, **kwargs: Any) -> Any:
        def checked(connection: Any, request: Request) -> Response | None:
            if not allowed(request.headers):
                return Response(http.HTTPStatus.FORBIDDEN, "Forbidden", Headers(), b"foreign page refused\n")
            return None if process_request is None else process_request(connection, request)

        return original(*args, process_request=checked, **kwargs)

    with silent():
        websockets.asyncio.server.serve = serve  # type: ignore[assignment,misc]
        try:
            yield
        finally:
            websockets.asyncio.server.serve = original  # type: ignore[misc]


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
