"""`python -m stereocalib_app.benches.first_seconds`: from `stereocalib demo` to a moving picture, nothing cached.

Starts the command as anybody would, with an empty folder for rendered frames, and opens the address in a headless
Chromium as soon as it is printed (the browser itself runs already, as people's does). What is made once for an
installation is there: compiled code, and the town as it was painted. Software rendering of the page makes this slower
than a machine with a graphics card. The CPU time of both sides is told too: wall times grow with whatever else the
machine does.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import psutil

from stereocalib_app.benches.chromium import FLAGS, find_browser
from stereocalib_core.errors import ConfigError
from stereocalib_core.sources.formats.synthetic import keep_town_of_this_version
from stereocalib_core.system.compiled import known_also_in

PATIENCE_S = 120.0
MOVING = """() => {
  const text = document.body.innerText, found = text.match(/Frame (\\d+) of/);
  const drawn = document.querySelector('.sc-picture')?.dataset.frame;
  if (!found || drawn === undefined || !/height[^]*\\d\\.\\d+ ?m/i.test(text)) return false;
  const seen = window.firstSeen ??= { frame: found[1], drawn, at: performance.now() };
  return found[1] !== seen.frame && drawn !== seen.drawn ? { first: seen.at, moving: performance.now() } : false; }"""
"""When the first frame stood on the page with picture and height, and when another one did [ms of the page]."""


def measure(browser: str) -> dict[str, float]:
    """Seconds since the command was started: `address` printed, `first` frame shown, `moving`; and what the server and
    the browser have used of the processor by then."""
    from playwright.sync_api import sync_playwright

    with (
        sync_playwright() as playwright,
        tempfile.TemporaryDirectory() as profile,
        tempfile.TemporaryDirectory() as cache,
    ):
        context = playwright.chromium.launch_persistent_context(
            profile, executable_path=browser, args=list(FLAGS), viewport={"width": 1280, "height": 720}
        )
        page = context.pages[0]
        command = [str(Path(sys.executable).with_name("stereocalib")), "demo", "--port", "18085"]
        known_also_in(Path(cache))
        environment = {**os.environ, "STEREOCALIB_CACHE": cache}
        idle_s = browser_cpu_s(profile)
        began = time.monotonic()
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
            try:
                assert process.stdout is not None
                address = process.stdout.readline().strip()
                printed = time.monotonic() - began
                page.goto(address)
                moments = page.wait_for_function(MOVING, timeout=1e3 * PATIENCE_S).json_value()
                moving = time.monotonic() - began
                server_s = float(sum(psutil.Process(process.pid).cpu_times()[:2]))
                browser_s = browser_cpu_s(profile) - idle_s
            finally:
                process.terminate()
        context.close()
    return {
        "address": printed,
        "first": moving - 1e-3 * (moments["moving"] - moments["first"]),
        "moving": moving,
        "server": server_s,
        "browser": browser_s,
    }


def browser_cpu_s(profile: str) -> float:
    """What the processes of a browser have used so far [s], told by the folder of its profile."""
    total, seen = 0.0, set()
    for root in psutil.process_iter():
        with contextlib.suppress(psutil.Error):
            if not any(profile in word for word in root.cmdline()):
                continue
            for process in (root, *root.children(recursive=True)):
                if process.pid not in seen:
                    seen.add(process.pid)
                    total += sum(process.cpu_times()[:2])
    return total


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description="From `stereocalib demo` to a moving picture.")
    parser.add_argument("--browser", default=find_browser())
    parser.add_argument("--times", type=int, default=3)
    arguments = parser.parse_args()
    if arguments.browser is None:
        raise ConfigError("no Chromium or Chrome", "first_seconds", "install one, or name it with --browser")
    keep_town_of_this_version()
    for _ in range(arguments.times):
        seconds = measure(arguments.browser)
        sys.stdout.write(
            f"address {seconds['address']:5.1f} s   first frame {seconds['first']:5.1f} s   "
            f"moving {seconds['moving']:5.1f} s   CPU of the server {seconds['server']:.1f} s, "
            f"of the browser {seconds['browser']:.1f} s\n"
        )
        sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
