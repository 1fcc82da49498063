"""Every feature of the page through a real browser; one page for all of them, put back before each."""

from __future__ import annotations

import io
import json
import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from conftest import WARM, own_box, press, shown_frame, slider_entry, tab, until, warm_page
from stereocalib_app.cli.arguments import build_parser
from stereocalib_app.drive.frame_views import MOVING_PX
from stereocalib_app.drive.page_words import from_words
from stereocalib_app.server.hub import Hub
from stereocalib_app.words.lessons import LESSONS

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def page(hub_06: Hub, browser: Any) -> Iterator[Any]:
    opened = warm_page(browser, hub_06)
    yield opened
    opened.close()


@pytest.fixture(autouse=True)
def _put_back(fresh: Hub, page: Any) -> None:
    until(lambda: shown_frame(page) == 0, what="frame 0 in the browser")


def test_inspect_answers_first_and_the_card_can_be_copied(page: Any) -> None:
    tab(page, "Guide")
    press(page, "Inspect")
    card = page.locator("table", has_text="height").first.text_content()
    assert re.search(r"height1\.[56]\d\d ± 0\.0", card), card
    assert "pitch" in card
    assert "yaw" in card
    button = page.get_by_role("button", name="Copy the card")
    copied = button.get_attribute("data-text")
    assert "06: how this camera is mounted" in copied
    button.click()
    until(lambda: page.get_by_role("button", name="Copied").count(), what="copied")


def test_teach_walks_and_breaks_and_mends(page: Any, fresh: Hub) -> None:
    tab(page, "Guide")
    press(page, "Teach")
    until(lambda: page.get_by_text(f"Step 1 of {len(LESSONS)}: Disparity").is_visible(), what="first step")
    assert page.locator("math mfrac").count() == 1
    assert fresh.shared.settings.layout == "disparity"
    for step in range(1, 5):
        press(page, "next ▶")
        until(lambda step=step: fresh.shared.settings.teach_step == step, what="next step")
    until(
        lambda: page.get_by_text(f"Step 5 of {len(LESSONS)}: Pitch and height").is_visible(),
        what="fifth step",
    )
    page.get_by_role("button", name="Break it: add 1° of pitch").click()
    until(lambda: fresh.shared.settings.corrections.pitch_error_deg == 1.0, what="broken")
    until(lambda: page.get_by_text("the live horizon and road").is_visible(), what="effect told")
    page.get_by_role("button", name="Mend it").click()
    until(lambda: not fresh.shared.settings.corrections.touched, what="mended")


def test_a_broken_stage_changes_the_pictures_only(page: Any, fresh: Hub) -> None:
    before = fresh.shared.session.snapshot.results
    fresh.shared.parts["Teach"].go(1)
    fresh.shared.parts["Teach"].break_it()
    whole = fresh.shared.session.views_with("").stages(0).stages
    broken = fresh.shared.session.views_with("no obstacles").stages(0).stages
    assert whole is not None
    assert broken is not None
    assert broken.obstacles.sum() == 0 < whole.obstacles.sum()
    assert fresh.shared.session.snapshot.results is before


def test_debug_shows_limits(page: Any) -> None:
    tab(page, "Guide")
    press(page, "Debug")
    until(lambda: page.get_by_text("Every number is within its limits").is_visible(), what="verdict")
    assert page.get_by_text("mean grey").first.is_visible()


def test_corrections_redraw_the_live_path(page: Any, fresh: Hub) -> None:
    tab(page, "Correct")
    entry = slider_entry(page, "pitch used %")
    entry.fill("0")
    entry.press("Enter")
    until(lambda: fresh.shared.settings.corrections.pitch_strength == 0.0, what="slider")
    until(lambda: page.get_by_text("live: pitch 0 %").is_visible(), what="state")
    tab(page, "Paths")
    until(lambda: page.locator("tr", has_text="live settings").count() == 1, what="live path in the table")
    error = [
        float(page.locator("tr", has_text=name).first.locator("td").nth(2).text_content())
        for name in ("autocalibrated", "live settings")
    ]
    assert error[1] > 1.2 * error[0]
    tab(page, "Correct")
    press(page, "A / B")
    until(lambda: not fresh.shared.settings.corrections.touched, what="A")
    press(page, "A / B")
    until(lambda: fresh.shared.settings.corrections.pitch_strength == 0.0, what="B")
    press(page, "Reset")
    until(lambda: not fresh.shared.settings.corrections.touched, what="reset")
    tab(page, "Guide")


