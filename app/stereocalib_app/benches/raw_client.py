"""A WebSocket client without a browser: what the server really sends, and how fast."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import msgspec
import viser
import zstandard
from websockets.sync.client import connect


@dataclass
class Received:
    """When a message arrived, its type, and its fields."""

    time_s: float
    kind: str
    fields: dict[str, Any]


class RawClient:
    """Connects as a page of the same origin would and decodes viser's messages."""

    def __init__(self, port: int, origin: str | None = "", host: str = "127.0.0.1") -> None:
        self.own = f"http://{host}:{port}" if origin == "" else origin
        self._socket = connect(
            f"ws://{host}:{port}",
            origin=self.own,  # type: ignore[arg-type]
            subprotocols=[f"viser-v{viser.__version__}"],  # type: ignore[list-item]
            max_size=None,
            compression=None,
            open_timeout=20,
            close_timeout=0.5,
        )
        self._zstd = zstandard.ZstdDecompressor()

    def say_hello(self) -> None:
        """The camera message by which viser counts a browser as connected."""
        camera = {
            "type": "ViewerCameraMessage",
            "wxyz": (1.0, 0.0, 0.0, 0.0),
            "position": (0.0, -5.0, -9.0),
            "fov": 1.0,
            "near": 0.01,
            "far": 1000.0,
            "image_height": 720,
            "image_width": 500,
            "look_at": (0.0, 0.0, 0.0),
            "up_direction": (0.0, -1.0, 0.0),
        }
        self._socket.send(msgspec.msgpack.encode(camera))

    def send_update(self, uuid: str, updates: dict[str, Any]) -> None:
        """What a browser sends when somebody moves a control."""
        self._socket.send(
            msgspec.msgpack.encode({"type": "GuiUpdateMessage", "uuid": uuid, "updates": updates})
        )

    def send_bytes(self, data: bytes) -> None:
        """Anything at all, as a broken or hostile client might."""
        self._socket.send(data)

    def receive(self, timeout_s: float) -> list[Received]:
        """The messages of one window; empty after the timeout."""
        try:
            raw = self._socket.recv(timeout=timeout_s)
        except TimeoutError:
            return []
        assert isinstance(raw, bytes)
        now = time.monotonic()
        size = int.from_bytes(raw[:8], "little")
        packed = int.from_bytes(raw[8:16], "little")
        inner = self._zstd.decompress(raw[16 : 16 + packed], max_output_size=size)
        messages = msgspec.msgpack.decode(inner)["messages"]
        return [Received(now, m["type"], m) for m in messages]

    def listen(self, seconds: float) -> list[list[Received]]:
        """All windows that arrive within a time."""
        end = time.monotonic() + seconds
        windows = []
        while (rest := end - time.monotonic()) > 0:
            window = self.receive(rest)
            if window:
                windows.append(window)
        return windows

    def close(self) -> None:
        self._socket.close()


def frames_in(windows: list[list[Received]]) -> list[tuple[float, int]]:
    """Time and frame number of every headline in viser's windows."""
    found = []
    for window in windows:
        for message in window:
            if message.kind != "GuiUpdateMessage":
                continue
            content = str(message.fields["updates"].get("content", ""))
            match = re.search(r"Frame (\d+)</b> of", content)
            if match:
                found.append((message.time_s, int(match.group(1))))
    return found


def name_in(windows: list[list[Received]]) -> dict[str, Any]:
    """Who the server says that this browser is, for our own line; empty where it has not said."""
    for message in (m for window in windows for m in window):
        text = str((message.fields.get("props") or {}).get("content", ""))
        found = re.search(r'data-client="(\d+)" data-key="([^"]+)"', text)
        if found:
            return {"client": int(found.group(1)), "key": found.group(2)}
    return {}


@dataclass
class Told:
    """A message of our own line: when it came, its head, and the bytes behind it."""

    time_s: float
    head: dict[str, Any]
    body: bytes

    @property
    def pictured(self) -> bool:
        """Whether it brings the picture of the frame that it names."""
        return self.head.get("picture", {}).get("frame", -1) == self.head.get("frame")


class LinkClient:
    """Our own line without a browser; says at once that it has shown what it was sent."""

    def __init__(self, port: int, me: dict[str, Any] | None = None, origin: str | None = "") -> None:
        own = f"http://127.0.0.1:{port}" if origin == "" else origin
        self._socket = connect(
            f"ws://127.0.0.1:{port}/own/link",
            origin=own,  # type: ignore[arg-type]
            max_size=None,
            compression=None,
            open_timeout=20,
            close_timeout=0.5,
        )
        self.say({"t": "hello", **(me or {}), "state": None})

    def say(self, message: dict[str, Any]) -> None:
        """Send a message."""
        self._socket.send(json.dumps(message))

    def receive(self, timeout_s: float) -> Told | None:
        """The next message, None after the timeout."""
        try:
            raw = self._socket.recv(timeout=timeout_s)
        except TimeoutError:
            return None
        assert isinstance(raw, bytes)
        size = int.from_bytes(raw[:4], "big")
        told = Told(time.monotonic(), json.loads(raw[4 : 4 + size]), raw[4 + size :])
        if told.head["t"] == "now":
            self.say({"t": "shown"})
        return told

    def until(self, good: Callable[[Told], bool], timeout_s: float = 30.0) -> Told:
        """The first message that is wanted."""
        end = time.monotonic() + timeout_s
        while (rest := end - time.monotonic()) > 0:
            told = self.receive(rest)
            if told is not None and good(told):
                return told
        raise TimeoutError("the line did not answer")

    def listen(self, seconds: float) -> list[Told]:
        """All messages that arrive within a time."""
        end, found = time.monotonic() + seconds, []
        while (rest := end - time.monotonic()) > 0:
            told = self.receive(rest)
            if told is not None:
                found.append(told)
        return found

    def close(self) -> None:
        """Hang up."""
        self._socket.close()
