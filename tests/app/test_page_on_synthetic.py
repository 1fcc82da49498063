"""The page on a rendered drive that is broken on purpose, through a real browser: from the card to the cause."""

from __future__ import annotations

import shutil
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import (
    computed_page,
    press,
    seen_page,
    shown_frame,
    slider_entry,
    stop_page,
    tab,
    text_entry,
    until,
)
from stereocalib_app.drive import debut
from stereocalib_app.drive import serve as app_server
from stereocalib_app.drive.scene import Scene
from stereocalib_app.drive.scene_part import ScenePart
from stereocalib_app.server.first_look import begin
from stereocalib_app.server.hub import Hub
from stereocalib_app.words.lessons import LESSONS

from stereocalib_core.results import Tolerance
from stereocalib_core.run.drive import run_drive

pytestmark = pytest.mark.browser

FRAMES, DARK = 24, (14, 16)
DRIVE = f"synthetic:town?frames={FRAMES}&fault=drop@{DARK[0]}-{DARK[1]}"
LIMITS = {"height_m": Tolerance(1.65, 0.05), "pitch_rad": Tolerance(*np.deg2rad([3.0, 0.2]))}


FITS = "of => { const e = document.querySelector(of); return e.scrollWidth <= e.clientWidth; }"


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("synthetic")
    run_drive("synthetic:plane?frames=6", folder / "plane run")
    return folder


@pytest.fixture(scope="module")
def hub(root: Path) -> Iterator[Hub]:
    yield from computed_page(DRIVE, root, limits=LIMITS)


@pytest.fixture(scope="module")
def page(hub: Hub, browser: Any) -> Iterator[Any]:
    yield from seen_page(browser, hub)


def test_the_card_names_each_axis_within_or_outside(page: Any, hub: Hub) -> None:
    press(page, "Inspect")
    row = page.locator("tr", has_text="✓ within 1.65 ± 0.05 m").first
    until(row.is_visible, what="height within")
    assert row.text_content().startswith("height")
    assert page.locator("tr", has_text="✗ OUTSIDE 3 ± 0.2°").first.text_content().startswith("pitch")
    assert page.get_by_text("✗ mount OUTSIDE tolerance").is_visible()
    copied = page.get_by_role("button", name="Copy the card").get_attribute("data-text")
    assert "(✗ OUTSIDE 3 ± 0.2°)" in copied
    assert "tolerance: ✗ mount OUTSIDE tolerance" in copied


def test_every_lesson_breaks_and_mends(page: Any, hub: Hub) -> None:
    tab(page, "Guide")
    press(page, "Teach")
    for number, lesson in enumerate(LESSONS):
        until(lambda n=number: page.get_by_text(f"Step {n + 1} of {len(LESSONS)}").is_visible(), what="step")
        until(lambda wanted=lesson.latex: page.locator("math").count() == len(wanted), what="equations")
        assert all(line.bounding_box()["height"] > 5 for line in page.locator("math").all()), lesson.title
        until(lambda: page.evaluate(FITS, ".equations"), what=f"{lesson.title}: equations in their box")
        page.get_by_role("button", name="Break it").click()
        until(lambda: page.get_by_text("Broken:").is_visible(), what=f"{lesson.title} broken")
        settings = hub.shared.settings
        assert settings.broken_stage or settings.corrections.touched
        page.get_by_role("button", name="Mend it").click()
        until(
            lambda: not (hub.shared.settings.broken_stage or hub.shared.settings.corrections.touched),
            what=f"{lesson.title} mended",
        )
        press(page, "next ▶")
    until(lambda: page.get_by_text(f"Step 1 of {len(LESSONS)}").is_visible(), what="round")


def test_equations_fit_whatever_the_fonts_of_the_machine(page: Any, hub: Hub) -> None:
    """Letters half as large again stand for a wide font."""
    wide = page.add_style_tag(content=".equations math { font-size: 150% }")
    tab(page, "Guide")
    press(page, "Teach")
    longest = max(range(len(LESSONS)), key=lambda n: max(map(len, LESSONS[n].latex)))
    hub.shared.parts["Teach"].go(longest)
    until(lambda: page.get_by_text(f"Step {longest + 1} of").is_visible(), what="step")
    until(lambda: page.evaluate(FITS, ".equations"), what="equations in their box")
    size = page.locator(".equations").evaluate("e => parseFloat(getComputedStyle(e).fontSize)")
    wide.evaluate("e => e.remove()")
    hub.shared.parts["Teach"].go(longest - 1)
    hub.shared.parts["Teach"].go(longest)
    until(lambda: page.get_by_text(f"Step {longest + 1} of").is_visible(), what="step")
    plain = page.locator(".equations")
    until(lambda: plain.evaluate("e => parseFloat(getComputedStyle(e).fontSize)") > 1.2 * size, what="larger")