def test_paths_can_be_hidden(page: Any, fresh: Hub) -> None:
    tab(page, "Paths")
    page.get_by_label("no roll", exact=True).click()
    until(lambda: fresh.shared.settings.paths.get("no_roll") is False, what="hidden")
    until(lambda: fresh.shared.scene.scene._paths["no_roll"].visible is False, what="hidden in the scene")
    page.get_by_label("Colour by error").click()
    until(lambda: fresh.shared.settings.color_by_error, what="coloured")
    until(
        lambda: fresh.shared.scene.scene._paths["autocalibrated"].colors.ndim == 3,
        what="colours along the path",
    )
    tab(page, "Guide")


def test_one_stage_large(page: Any, fresh: Hub) -> None:
    page.get_by_role("button", name="Show v-disparity large").click()
    until(lambda: fresh.shared.settings.layout == "v-disparity", what="layout")
    until(lambda: page.get_by_text("A flat road is a straight line").is_visible(), what="explanation")


@pytest.mark.parametrize(
    ("label", "name"),
    [
        ("Trajectory, TUM", "trajectory.tum"),
        ("Trajectory, KITTI", "trajectory.txt"),
        ("Extrinsics, CSV", "extrinsics.csv"),
        ("Report, JSON", "report.json"),
        ("Figure sheet, PNG", "figures.png"),
        ("Recording, rrd", "recording.rrd"),
    ],
)
def test_exports(page: Any, label: str, name: str, tmp_path: Path) -> None:
    tab(page, "Export")
    with page.expect_download(timeout=40_000) as download:
        press(page, label)
    path = tmp_path / name
    download.value.save_as(path)
    assert download.value.suggested_filename == f"06_frames_0-19_{name}"
    if name.endswith(".png"):
        picture = cv2.imread(str(path))
        assert picture.shape[0] > 800
        return
    if name.endswith(".rrd"):
        assert path.read_bytes()[:3] == b"RRF"
        return
    text = path.read_text()
    if name == "report.json":
        assert json.loads(text)["frames"] == 20
    elif name == "extrinsics.csv":
        assert len(text.splitlines()) == 21
        assert text.startswith("frame,timestamp_s,status")
    else:
        numbers = np.loadtxt(io.StringIO(text))
        assert numbers.shape == (20, 8 if name.endswith("tum") else 12)
        z = numbers[:, 3] if name.endswith("tum") else numbers[:, 11]
        assert 15 < z[-1] < 35


def test_the_command_that_reproduces_this(page: Any) -> None:
    tab(page, "Export")
    copied = page.get_by_role("button", name="computes these numbers").get_attribute("data-text")
    assert copied.startswith("stereocalib run ")
    assert "--frames 0:20" in copied
    assert copied.split()[2].endswith("sequences/06")


def test_the_command_that_shows_this_page(page: Any, fresh: Hub) -> None:
    """What it copies opens a page with the same settings at the same frame."""
    fresh.shared.choose("Debug")
    fresh.shared.what_if.set(pitch_error_deg=0.25)
    fresh.shared.playback.seek(11)
    tab(page, "Export")
    copy = page.get_by_role("button", name="shows this page")
    until(lambda: "--at 11" in copy.get_attribute("data-text"), what="frame in the command")
    _, *words = shlex.split(copy.get_attribute("data-text"))
    arguments = build_parser().parse_args(words)
    assert arguments.command == "view"
    assert arguments.at == 11
    assert from_words(arguments.set) == fresh.shared.settings


def test_light_theme_in_this_browser(page: Any) -> None:
    tab(page, "Guide")
    own_box(page, "Light theme").dispatch_event("click")
    scheme = "() => document.documentElement.dataset.mantineColorScheme"
    until(lambda: page.evaluate(scheme) == "light", what="light")
    until(lambda: page.evaluate(CONTRAST, INK) > 4.5, what="readable on light")
    own_box(page, "Light theme").dispatch_event("click")
    until(lambda: page.evaluate(scheme) == "dark", what="dark")
    until(lambda: page.evaluate(CONTRAST, INK) > 4.5, what="readable on dark")


INK = "[role=tab], button.mantine-Button-root, label, p"
CONTRAST = """of => { const shade = css => { const c = css.match(/[\\d.]+/g).slice(0, 3).map(v => v / 255)
    .map(v => v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
    return 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2]; };
  return Math.min(...[...document.querySelectorAll(of)].map(e => { let under = e, back;
    do { back = getComputedStyle(under).backgroundColor; under = under.parentElement; }
    while (under && /, 0\\)|transparent/.test(back));
    const [a, b] = [shade(getComputedStyle(e).color), shade(back)].sort((x, y) => y - x);
    return (a + 0.05) / (b + 0.05); })); }"""
"""The least contrast between ink and paper (1...21) of everything that a selector finds."""


