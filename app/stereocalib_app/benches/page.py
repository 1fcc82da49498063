"""`python -m stereocalib_app.benches.page RUN_DIR`: how quick the page is on a drive that is computed already.

Starts `stereocalib view RUN_DIR` as anybody would and looks at it twice: as a WebSocket client, which sees what
the server sends and when, and as a headless Chromium, which sees what a person would. Times are medians.
"""

from __future__ import annotations

import argparse
import contextlib
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from stereocalib_app.benches.chromium import FLAGS, find_browser
from stereocalib_app.benches.raw_client import LinkClient, RawClient, Received, frames_in, name_in

SCRUBS, SLIDES = 40, 60
PLAY_S = 10.0
PLAY_SPEED = "2×"
PATIENCE_S = 30.0
LIVE_PATH = "/lead/paths/live"


@contextlib.contextmanager
def served(source: str) -> Iterator[tuple[str, float]]:
    """The page's address, and how many seconds the command took to print it."""
    command = [sys.executable, "-m", "stereocalib_app.cli.main", "view", source, "--port", "18080"]
    began = time.monotonic()
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            yield process.stdout.readline().strip(), time.monotonic() - began
        finally:
            process.terminate()


class Watcher:
    """A WebSocket client that knows the page's controls by their labels."""

    def __init__(self, port: int) -> None:
        began = time.monotonic()
        self.client = RawClient(port)
        self.client.say_hello()
        self.controls: dict[str, dict[str, Any]] = {}
        self.elements: set[str] = set()
        self.me: dict[str, Any] = {}
        self.until(lambda window: bool(frames_in([window])))
        self.first_s = time.monotonic() - began
        self.listen(1.5)
        self.line = LinkClient(port, self.me)

    def until(self, good: Callable[[list[Received]], bool]) -> list[Received]:
        """Wait for a window of messages that is wanted."""
        end = time.monotonic() + PATIENCE_S
        while time.monotonic() < end:
            window = self._receive(1.0)
            if window and good(window):
                return window
        raise TimeoutError("the page did not answer")

    def listen(self, seconds: float) -> list[list[Received]]:
        """All windows that arrive within a time."""
        end = time.monotonic() + seconds
        windows = []
        while (rest := end - time.monotonic()) > 0:
            windows.append(self._receive(rest))
        return windows

    def _receive(self, timeout_s: float) -> list[Received]:
        window = self.client.receive(timeout_s)
        self.me = self.me or name_in([window])
        for message in window:
            props = message.fields.get("props") or {}
            if props and "uuid" in message.fields:
                self.elements.add(message.fields["uuid"])
            label = "play" if "play" in (props.get("options") or ()) else props.get("label")
            if label:
                self.controls[label] = message.fields
        return window

    def set(self, label: str, value: Any) -> None:
        """Do as a person does who moves a control."""
        self.client.send_update(self.controls[label]["uuid"], {"value": value})


def consistent(window: list[Received], frame: int, slider: str) -> bool:
    """Whether one window brings a frame's headline, and the slider, if it moves, agrees."""
    named = [f for _, f in frames_in([window])]
    sliders = [
        m.fields["updates"]["value"]
        for m in window
        if m.kind == "GuiUpdateMessage" and m.fields["uuid"] == slider and "value" in m.fields["updates"]
    ]
    return named == [frame] and all(value == frame for value in sliders)


def scrub_times(watcher: Watcher, total: int) -> list[float]:
    """Seconds from a slider's move to everything about a random frame, in one window."""
    times = []
    slider = watcher.controls["Frame"]["uuid"]
    for frame in np.random.default_rng(7).permutation(total)[:SCRUBS]:
        began = time.monotonic()
        watcher.set("Frame", int(frame))
        watcher.until(lambda window, wanted=int(frame): consistent(window, wanted, slider))  # type: ignore[misc]
        watcher.line.until(lambda told, wanted=int(frame): told.pictured and told.head["frame"] == wanted)  # type: ignore[misc]
        times.append(time.monotonic() - began)
        watcher.listen(0.1)
    return times


def slide_times(watcher: Watcher) -> list[float]:
    """Seconds from a correction's move to the redrawn path of the whole drive."""
    times = []
    for k in range(SLIDES):
        began = time.monotonic()
        watcher.set("pitch added °", 0.01 * (k + 1))
        watcher.until(lambda window: any(m.fields.get("name") == LIVE_PATH for m in window))
        times.append(time.monotonic() - began)
        watcher.listen(0.15)
    watcher.set("pitch added °", 0.0)
    watcher.listen(0.5)
    return times