def test_debug_leads_to_the_failure_and_says_why(page: Any, hub: Hub) -> None:
    hub.shared.playback.seek(0)
    tab(page, "Guide")
    press(page, "Debug")
    page.get_by_label("Failures").click()
    entry = page.get_by_role("option", name=f"{DARK[0]} to")
    until(entry.is_visible, what="list of failures")
    assert page.get_by_role("option", name=f"{DARK[1] - DARK[0] + 1} frames: choose where to go").count() == 1
    entry.click()
    until(lambda: shown_frame(page) == DARK[0], what="at the failure")
    until(lambda: page.get_by_text(f"Frame {DARK[0]} failed").count(), what="verdict")
    assert page.get_by_text("Likely cause:").is_visible()
    assert page.get_by_text("What to do:").is_visible()


def test_playback_stops_at_a_failure_and_failures_go_round(page: Any, hub: Hub) -> None:
    clock = hub.shared.playback
    tab(page, "Playback")
    page.get_by_label("Pause on failure").click()
    until(lambda: clock.state.pause_on_failure, what="pause wanted")
    tab(page, "Time line")
    clock.seek(DARK[0] - 3)
    until(lambda: shown_frame(page) == DARK[0] - 3, what="before the failure")
    press(page, "play")
    until(lambda: shown_frame(page) == DARK[0] and not clock.state.playing, what="stopped at the failure")
    for wanted in (DARK[0] + 1, DARK[1], DARK[0]):
        page.get_by_role("button", name="failure ▶").last.click()
        until(lambda frame=wanted: shown_frame(page) == frame, what=f"failure {wanted}")
    until(lambda: page.get_by_text("Round the end").count(), what="told that it went round")
    page.keyboard.press("Shift+F")
    until(lambda: shown_frame(page) == DARK[1], what="round the other way")
    clock.set_pause_on_failure(False)


def test_a_fault_is_switched_on_live_and_off_again(page: Any, hub: Hub) -> None:
    """Only the frames from the fault on are computed again."""
    before = hub.shared.session
    hub.shared.playback.seek(6)
    until(lambda: shown_frame(page) == 6, what="frame 6")
    tab(page, "Guide")
    press(page, "Debug")
    page.get_by_label("Fault").click()
    page.get_by_role("option", name="drop").click()
    press(page, "Switch on")
    until(lambda: hub.shared.session is not before, what="new drive")
    assert hub.shared.session.wait(60.0)
    results = hub.shared.session.snapshot.results
    assert [r.reason for r in results[5:7]] == ["", "MISSING_PAIR"]
    kept = [a is b for a, b in zip(results, before.snapshot.results, strict=True)]
    assert kept[:5] == [True] * 5
    assert not any(kept[6:])
    until(lambda: page.get_by_text("Frame 6 failed: MISSING_PAIR").count(), what="told")
    assert shown_frame(page) == 6
    press(page, "All off")
    until(lambda: hub.shared.session.spec == "synthetic:town?frames=24", what="all off")
    assert hub.shared.session.wait(60.0)
    assert all(r.ok for r in hub.shared.session.snapshot.results)
    until(lambda: page.get_by_text("Frame 6 is ok").count(), what="mended")


def test_following_and_standing_back(page: Any, hub: Hub) -> None:
    camera = next(iter(hub.server.get_clients().values())).camera
    page.mouse.click(620, 120)
    page.keyboard.press("c")
    until(lambda: not hub.shared.settings.follow, what="standing back")
    until(lambda: camera.position[1] < -12.0, what="camera above")
    page.keyboard.press("c")
    until(lambda: hub.shared.settings.follow and camera.position[1] > -7.0, what="following")


