"""A page on a real drive and a headless browser, each started once for all tests of the app."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Error as PlaywrightError
from stereocalib_app.benches.chromium import FLAGS
from stereocalib_app.drive import serve as app_server
from stereocalib_app.server.hub import Hub
from stereocalib_app.server.security import stop_server

_CONTEXTS: list[Any] = []
PLAIN_DRAWING = (
    "--disable-gpu-rasterization", "--webgl-antialiasing-mode=none", "--webgl-msaa-sample-count=0",
)  # fmt: skip
"""No smooth edges, which nothing here asks about: without a graphics card they are a quarter of all drawing."""


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Iterator[None]:
    """A test that fails says what its pages showed: where it runs unwatched nobody sees them."""
    outcome = yield
    report = outcome.get_result()
    if report.failed and item.get_closest_marker("browser"):
        for page in (page for context in _CONTEXTS for page in context.pages if page.url.startswith("http")):
            with suppress(PlaywrightError):
                shown = page.locator("body").aria_snapshot(timeout=10_000)
                report.sections.append((f"page {page.url}", shown))


def until(condition: Callable[[], Any], timeout_s: float = 60.0, what: str = "condition") -> Any:
    """Wait for a truthy value and return it."""
    end = time.monotonic() + timeout_s
    while time.monotonic() < end:
        value = condition()
        if value:
            return value
        time.sleep(0.03)
    raise AssertionError(f"{what} not within {timeout_s:g} s")


def shown_frame(page: Any) -> int:
    """The frame number that the page's headline names, -1 before there is one."""
    text = page.locator("p", has_text=re.compile(r"Frame \d+ of \d+")).first.text_content(timeout=60_000)
    found = re.search(r"Frame (\d+) of", text or "")
    return int(found.group(1)) if found else -1


def tab(page: Any, name: str) -> None:
    # No click is forced: a panel moves while its height changes, and only the browser knows when it has come to rest.
    page.get_by_role("tab", name=name, exact=True).click()


def press(page: Any, name: str) -> None:
    page.get_by_role("button", name=name, exact=True).click()


def own_box(page: Any, label: str) -> Any:
    """A checkbox of the folder that belongs to this browser, which is opened where it is shut."""
    box = page.get_by_label(label)
    if not box.is_visible():
        page.get_by_text("This browser").dispatch_event("click")
        until(box.is_visible, what="folder open")
    return box


def text_entry(page: Any, label: str) -> Any:
    """The text field behind a label."""
    row = page.get_by_text(label, exact=True).locator("xpath=ancestor::*[.//input][1]")
    return row.locator("input").first


def slider_entry(page: Any, label: str) -> Any:
    """The number beside a slider."""
    row = page.get_by_text(label, exact=True).locator("xpath=ancestor::*[.//input][1]")
    return row.locator(".mantine-NumberInput-input").first


WARM = """() => new Promise(done => { let last = performance.now(), calm = 0; function frame() {
  const now = performance.now(); calm = now - last < 120 ? calm + 1 : 0; last = now;
  if (calm > 5) done(true); else requestAnimationFrame(frame); } requestAnimationFrame(frame); })"""
"""Resolves when the 3-D view has compiled its shaders, which takes seconds without a graphics card."""


def warm_page(browser: Any, hub: Hub) -> Any:
    """The page of a hub in a browser, ready to be clicked."""
    opened = browser.new_page()
    opened.goto(f"http://127.0.0.1:{hub.server.get_port()}/")
    opened.wait_for_selector("stereocalib-timeline canvas", timeout=60_000)
    until(lambda: hub.server.get_clients(), what="browser connected")
    opened.evaluate("() => document.querySelector('.mantine-Notification-closeButton')?.click()")
    opened.evaluate(WARM)
    return opened


def start_page(spec: str, root: Path, **options: Any) -> Hub:
    """The app on a drive, at a free port."""
    return app_server.start(spec, port=0, opening=app_server.Opening(root=root, **options))


def computed_page(spec: str, root: Path, timeout_s: float = 300.0, **options: Any) -> Iterator[Hub]:
    """For a fixture to `yield from`: the app on a drive that is computed, standing still."""
    running = start_page(spec, root, **options)
    running.shared.playback.play(False)
    assert running.shared.session.wait(timeout_s)
    yield running
    stop_page(running)


def seen_page(browser: Any, hub: Hub) -> Iterator[Any]:
    """For a fixture to `yield from`: the page of a hub with its first picture."""
    opened = warm_page(browser, hub)
    until(lambda: opened.locator(".sc-picture[data-frame]").count(), what="picture")
    yield opened
    opened.close()


def stop_page(hub: Hub) -> None:
    hub.close()
    stop_server(hub.server)


@pytest.fixture(scope="session")
def hub_06(kitti_06: Path, data_dir: Path) -> Iterator[Hub]:
    """The first 20 frames of a real drive, completely computed."""
    hub = start_page(str(kitti_06), data_dir, frames=(0, 20))
    assert hub.shared.session.wait(90.0)
    yield hub
    stop_page(hub)


@pytest.fixture(scope="session")
def browser(chromium_path: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """A headless Chromium (a playwright browser context) at 1200x660."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        context = playwright.chromium.launch_persistent_context(
            str(tmp_path_factory.mktemp("chromium")),
            executable_path=chromium_path,
            args=[*FLAGS, *PLAIN_DRAWING],
            viewport={"width": 1200, "height": 660},
            accept_downloads=True,
        )
        context.set_default_timeout(60_000)
        _CONTEXTS.append(context)
        yield context
        _CONTEXTS.remove(context)
        context.close()


@pytest.fixture
def open_page(browser: Any) -> Iterator[Callable[[Hub], Any]]:
    """Opens the page of a hub; every request outside its own server is an error."""
    pages: list[Any] = []

    def opened(hub: Hub) -> Any:
        page = browser.new_page()
        pages.append(page)
        own = f"127.0.0.1:{hub.server.get_port()}"
        page.foreign = []

        def note(request: Any) -> None:
            if own not in request.url and not request.url.startswith(("data:", "blob:")):
                page.foreign.append(request.url)

        page.on("request", note)
        before = set(hub.server.get_clients())
        page.goto(f"http://{own}/")
        page.wait_for_selector("stereocalib-timeline canvas", timeout=60_000)
        until(lambda: set(hub.server.get_clients()) - before, what="browser connected")
        page.client_id = max(set(hub.server.get_clients()) - before)
        return page

    yield opened
    for page in pages:
        page.close()


@pytest.fixture
def fresh(hub_06: Hub) -> Hub:
    """The shared page of `hub_06` as at the start."""
    from stereocalib_app.drive.settings import Settings

    hub_06.leader = None
    for number in list(hub_06._own):
        hub_06.attach(hub_06.server.get_clients()[number])
    hub_06.shared.playback.play(False)
    hub_06.shared.playback.set_loop(False)
    hub_06.shared.playback.set_pause_on_failure(False)
    hub_06.shared.playback.set_speed(1.0)
    hub_06.shared.settings = Settings()
    hub_06.shared.compared = None
    hub_06.shared.playback.seek(0)
    until(lambda: hub_06.shared.shown_frame == 0, what="first frame")
    return hub_06
