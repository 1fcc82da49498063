"""The page on a real drive, read through a real browser."""

from __future__ import annotations

import re
from typing import Any

import pytest
from conftest import press, shown_frame, tab, until
from stereocalib_app.server.hub import Hub

pytestmark = pytest.mark.browser


def numbers(page: Any) -> str:
    """The estimates that the page shows for its frame."""
    return page.locator("table", has_text="this pair").first.text_content()


def test_frames_advance_and_estimates_change(fresh: Hub, open_page: Any) -> None:
    page = open_page(fresh)
    assert until(lambda: shown_frame(page) == 0, what="first frame in the browser")
    first = numbers(page)
    assert re.search(r"1\.[5-7]\d\d ± 0\.0", first), first
    page.get_by_role("button", name="play", exact=True).click()
    until(lambda: shown_frame(page) >= 5, what="playback")
    assert numbers(page) != first
    until(lambda: not fresh.shared.playback.state.playing, what="end of the drive")
    assert until(lambda: shown_frame(page) == 19, what="last frame")
    assert page.foreign == []


def test_step_scrub_and_exact_entry(fresh: Hub, open_page: Any) -> None:
    page = open_page(fresh)
    page.get_by_role("button", name="step ▶").click()
    until(lambda: shown_frame(page) == 1, what="step")
    page.get_by_role("button", name="◀ step").click()
    until(lambda: shown_frame(page) == 0, what="step back")
    entry = page.locator(".mantine-NumberInput-input").first
    entry.fill("13")
    entry.press("Enter")
    until(lambda: shown_frame(page) == 13, what="exact entry")
    titles = page.locator("p", has_text="Frame 13")
    assert titles.count() >= 1


def test_hotkeys(fresh: Hub, open_page: Any) -> None:
    page = open_page(fresh)
    page.mouse.click(650, 200)
    page.keyboard.press("n")
    until(lambda: shown_frame(page) == 1, what="N")
    page.keyboard.press("Shift+N")
    until(lambda: shown_frame(page) == 11, what="Shift+N")
    page.keyboard.press("p")
    until(lambda: shown_frame(page) == 10, what="P")
    page.keyboard.press("End")
    until(lambda: shown_frame(page) == 19, what="End")
    page.keyboard.press("Home")
    until(lambda: shown_frame(page) == 0, what="Home")
    page.keyboard.press("3")
    until(lambda: page.get_by_text("Every number is within its limits").is_visible(), what="Debug by its key")
    page.keyboard.press("Space")
    until(lambda: fresh.shared.playback.state.playing, what="Space plays")


def test_speed_and_loop(fresh: Hub, open_page: Any) -> None:
    page, clock = open_page(fresh), fresh.shared.playback
    tab(page, "Playback")
    press(page, "4×")
    page.get_by_label("Loop").click()
    until(lambda: clock.state.speed == 4.0 and clock.state.loop, what="speed and loop")
    filled = "e => getComputedStyle(e).backgroundColor !== 'rgba(0, 0, 0, 0)'"
    chosen = page.get_by_role("button", name="4×", exact=True)
    until(lambda: chosen.evaluate(filled), what="4× marked")
    assert not page.get_by_role("button", name="1×", exact=True).evaluate(filled)
    tab(page, "Time line")
    clock.seek(16)
    until(lambda: shown_frame(page) == 16, what="near the end")
    press(page, "play")
    until(lambda: 0 <= shown_frame(page) < 12, what="round the end")
    assert clock.state.playing
    assert page.get_by_text("4×").first.is_visible()