def test_explore_on_my_own_and_come_back(page: Any, fresh: Hub) -> None:
    tab(page, "Guide")
    own_box(page, "Explore on my own").dispatch_event("click")
    until(lambda: fresh.count()[1] == 1, what="detached")
    own = until(lambda: next(iter(fresh._own.values()), None), what="own page")
    until(lambda: own.shown_frame == 0, what="own page shown")
    until(lambda: page.get_by_text("exploring on your own").count() == 1, what="own page in the browser")
    until(lambda: page.get_by_role("button", name="step ▶").count() == 1, what="the shared page is hidden")
    press(page, "step ▶")
    until(lambda: own.shown_frame == 1, what="own step")
    assert fresh.shared.shown_frame == 0
    fresh.shared.playback.seek(9)
    until(lambda: fresh.shared.shown_frame == 9, what="lead moves on")
    assert until(lambda: shown_frame(page) == 1, what="own frame stays")
    own_box(page, "Explore on my own").dispatch_event("click")
    until(lambda: fresh.count()[1] == 0, what="attached")
    until(lambda: shown_frame(page) == 9, what="back on the shared time line")


def test_followers_do_not_steer_while_somebody_leads(page: Any, fresh: Hub) -> None:
    fresh.leader = 10_000
    press(page, "step ▶")
    until(lambda: page.get_by_text("The lecturer leads").count(), what="told why")
    assert fresh.shared.playback.state.frame == 0
    fresh.leader = None
    press(page, "step ▶")
    until(lambda: shown_frame(page) == 1, what="free again")


def test_open_tells_kindly_what_is_wrong(page: Any) -> None:
    tab(page, "Open")
    entry = (
        page.get_by_text("Source", exact=True)
        .locator("xpath=ancestor::*[.//input][1]")
        .locator("input")
        .first
    )
    entry.fill("../../etc")
    entry.press("Tab")
    press(page, "Open")
    until(lambda: page.get_by_text("outside the folder that the page may read").count(), what="refused")
    entry.fill("no/such<b>place")
    entry.press("Tab")
    press(page, "Open")
    until(lambda: page.get_by_text("no such folder").count(), what="told")
    assert page.locator("b", has_text="place").count() == 0
    tab(page, "Guide")


def test_markers_lead_to_their_frame(page: Any, fresh: Hub) -> None:
    scene = fresh.shared.scene
    tab(page, "Paths")
    page.get_by_label("Pose markers").click()
    until(lambda: fresh.shared.settings.markers, what="markers wanted")
    until(lambda: scene._marked, what="markers")
    assert scene._marked == tuple(range(20))
    entries = scene.scene._markers._impl.click_cb  # type: ignore[union-attr]
    assert entries


def test_a_frame_compiles_no_shader_again(page: Any, fresh: Hub) -> None:
    """That takes a browser without a graphics card longer than everything else of a frame."""

    def walk(first: int, stop: int) -> None:
        for frame in range(first, stop):
            fresh.shared.playback.seek(frame)
            until(lambda wanted=frame: shown_frame(page) == wanted, what=f"frame {frame}")
            page.evaluate(
                "() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"
            )

    walk(1, 7)  # what comes into sight for the first time is compiled then
    page.evaluate(WARM)
    page.evaluate(
        "() => { const P = WebGL2RenderingContext.prototype, o = P.linkProgram; window.linked = 0;"
        " P.linkProgram = function (program) { window.linked++; return o.call(this, program); }; }"
    )
    walk(7, 13)
    assert page.evaluate("window.linked") <= 1


def test_pictures_are_smaller_while_the_drive_plays(page: Any, fresh: Hub) -> None:
    width = "() => Number(document.querySelector('.sc-picture').dataset.size.split('x')[0])"
    whole = fresh.shared.session.source.camera.width
    until(lambda: page.evaluate(width) == whole, what="full picture at rest")
    fresh.shared.playback.set_speed(0.25)
    press(page, "play")
    until(lambda: 0 < page.evaluate(width) <= 1.5 * MOVING_PX < whole, what="smaller picture")
    press(page, "pause")
    until(lambda: page.evaluate(width) == whole, what="full picture again")


def test_a_panel_that_is_folded_away_takes_no_style_with_it(page: Any) -> None:
    border = "() => getComputedStyle(document.documentElement).getPropertyValue('--mantine-color-dimmed')"
    dimmed = page.evaluate(border)
    corner = page.viewport_size["width"] - 13, 7
    page.mouse.click(*corner)
    until(lambda: page.get_by_role("button", name="Teach").count() == 0, what="right panel folded away")
    assert page.evaluate(border) == dimmed == "#9a9da3"
    page.mouse.click(*corner)
    until(lambda: page.get_by_role("button", name="Teach").count() == 1, what="right panel back")