def played(watcher: Watcher) -> list[float]:
    """Moments at which a new frame arrived with its picture, while the drive plays at twice its pace; viser's
    windows, with the scene, are read beside it."""
    watcher.set("Frame", 0)
    watcher.set("Loop", True)
    watcher.set("Speed", PLAY_SPEED)
    watcher.set("play", "play")
    watcher.listen(1.0)
    reader = threading.Thread(target=watcher.listen, args=(PLAY_S,))
    reader.start()
    shown = [(told.time_s, told.head["frame"]) for told in watcher.line.listen(PLAY_S) if told.pictured]
    reader.join()
    watcher.set("play", "pause")
    watcher.listen(0.5)
    return [b[0] for a, b in zip(shown, shown[1:], strict=False) if a[1] != b[1]]


COUNT = """seconds => new Promise(done => { let n = 0, last = '';
  const look = () => { const p = [...document.querySelectorAll('p')].find(e => /Frame \\d+ of/.test(e.textContent));
    const t = p ? p.textContent.match(/Frame (\\d+)/)[1] : ''; if (t && t !== last) { n += last ? 1 : 0; last = t; } };
  const timer = setInterval(look, 8);
  setTimeout(() => { clearInterval(timer); done(n / seconds); }, 1000 * seconds); })"""
READY = """() => /Frame \\d+ of/.test(document.body.innerText) &&
  document.querySelector('.sc-picture')?.dataset.frame"""


def in_chromium(address: str, browser: str, total: int) -> dict[str, float]:
    """Seconds until the page can be used, seconds to a random frame, frames a second while playing."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright, tempfile.TemporaryDirectory() as profile:
        context = playwright.chromium.launch_persistent_context(
            profile, executable_path=browser, args=list(FLAGS), viewport={"width": 1280, "height": 720}
        )
        page = context.pages[0]
        began = time.monotonic()
        page.goto(address)
        page.wait_for_function(READY, timeout=60_000)
        usable = time.monotonic() - began
        time.sleep(8.0)
        entry = page.locator(".mantine-NumberInput-input").first
        times = []
        for frame in np.random.default_rng(8).permutation(total)[:12]:
            entry.fill(str(frame))
            began = time.monotonic()
            entry.press("Enter")
            page.wait_for_function("f => document.body.innerText.includes(f)", arg=f"Frame {frame} of")
            times.append(time.monotonic() - began)
        entry.fill("0")
        entry.press("Enter")
        page.get_by_role("button", name="play", exact=True).click(force=True)
        time.sleep(1.0)
        rate = page.evaluate(COUNT, PLAY_S)
        context.close()
    return {"usable": usable, "scrub": float(np.median(times)), "rate": rate}


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description="How quick the page is on a computed drive.")
    parser.add_argument("run", help="output of an earlier `stereocalib run`")
    parser.add_argument(
        "--browser", default=find_browser(), help="a Chromium or Chrome; without one it is left out"
    )
    arguments = parser.parse_args()
    with served(arguments.run) as (address, started_s):
        watcher = Watcher(int(address.rsplit(":", 1)[1]))
        total = int(watcher.controls["Frame"]["props"]["max"]) + 1
        say = sys.stdout.write
        say(f"{arguments.run}, {total} frames\n")
        say(f"  command to address                     {started_s:6.2f} s\n")
        say(f"  first request to first frame           {watcher.first_s:6.2f} s\n")
        scrubs, slides = scrub_times(watcher, total), slide_times(watcher)
        say(f"  random frame, all views                {1e3 * np.median(scrubs):6.0f} ms, p90 ")
        say(f"{1e3 * np.percentile(scrubs, 90):.0f} ms\n")
        say(f"  slider to redrawn path                 {1e3 * np.median(slides):6.0f} ms, p90 ")
        say(f"{1e3 * np.percentile(slides, 90):.0f} ms\n")
        moments = played(watcher)
        gaps = np.diff(moments)
        say(f"  playback at {PLAY_SPEED}, consistent frames      {1.0 / gaps.mean():6.1f} /s, longest gap ")
        say(f"{1e3 * gaps.max():.0f} ms\n")
        watcher.client.close()
        if arguments.browser:
            seen = in_chromium(address, arguments.browser, total)
            say(f"  Chromium: first request to usable page {seen['usable']:6.2f} s\n")
            say(f"  Chromium: random frame                 {1e3 * seen['scrub']:6.0f} ms\n")
            say(f"  Chromium: playback shown               {seen['rate']:6.1f} /s\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