def test_the_command_palette_finds_everything(page: Any, hub: Hub) -> None:
    page.mouse.click(620, 120)
    page.keyboard.press("Control+k")
    entry = page.get_by_placeholder("Search").last
    until(lambda: page.get_by_text("Last frame").count(), what="palette")
    entry.fill("last fr")
    page.keyboard.press("Enter")
    until(lambda: hub.shared.playback.state.frame == FRAMES - 1, what="last frame")
    until(lambda: page.get_by_placeholder("Search").count() == 0, what="palette shut")


def test_help_on_hovering(page: Any) -> None:
    tab(page, "Correct")
    slider_entry(page, "pitch used %").hover(force=True)
    until(lambda: page.get_by_text("0 % takes the pitch as zero").count(), what="hint")
    tab(page, "Guide")


def test_another_run_beside_and_the_same_taken_away(page: Any, hub: Hub) -> None:
    tab(page, "Open")
    entry = text_entry(page, "Run")
    entry.fill("plane run")
    entry.press("Tab")
    press(page, "Compare side by side")
    until(lambda: page.locator("tr", has_text="other − this").count(), what="differences")
    assert page.get_by_text("other run, in time line and 3-D").is_visible()
    press(page, "Take the other run away")
    until(lambda: not page.locator("tr", has_text="other − this").count(), what="taken away")


def test_an_earlier_run_opens_with_everything(page: Any, hub: Hub) -> None:
    tab(page, "Open")
    entry = text_entry(page, "Source")
    entry.fill("plane run")
    entry.press("Tab")
    press(page, "Open")
    until(lambda: page.get_by_text("run plane run").count(), what="run open")
    assert hub.shared.session.wait(20.0)
    assert all(r.checks and r.ok for r in hub.shared.session.snapshot.results)
    tab(page, "Correct")
    number = slider_entry(page, "pitch added °")
    number.fill("0.5")
    number.press("Enter")
    until(lambda: "live" in hub.shared.scene.scene._paths, what="live path of a run")
    tab(page, "Export")
    copied = page.get_by_role("button", name="computes these numbers").get_attribute("data-text")
    assert copied.startswith("stereocalib run 'synthetic:plane?frames=6' --out out")


def test_a_zip_is_uploaded(page: Any, hub: Hub, tmp_path: Path) -> None:
    from stereocalib_core.run.synth import synth

    synth(tmp_path / "drive", "plane", {"frames": "3"}, [], None)
    archive = Path(shutil.make_archive(str(tmp_path / "mine"), "zip", tmp_path / "drive"))
    assert zipfile.is_zipfile(archive)
    tab(page, "Open")
    with page.expect_file_chooser() as chooser:
        press(page, "Upload a zip")
    chooser.value.set_files(str(archive))
    until(lambda: hub.shared.playback.total == 3, what="uploaded drive")
    assert hub.shared.session.wait(60.0)


def test_a_browser_that_comes_before_the_drive_sees_pictures_first_and_then_the_rest(
    root: Path, browser: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As from the command line: the page is loaded while the drive is not there yet."""
    happened: list[str] = []
    drawn, built = debut.Debut.drawn, ScenePart._build

    def heard(self: debut.Debut, frame: int) -> None:
        happened.append("drawn")
        drawn(self, frame)

    def begun_3d(self: ScenePart) -> Scene:
        happened.append("3-D view")
        return built(self)

    monkeypatch.setattr(debut, "LONGEST_S", 600.0)
    monkeypatch.setattr(debut.Debut, "drawn", heard)
    monkeypatch.setattr(ScenePart, "_build", begun_3d)
    begun = begin("127.0.0.1", 0)
    early = browser.new_page()
    early.goto(f"http://127.0.0.1:{begun.server.get_port()}/")
    running = app_server.start("synthetic:plane?frames=6", opening=app_server.Opening(root=root), begun=begun)
    try:
        until(lambda: early.locator(".sc-picture[data-frame]").count(), what="picture")
        until(lambda: "3-D view" in happened, what="3-D view")
        assert happened[0] == "drawn"
        early.wait_for_selector("stereocalib-timeline canvas", timeout=60_000)
        assert running.shared.session.wait(60.0)
        until(lambda: "autocalibrated" in running.shared.scene.scene._paths, what="path in 3-D")
    finally:
        early.close()
        stop_page(running)
