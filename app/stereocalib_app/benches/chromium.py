"""A headless browser for pictures, measurements and tests; needs a Chromium or Chrome on the machine."""

from __future__ import annotations

import shutil

FLAGS = (
    *("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
    *("--ignore-gpu-blocklist", "--disable-background-networking", "--no-first-run", "--mute-audio"),
    *("--disable-component-update", "--disable-sync", "--disable-default-apps", "--disable-dev-shm-usage"),
)
_NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")


def find_browser() -> str | None:
    """The path of a browser, None where there is none."""
    return next((path for name in _NAMES if (path := shutil.which(name))), None)
