"""`python -m stereocalib_app.benches.page [RUN_DIR]`: how quick the page is on a drive that is computed already.

Starts `stereocalib view RUN_DIR` as anybody would and looks at it twice: as a WebSocket client, which sees what
the server sends and when, and as a headless Chromium, which sees what a person would. Times are medians. Without a
run, one of a synthetic drive is made first. The server's CPU time is told too: wall times grow with whatever else the
machine does.
"""

from __future__ import annotations

import argparse
import contextlib
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from stereocalib_app.benches.chromium import FLAGS, find_browser
from stereocalib_app.benches.raw_client import LinkClient, RawClient, Received, frames_in, name_in
from stereocalib_core.run.drive import run_drive

SCRUBS, SLIDES, CLICKS = 40, 60, 24
SEEK_MS, CLICK_MS, PLAYED, PLAYED_IN_CHROMIUM = 150.0, 500.0, 15.0, 8.0
"""What is promised on two cores that nothing else uses: medians of a seek as a client without a browser sees it and
as a click in a headless Chromium, and pictures a second that arrive and that such a Chromium draws (software WebGL)."""
PLAY_S = 10.0
PLAY_SPEED = "2×"
PATIENCE_S = 30.0
LIVE_PATH = "/lead/paths/live"
DRIVE = "synthetic:town?frames=120"


@contextlib.contextmanager
def served(source: str) -> Iterator[tuple[str, float, psutil.Process]]:
    """The page's address, how many seconds the command took to print it, and its process."""
    command = [sys.executable, "-m", "stereocalib_app.cli.main", "view", source, "--port", "18080"]
    began = time.monotonic()
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            address = process.stdout.readline().strip()
            yield address, time.monotonic() - began, psutil.Process(process.pid)
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
        self.shown: int | None = None
        """The frame of the newest headline."""
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
        self.shown = next((frame for _, frame in reversed(frames_in([window]))), self.shown)
        for message in window:
            props = message.fields.get("props") or {}
            if props and "uuid" in message.fields:
                self.elements.add(message.fields["uuid"])
            label = "play" if "play" in (props.get("options") or ()) else props.get("label")
            if label:
                self.controls[label] = message.fields
        return window

    def close(self) -> None:
        """Leave the page."""
        self.client.close()
        self.line.close()

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


def seek_times(watcher: Watcher, total: int) -> list[float]:
    """Seconds from a click on the time line, as its script sends it, to the picture of a random frame."""
    times = []
    for frame in np.random.default_rng(9).permutation(total)[:SCRUBS]:
        began = time.monotonic()
        watcher.line.say({"t": "seek", "frame": int(frame)})
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


COUNT = """seconds => new Promise(done => { let n = 0; const canvas = document.querySelector('.sc-picture');
  const eye = new MutationObserver(() => n++);
  eye.observe(canvas, { attributes: true, attributeFilter: ['data-frame'] });
  setTimeout(() => { eye.disconnect(); done(n / seconds); }, 1000 * seconds); })"""
"""Other pictures that a browser draws in a second."""
CLICK = """([x, y, frame]) => new Promise(done => { const line = document.querySelector('.sc-time');
  const canvas = document.querySelector('.sc-picture'), began = performance.now();
  const eye = new MutationObserver(() => { if (Number(canvas.dataset.frame) !== frame) return;
    eye.disconnect(); done(performance.now() - began); });
  eye.observe(canvas, { attributes: true, attributeFilter: ['data-frame'] });
  const box = line.getBoundingClientRect();
  for (const kind of ['pointerdown', 'pointerup']) line.dispatchEvent(new PointerEvent(kind,
    { clientX: box.left + x, clientY: box.top + y, button: 0, pointerId: 1, bubbles: true })); })"""
"""Milliseconds from a click on the time line to the picture of its frame."""
ZOOM = """() => new Promise(done => { let sent = 0; const send = WebSocket.prototype.send, began = performance.now();
  WebSocket.prototype.send = function (m) { if (typeof m === 'string' && !m.includes('"disparity"')) sent++;
    return send.call(this, m); };
  const canvas = document.querySelector('.sc-picture'), box = canvas.getBoundingClientRect();
  const eye = new MutationObserver(() => { if (Number(canvas.dataset.zoom) < 1.5) return; eye.disconnect();
    const took = performance.now() - began; WebSocket.prototype.send = send; done([took, sent]); });
  eye.observe(canvas, { attributes: true, attributeFilter: ['data-zoom'] });
  canvas.dispatchEvent(new WheelEvent('wheel', { deltaY: -400, clientX: box.left + 60, clientY: box.top + 40,
    cancelable: true })); })"""
