"""Takes the pictures of the documentation: `python -m stereocalib_app.benches.screenshots --out assets`.

Needs playwright and a Chromium or Chrome on the machine (both only for this). Shows the synthetic drive, because
its pictures may be published.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from stereocalib_app.benches.chromium import FLAGS, find_browser
from stereocalib_app.drive.serve import Opening, start
from stereocalib_app.server.hub import Hub
from stereocalib_app.server.security import stop_server
from stereocalib_core.errors import ConfigError
from stereocalib_core.results import Tolerance

SIZES = ((1600, 900), (1280, 720))
DRIVE = "synthetic:town?frames=120&fault=truck@40-46&fault=knock:pitch=0.5@80"
LIMITS = {
    "height_m": Tolerance(1.65, 0.03),
    "pitch_rad": Tolerance(*np.deg2rad([0.8, 0.3])),
    "roll_rad": Tolerance(*np.deg2rad([-0.4, 0.3])),
    "yaw_rad": Tolerance(*np.deg2rad([-0.3, 0.2])),
}
SETTLE_S = 2.5


def inspect(hub: Hub, _page: Any) -> None:
    """The answer first."""
    hub.shared.choose("Inspect")
    hub.shared.playback.seek(30)


def teach(hub: Hub, _page: Any) -> None:
    """Pitch and height, broken."""
    hub.shared.choose("Teach")
    hub.shared.playback.seek(60)
    hub.shared.parts["Teach"].go(4)
    hub.shared.parts["Teach"].break_it()


def debug(hub: Hub, _page: Any) -> None:
    """A failed frame and why."""
    hub.shared.parts["Teach"].mend()
    hub.shared.choose("Debug")
    hub.shared.playback.seek(0)
    hub.shared.playback.seek_failure(1)


def paths(hub: Hub, page: Any) -> None:
    """The whole drive with its paths, from above."""
    hub.shared.choose("Inspect")
    hub.shared.playback.seek(len(hub.shared.session.source) - 1)
    page.get_by_role("tab", name="Paths", exact=True).click(force=True)
    page.get_by_role("tab", name="Path errors", exact=True).click(force=True)
    hub.shared.set_follow(False)


def light(hub: Hub, page: Any) -> None:
    """The light theme."""
    hub.shared.set_follow(True)
    page.get_by_role("tab", name="Guide", exact=True).click(force=True)
    page.get_by_role("tab", name="Time line", exact=True).click(force=True)
    if not page.get_by_label("Light theme").is_visible():
        page.get_by_text("This browser").dispatch_event("click")
        time.sleep(SETTLE_S)
    page.get_by_label("Light theme").dispatch_event("click")


SCENES: tuple[tuple[str, Callable[[Hub, Any], None]], ...] = (
    ("inspect", inspect),
    ("teach", teach),
    ("debug", debug),
    ("paths", paths),
    ("light", light),
)


def settle(hub: Hub, page: Any) -> None:
    """Wait until the browser shows the frame that is wanted, and has drawn it."""
    time.sleep(SETTLE_S)
    frame = hub.shared.playback.state.frame
    script = "wanted => { const t = document.body.innerText; return t.includes(wanted) || !/Frame \\d+ of/.test(t) }"
    page.wait_for_function(script, arg=f"Frame {frame} ")
    time.sleep(SETTLE_S)


def take(hub: Hub, out: Path, browser_path: str) -> list[Path]:
    """Every scene in every size."""
    from playwright.sync_api import sync_playwright

    written: list[Path] = []
    with sync_playwright() as playwright, tempfile.TemporaryDirectory() as profile:
        for width, height in SIZES:
            context = playwright.chromium.launch_persistent_context(
                f"{profile}/{width}",
                executable_path=browser_path,
                args=list(FLAGS),
                viewport={"width": width, "height": height},
            )
            page = context.pages[0]
            page.set_default_timeout(60_000)
            page.goto(f"http://127.0.0.1:{hub.server.get_port()}/")
            page.wait_for_selector(".sc-picture[data-frame]")
            time.sleep(4 * SETTLE_S)
            page.evaluate("() => document.querySelector('.mantine-Notification-closeButton')?.click()")
            for name, prepare in SCENES:
                prepare(hub, page)
                page.mouse.move(width / 2, 5)
                settle(hub, page)
                path = out / f"app_{name}_{width}x{height}.jpg"
                page.screenshot(path=str(path), type="jpeg", quality=88, timeout=120_000)
                written.append(path)
            context.close()
    return written


def main() -> int:
    """Start the app on the synthetic drive, wait until it is computed, take the pictures."""
    parser = argparse.ArgumentParser(description="Pictures of the app for the documentation.")
    parser.add_argument("--out", type=Path, default=Path("assets"))
    parser.add_argument("--source", default=DRIVE)
    parser.add_argument("--browser", default=find_browser())
    arguments = parser.parse_args()
    if arguments.browser is None:
        raise ConfigError("no Chromium or Chrome", "screenshots", "install one, or name it with --browser")
    arguments.out.mkdir(parents=True, exist_ok=True)
    hub = start(arguments.source, port=0, opening=Opening(limits=LIMITS))
    hub.shared.playback.play(False)
    hub.shared.session.wait(1800.0)
    for path in take(hub, arguments.out, arguments.browser):
        sys.stdout.write(f"{path}\n")
    hub.close()
    stop_server(hub.server)
    return 0


if __name__ == "__main__":
    sys.exit(main())
