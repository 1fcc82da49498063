"""`python -m stereocalib_app.benches.classroom RUN_DIR`: a class on one page, half of it scrubbing for a minute.

Every browser is a WebSocket client. Reported: frames that arrived, frames that were not the wanted ones, lines on
the server's stderr (exceptions would be there), and the server's memory from time to time.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import dataclass, field

import numpy as np
import psutil

from stereocalib_app.benches.page import PATIENCE_S, Watcher, consistent
from stereocalib_app.benches.raw_client import Received, frames_in

BROWSERS = 20
WARM_S = 20.0
SAMPLES = 4


@dataclass
class Tally:
    """What the students of a class saw."""

    shown: int = 0
    late: int = 0
    wrong: int = 0
    wait_s: list[float] = field(default_factory=list)
    lock: threading.Lock = field(default_factory=threading.Lock)


def student(watcher: Watcher, seed: int, total: int, stop: threading.Event, tally: Tally) -> None:
    """Leaves the shared time line and goes to random frames, each awaited with its picture."""
    shared, led = watcher.controls["Frame"]["uuid"], set(watcher.elements)
    watcher.set("Explore on my own", True)
    watcher.until(lambda _window: watcher.controls["Frame"]["uuid"] != shared)
    # The frame that a page of one's own begins with was not asked for: let it come.
    watcher.listen(4.0)
    rng = np.random.default_rng(seed)
    slider, frame = watcher.controls["Frame"]["uuid"], 0

    def arrived(window: list[Received]) -> bool:
        # What the lead shows comes too, for elements that are hidden here.
        own = [m for m in window if m.fields.get("uuid") not in led]
        others = [f for _, f in frames_in([own]) if f != frame]
        with tally.lock:
            tally.wrong += len(others)
        return consistent(own, frame, slider)

    while not stop.is_set():
        # Never the frame that is on show: nothing would be sent.
        frame, began = (frame + int(rng.integers(1, total))) % total, time.monotonic()
        watcher.set("Frame", frame)
        try:
            watcher.until(arrived)
        except TimeoutError:
            with tally.lock:
                tally.late += 1
            continue
        with tally.lock:
            tally.shown += 1
            tally.wait_s.append(time.monotonic() - began)


def follower(watcher: Watcher, stop: threading.Event) -> None:
    """Follows the lead and reads what comes."""
    while not stop.is_set():
        watcher.listen(0.5)


def main() -> int:
    """Measure and print; exit code 1 for a wrong frame or an exception."""
    parser = argparse.ArgumentParser(description="A class of browsers on one page.")
    parser.add_argument("run", help="output of an earlier `stereocalib run`")
    parser.add_argument("--seconds", type=float, default=60.0)
    arguments = parser.parse_args()
    command = [sys.executable, "-m", "stereocalib_app.cli.main", "view", arguments.run, "--port", "18090"]
    with (
        tempfile.TemporaryFile("w+") as errors,
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True) as process,
    ):
        try:
            assert process.stdout is not None
            port = int(process.stdout.readline().strip().rsplit(":", 1)[1])
            say, memory = sys.stdout.write, psutil.Process(process.pid)
            watchers = [Watcher(port) for _ in range(BROWSERS)]
            total = int(watchers[0].controls["Frame"]["props"]["max"]) + 1
            stop, tally = threading.Event(), Tally()
            threads = [
                threading.Thread(target=student, args=(w, i, total, stop, tally), daemon=True)
                if i < BROWSERS // 2
                else threading.Thread(target=follower, args=(w, stop), daemon=True)
                for i, w in enumerate(watchers)
            ]
            for thread in threads:
                thread.start()
            watchers[-1].set("play", "play")
            time.sleep(WARM_S)
            sizes = [memory.memory_info().rss / 1e6]
            for _ in range(SAMPLES):
                time.sleep(arguments.seconds / SAMPLES)
                sizes.append(memory.memory_info().rss / 1e6)
            stop.set()
            for thread in threads:
                thread.join(timeout=40.0)
        finally:
            process.terminate()
        errors.seek(0)
        complaints = errors.read().strip()
    say(f"{BROWSERS} browsers, {BROWSERS // 2} on their own, {arguments.seconds:g} s\n")
    say(f"  frames shown as wanted   {tally.shown}, median wait {1e3 * np.median(tally.wait_s):.0f} ms\n")
    say(f"  wrong frames             {tally.wrong}\n")
    say(f"  frames that did not come {tally.late} within {PATIENCE_S:g} s\n")
    say(f"  memory of the server     {', '.join(f'{size:.0f}' for size in sizes)} MB, from start to end\n")
    say(f"  on its stderr            {complaints or 'nothing'}\n")
    return 1 if tally.late or tally.wrong or "Traceback" in complaints else 0


if __name__ == "__main__":
    sys.exit(main())