"""Milliseconds from a turn of the wheel to the larger picture, and what was sent to the server meanwhile."""
READY = """() => /Frame \\d+ of/.test(document.body.innerText) &&
  document.querySelector('.sc-picture')?.dataset.frame"""
LEFT, RIGHT, RULER = 46, 8, 18
"""As timeline.js has them."""


def in_chromium(address: str, browser: str, total: int) -> dict[str, float]:
    """Seconds until the page can be used; ms to a random frame by a click on the time line and to a larger picture;
    messages sent for that; pictures a second while playing."""
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
        width = page.evaluate("document.querySelector('.sc-time').clientWidth") - LEFT - RIGHT
        times = []
        shown = int(page.evaluate("document.querySelector('.sc-picture').dataset.frame"))
        for frame in np.random.default_rng(8).permutation(total)[:CLICKS]:
            if frame != shown:
                x = LEFT + width * int(frame) / (total - 1)
                times.append(page.evaluate(CLICK, [x, RULER + 20, int(frame)]))
                shown = frame
                time.sleep(0.3)
        zoom_ms, sent = page.evaluate(ZOOM)
        page.get_by_role("button", name="Whole picture").click()
        entry = page.locator(".mantine-NumberInput-input").first
        entry.fill("0")
        entry.press("Enter")
        page.get_by_role("button", name="play", exact=True).click(force=True)
        time.sleep(1.0)
        rate = page.evaluate(COUNT, PLAY_S)
        context.close()
    return {
        "usable": usable,
        "click_ms": float(np.median(times)),
        "zoom_ms": zoom_ms,
        "sent": sent,
        "rate": rate,
    }


def report(run: str, browser: str | None) -> bool:
    """Measure and print; whether all that is promised holds."""
    say, held = sys.stdout.write, []

    def line(name: str, value: float, unit: str, more: str = "", limit: float | None = None) -> None:
        words = ""
        if limit is not None:
            good = value >= limit if unit == "/s" else value <= limit
            held.append(good)
            words = f"   promised {'>=' if unit == '/s' else '<='} {limit:g}{'' if good else ': NOT HELD'}"
        say(f"  {name:<40}{value:8.1f} {unit}{more}{words}\n")

    def times(name: str, seconds: Sequence[float], limit: float | None = None) -> None:
        ms = 1e3 * np.asarray(seconds)
        line(name, float(np.median(ms)), "ms", f", p90 {np.percentile(ms, 90):.0f}", limit)

    with served(run) as (address, started_s, process):
        watcher = Watcher(int(address.rsplit(":", 1)[1]))
        total = int(watcher.controls["Frame"]["props"]["max"]) + 1
        say(f"{run}, {total} frames; {psutil.cpu_count()} cores, {psutil.getloadavg()[0]:.1f} busy before\n")
        line("command to address", started_s, "s")
        line("first request to first frame", watcher.first_s, "s")
        times("random frame by the slider, all views", scrub_times(watcher, total))
        times("random frame by the time line", seek_times(watcher, total), SEEK_MS)
        times("slider to redrawn path", slide_times(watcher))
        before = process.cpu_times()
        gaps = np.diff(played(watcher))
        used = sum(process.cpu_times()[:2]) - sum(before[:2])
        each = 1e3 * used / (len(gaps) + 1)
        more = f", longest gap {1e3 * gaps.max():.0f} ms, {each:.0f} ms of the server's CPU each"
        line(f"playback at {PLAY_SPEED}, consistent frames", 1.0 / gaps.mean(), "/s", more, PLAYED)
        watcher.close()
        if browser:
            seen = in_chromium(address, browser, total)
            line("Chromium: first request to usable page", seen["usable"], "s")
            line("Chromium: click on the time line", seen["click_ms"], "ms", limit=CLICK_MS)
            line(
                "Chromium: wheel to larger picture",
                seen["zoom_ms"],
                "ms",
                f", {seen['sent']:.0f} messages sent",
            )
            line("Chromium: playback shown", seen["rate"], "/s", limit=PLAYED_IN_CHROMIUM)
            held.append(seen["sent"] == 0)
    return all(held)


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description="How quick the page is on a computed drive.")
    parser.add_argument("run", nargs="?", help="output of an earlier `stereocalib run`")
    parser.add_argument(
        "--browser",
        default=find_browser(),
        help="a Chromium or Chrome; without one, or without playwright, it is left out",
    )
    parser.add_argument("--check", action="store_true", help="exit code 1 where a promise does not hold")
    arguments = parser.parse_args()
    browser = arguments.browser if find_spec("playwright") else None
    with tempfile.TemporaryDirectory() as folder:
        run = arguments.run
        if run is None:
            run = f"{folder}/run"
            run_drive(DRIVE, Path(run))
        return 0 if report(run, browser) or not arguments.check else 1


if __name__ == "__main__":
    sys.exit(main())
