"""What strangers and broken browsers send: malformed messages, reconnects, a flood; and memory while it lasts.

Right is: nothing on the server's stderr, the page still answers, its memory within a stated bound. `python
tests/campaign/wire.py [--messages N] [--reconnects N] [--flood N] [--soak SECONDS]` prints a table.
"""

from __future__ import annotations

import argparse
import contextlib
import random
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import psutil
from websockets.exceptions import ConnectionClosed

if __name__ == "__main__":
    root = Path(__file__).resolve().parents[2]
    sys.path[:0] = [str(root), str(root / "app"), str(root / "tests")]

from stereocalib_app.benches.page import Watcher
from stereocalib_app.benches.raw_client import RawClient

SOURCE = "synthetic:plane?frames=24"
GROWTH_MB = 1000.0
"""Over the memory at the start: what no message and no upload may make it exceed."""
ANSWER_S = 2.0
"""How long the last of a flood of wishes may take to be seen."""
AGAIN_S, LONGEST_S = 5, 60
"""After how long another frame is asked for, and when the page counts as dead."""
KINDS = (
    "GuiUpdateMessage", "ViewerCameraMessage", "FileTransferStartUpload", "FileTransferPart",
    "GuiCloseModalMessage", "ScenePointerMessage", "SceneNodeClickMessage", "TransformControlsUpdateMessage",
    "ShareUrlRequest", "NoSuchMessage",
)  # fmt: skip
VALUES = (
    None,
    True,
    -1,
    2**63,
    float("nan"),
    float("inf"),
    "",
    "x" * 5000,
    b"\xff" * 50,
    [],
    {},
    [[]],
    {"value": {}},
)


SAID: list[str] = []
"""What the servers said on stderr."""


@dataclass(frozen=True)
class Row:
    """One line of the table: what was tried, how often, how often it went wrong, and what was seen."""

    what: str
    cases: int
    wrong: int
    seen: str


@dataclass
class Server:
    """A page that is being attacked."""

    port: int
    memory: psutil.Process
    errors: Any

    def megabytes(self) -> float:
        return float(self.memory.memory_info().rss) / 1e6

    def said(self) -> int:
        """Lines on stderr so far."""
        self.errors.seek(0)
        return sum(1 for line in self.errors if line.strip() and "compiling once" not in line)


@contextlib.contextmanager
def serving(source: str = SOURCE) -> Iterator[Server]:
    """`stereocalib view` on a free port."""
    with socket.socket() as any_port:
        any_port.bind(("127.0.0.1", 0))
        port = any_port.getsockname()[1]
    command = [sys.executable, "-m", "stereocalib_app.cli.main", "view", source, "--port", str(port)]
    with (
        tempfile.TemporaryFile("w+") as errors,
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True) as process,
    ):
        try:
            assert process.stdout is not None
            assert process.stdout.readline().startswith("http://127.0.0.1")
            yield Server(port, psutil.Process(process.pid), errors)
        finally:
            errors.seek(0)
            SAID.extend(errors)
            process.terminate()


