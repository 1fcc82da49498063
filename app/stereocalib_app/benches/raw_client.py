"""A WebSocket client without a browser: what the server really sends, and how fast."""

from __future__ import annotations

import re
import time
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

    def __init__(self, port: int, origin: str | None = "") -> None:
        self.own = f"http://127.0.0.1:{port}" if origin == "" else origin
        self._socket = connect(
            f"ws://127.0.0.1:{port}",
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


def frames_in(windows: list[list[Received]]) -> list[tuple[float, int, int]]:
    """Time, frame number of the headline, and number of pictures of every window that names a frame."""
    found = []
    for window in windows:
        pictures = sum("_data" in m.fields.get("updates", {}) for m in window if m.kind == "GuiUpdateMessage")
        for message in window:
            if message.kind != "GuiUpdateMessage":
                continue
            content = str(message.fields["updates"].get("content", ""))
            match = re.search(r"Frame (\d+)</b> of", content)
            if match:
                found.append((message.time_s, int(match.group(1)), pictures))
    return found