def answers(server: Server) -> float:
    """Seconds until a new browser that goes to a frame sees it."""
    watcher = Watcher(server.port)
    began = time.monotonic()
    try:
        # A page that was opened plays, and a slider that is sent to where it happens to stand is no news, which
        # nothing answers: then another frame is asked for.
        for attempt in range(LONGEST_S // AGAIN_S):
            wanted = 8 + attempt % 8 if watcher.shown != 8 + attempt % 8 else 16
            watcher.set("Frame", wanted)
            end = time.monotonic() + AGAIN_S
            while time.monotonic() < end:
                watcher.listen(0.05)
                if watcher.shown == wanted:
                    return time.monotonic() - began
        raise TimeoutError("the page did not answer")
    finally:
        watcher.client.close()


def malformed(rng: random.Random, controls: list[str]) -> bytes:
    """A message that no browser sends."""
    style = rng.randrange(4)
    if style == 0:
        return rng.randbytes(rng.choice((0, 1, 7, 300, 70_000)))
    kind = rng.choice(KINDS)
    names = (
        "uuid",
        "updates",
        "source_component_uuid",
        "transfer_uuid",
        "part",
        "content",
        "size_bytes",
        "name",
        "wxyz",
    )
    message: dict[str, Any] = {"type": kind}
    for name in rng.sample(names, rng.randrange(len(names))):
        message[name] = rng.choice(VALUES)
    if style == 3 and controls:
        message = {
            "type": "GuiUpdateMessage",
            "uuid": rng.choice(controls),
            "updates": {"value": rng.choice(VALUES)},
        }
    return msgspec.msgpack.encode(message)


def malformed_messages(server: Server, count: int) -> Row:
    rng, before, start_mb = random.Random(1), server.said(), server.megabytes()
    watcher = Watcher(server.port)
    controls = [control["uuid"] for control in watcher.controls.values()]
    watcher.client.close()
    client = RawClient(server.port)
    for _ in range(count):
        try:
            client.send_bytes(malformed(rng, controls))
        except (OSError, ConnectionClosed):
            client = RawClient(server.port)  # thrown out: that is one right answer
    client.close()
    waited, grown = answers(server), server.megabytes() - start_mb
    said = server.said() - before
    wrong = said + (waited > 10.0) + (grown > GROWTH_MB)
    return Row(
        "malformed messages",
        count,
        wrong,
        f"{said} lines on stderr, then a frame in {waited:.2f} s, {grown:+.0f} MB",
    )


def reconnects(server: Server, count: int) -> Row:
    before, start_mb = server.said(), server.megabytes()
    for index in range(count):
        client = RawClient(server.port)
        if index % 2:
            client.say_hello()
        client.close()
    waited, grown, said = answers(server), server.megabytes() - start_mb, server.said() - before
    wrong = said + (waited > 10.0) + (grown > GROWTH_MB)
    return Row(
        "reconnects", count, wrong, f"{said} lines on stderr, then a frame in {waited:.2f} s, {grown:+.0f} MB"
    )


def flood(server: Server, count: int) -> Row:
    """One browser sends so many slider messages at once: the other one soon sees the last of them, not all."""
    before = server.said()
    wild, other = Watcher(server.port), Watcher(server.port)
    slider = wild.controls["Frame"]["uuid"]
    for index in range(count):
        wild.client.send_update(slider, {"value": index % 20})
    began = time.monotonic()
    wild.client.send_update(slider, {"value": 23})
    other.until(lambda _window: other.shown == 23)
    waited, said = time.monotonic() - began, server.said() - before
    for watcher in (wild, other):
        watcher.client.close()
    return Row(
        "slider messages at once", count, said + (waited > ANSWER_S), f"the last is seen after {waited:.2f} s"
    )


def soak(server: Server, seconds: float) -> Row:
    """Somebody scrubs without end; memory after a tenth of the time and at the end."""
    watcher, before, end = Watcher(server.port), server.said(), time.monotonic() + seconds
    warm_at, warm_mb, frames, rng = time.monotonic() + 0.1 * seconds, 0.0, 0, random.Random(2)
    while time.monotonic() < end:
        watcher.set("Frame", rng.randrange(24))
        watcher.listen(0.1)
        frames += 1
        if not warm_mb and time.monotonic() > warm_at:
            warm_mb = server.megabytes()
    watcher.client.close()
    grown, said = server.megabytes() - warm_mb, server.said() - before
    return Row(
        f"{seconds:.0f} s of scrubbing",
        frames,
        said + (grown > 0.1 * warm_mb),
        f"{warm_mb:.0f} MB {grown:+.0f} MB",
    )


def rows(messages: int, again: int, at_once: int, seconds: float) -> list[Row]:
    """Everything against one server."""
    with serving() as server:
        answers(server)
        return [
            malformed_messages(server, messages),
            reconnects(server, again),
            flood(server, at_once),
            soak(server, seconds),
        ]


def table(found: list[Row]) -> str:
    """The rows as lines of text."""
    lines = [f"{'what':<28}{'cases':>8}{'wrong':>7}  seen"]
    return "\n".join(lines + [f"{row.what:<28}{row.cases:>8}{row.wrong:>7}  {row.seen}" for row in found])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    for name, default in (("messages", 600), ("reconnects", 500), ("flood", 5000), ("soak", 120)):
        parser.add_argument(f"--{name}", type=int, default=default)
    given = parser.parse_args()
    result = rows(given.messages, given.reconnects, given.flood, given.soak)
    print(table(result))
    sys.stderr.write("".join(SAID))
    sys.exit(any(row.wrong for row in result))
