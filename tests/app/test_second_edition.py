"""The page round the drive, in a real browser: a phone, panels that stay in place, scales, names, long work."""

from __future__ import annotations

import re
import time
import zipfile
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from conftest import computed_page, press, seen_page, shown_frame, tab, text_entry, until
from stereocalib_app.drive.lesson_marks import path_around
from stereocalib_app.drive.path_state import PathErrors, PathState
from stereocalib_app.drive.settings import Corrections
from stereocalib_app.drive.summary import alike_words, error_scale, path_table
from stereocalib_app.server.docking import read_docking
from stereocalib_app.server.hub import Hub
from stereocalib_app.widgets.long_work import LongWork
from stereocalib_app.words.lessons import LESSONS

from stereocalib_core.back.evaluation import evaluate
from stereocalib_core.errors import SourceError
from stereocalib_core.sources.archive_files import unpack
from stereocalib_core.system import opening

FRAMES = 24
DRIVE = f"synthetic:town?frames={FRAMES}&fault=drop@14-16"
PHONE, DESK = {"width": 390, "height": 844}, {"width": 1200, "height": 660}


@pytest.fixture(scope="module")
def hub(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Hub]:
    yield from computed_page(DRIVE, tmp_path_factory.mktemp("root"))


@pytest.fixture(scope="module")
def page(hub: Hub, browser: Any) -> Iterator[Any]:
    yield from seen_page(browser, hub)


@pytest.fixture(autouse=True)
def _put_back(hub: Hub) -> None:
    hub.shared.playback.play(False)
    hub.shared.change(layout="left image", preset="Inspect", color_by_error=False)
    hub.shared.playback.seek(0)


@pytest.mark.browser
def test_on_a_phone_picture_time_line_and_card_are_usable(page: Any, hub: Hub) -> None:
    page.set_viewport_size(PHONE)
    phone = page.locator("main.sc-phone")
    until(lambda: phone.count() == 1, what="the page for phones")
    for part in (".sc-picture[data-frame]", ".sc-time", ".sc-card table"):
        until(lambda part=part: phone.locator(part).count() >= 1, what=part)
        box = phone.locator(part).first.bounding_box()
        assert box["x"] >= 0, part
        assert box["x"] + box["width"] <= PHONE["width"], part
        assert box["width"] > 0.75 * PHONE["width"], part
    assert phone.evaluate("e => e.scrollWidth <= e.clientWidth")
    for name in ("Previous failure", "Step back", "Play or pause", "Step on", "Next failure"):
        box = phone.get_by_role("button", name=name, exact=True).bounding_box()
        assert box["height"] >= 36
        assert box["x"] + box["width"] <= PHONE["width"]
    phone.get_by_role("button", name="Next failure").click()
    until(
        lambda: "failed: MISSING_PAIR" in phone.get_by_role("status").text_content(), what="failure and why"
    )
    phone.get_by_role("button", name="Step back").click()
    until(lambda: hub.shared.playback.state.frame == 13, what="step")
    line = phone.locator(".sc-time")
    box = line.bounding_box()
    line.click(position={"x": 46 + 5 / (FRAMES - 1) * (box["width"] - 54), "y": 50})
    until(lambda: phone.locator(".sc-picture[data-frame='5']").count(), what="seek by the time line")
    assert "How this camera is mounted" in phone.locator(".sc-card").text_content()
    phone.get_by_role("button", name="3-D and controls").click()
    until(lambda: phone.count() == 0, what="viser's own page")
    page.get_by_role("button", name="Picture and card").click()
    until(lambda: phone.count() == 1, what="back")
    page.set_viewport_size(DESK)
    until(lambda: phone.count() == 0, what="a wide window")
    until(lambda: shown_frame(page) == 5, what="the same page")


@pytest.mark.browser
def test_panels_stay_where_they_were_put(page: Any, hub: Hub) -> None:
    """Dragged, then reloaded: the panel of the time line is where it was left."""
    where = (
        "() => document.querySelector('stereocalib-timeline').closest('[data-floating-window]')"
        "?.getBoundingClientRect().toJSON()"
    )
    until(lambda: page.evaluate(where), what="floating panel")
    before = page.evaluate(where)
    x, y = before["x"] + before["width"] / 2, before["y"] + 7
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 6, y - 60, steps=5)
    page.mouse.move(x + 10, y - 120, steps=5)
    page.mouse.up()
    kept = "() => JSON.parse(localStorage.getItem('stereocalib.docking') || '{}').plots"
    until(lambda: page.evaluate(kept), what="remembered")
    after = page.evaluate(where)
    assert after["y"] < before["y"] - 80
    page.reload()
    until(lambda: page.locator(".sc-picture[data-frame]").count(), what="page again")
    until(lambda: abs((page.evaluate(where) or before)["y"] - after["y"]) < 12, what="where it was left")
    page.evaluate("() => localStorage.removeItem('stereocalib.docking')")
    page.reload()
    until(lambda: page.locator(".sc-picture[data-frame]").count(), what="page again")
    until(lambda: abs((page.evaluate(where) or after)["y"] - before["y"]) < 12, what="where it begins")


def test_what_a_browser_says_of_its_panels_may_be_anything() -> None:
    good = {"at": "left", "width": 400}
    assert set(read_docking({"views": good, "plots": {"at": "float", "width": 500, "x": 3, "y": -8}})) == {
        "views",
        "plots",
    }
    for bad in (None, [], "x", {"at": "top", "width": 400}, {"at": "left", "width": 1e9}, {"at": "left"},
                {"at": "float", "width": 400, "x": float("nan"), "y": 0}, {"at": "left", "width": True}):  # fmt: skip
        assert read_docking({"views": bad}) == {}
    assert read_docking({"elsewhere": good}) == read_docking(None) == {}


@pytest.mark.browser
def test_colour_by_error_has_a_scale(page: Any, hub: Hub) -> None:
    tab(page, "Paths")
    page.get_by_label("Colour by error").click()
    bar = page.get_by_role("img", name=re.compile("Autocalibrated path, off the truth by: from 0 m to"))
    until(lambda: bar.count() >= 1, what="scale")
    largest = np.nanmax(hub.shared._paths.errors["autocalibrated"].miss_m)
    assert f"{largest:.2f} m" in bar.first.get_attribute("aria-label")
    tab(page, "Guide")


def test_without_a_truth_nothing_is_coloured_and_that_is_said() -> None:
    poses = np.tile(np.eye(4), (3, 1, 1))
    errors = {"autocalibrated": PathErrors(evaluate(poses, None))}
    assert "cannot be coloured" in error_scale(PathState({"autocalibrated": poses}, errors))


def test_two_paths_that_are_the_same_say_why() -> None:
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, 2, 3] = (0.0, 1.0, 2.0)
    other = poses.copy()
    other[2, 0, 3] = 0.3
    errors = {name: PathErrors(evaluate(poses, None)) for name in ("autocalibrated", "no_yaw")}
    alike = PathState({"autocalibrated": poses, "no_yaw": poses.copy()}, errors)
    assert "measure how the camera itself moves" in path_table(alike, "full")
    assert "has shown no yaw" in alike_words(alike, "nonholonomic")
    assert alike_words(PathState({"autocalibrated": poses, "no_yaw": other}, errors), "full") == ""


@pytest.mark.browser
def test_paths_that_are_the_same_say_why_on_the_page(page: Any, hub: Hub) -> None:
    tab(page, "Paths")
    said = page.get_by_text("No yaw and autocalibrated are the same path here, and that is right")
    until(lambda: said.count() >= 1, what="why two rows are equal")
    hub.shared.change(corrections=Corrections(model="nonholonomic", yaw_error_deg=1.0))
    until(lambda: said.count() == 0, what="nothing to explain where they differ")
    hub.shared.change(corrections=Corrections())
    tab(page, "Guide")


@pytest.mark.browser
def test_a_class_plays_the_quiz(page: Any, hub: Hub, monkeypatch: pytest.MonkeyPatch) -> None:
    roll = next(i for i, lesson in enumerate(LESSONS) if lesson.title == "Roll")
    monkeypatch.setattr("stereocalib_app.drive.panels.teach.random.randrange", lambda _count: roll)
    tab(page, "Guide")
    press(page, "Teach")
    page.get_by_text("Quiz", exact=True).click()
    page.get_by_role("button", name="Break something").click()
    until(lambda: hub.shared.settings.corrections.roll_error_deg == 2.0, what="broken")
    until(lambda: page.get_by_text("Something is broken. Which step is it?").count(), what="the question")
    assert page.get_by_text("Broken:").count() == 0
    for guess, answer in (("Free map", "Not Free map. Look again."), ("Roll", "Found: Roll.")):
        text_entry(page, "It is").click()
        page.get_by_role("option", name=guess, exact=True).click()
        until(lambda answer=answer: page.get_by_text(answer).count(), what=answer)
    until(lambda: not hub.shared.settings.corrections.touched, what="mended")
    press(page, "Teach")


@pytest.mark.browser
def test_a_recording_that_takes_its_time_to_open_tells_how_far_it_is(
    page: Any, hub: Hub, monkeypatch: pytest.MonkeyPatch
) -> None:
    def slowly(text: str) -> Any:
        for done in range(12):
            opening.tell(done, 12)
            time.sleep(0.25)
        raise SourceError("nothing in it", text, "try another")

    monkeypatch.setattr(hub.library, "open", slowly)
    tab(page, "Open")
    press(page, "Open")
    until(lambda: page.get_by_text(re.compile(r"\d+ of 12 · \d s left")).count(), what="time left")
    until(lambda: page.get_by_text("nothing in it").count(), what="how it ended")
    until(lambda: page.get_by_text(re.compile(r"\d+ of 12")).count() == 0, what="note gone")
    tab(page, "Guide")


def test_unpacking_is_told_to_who_listens_and_to_nobody_else(tmp_path: Path) -> None:
    pack, told = tmp_path / "a.zip", []
    with zipfile.ZipFile(pack, "w") as archive:
        for number in range(3):
            archive.writestr(f"left/{number}.png", b"0")
    with opening.told_to(lambda done, total: told.append((done, total))):
        unpack(pack, "a.zip", tmp_path / "out", 1000, 10)
    assert told == [(0, 3), (1, 3), (2, 3)]
    unpack(pack, "a.zip", tmp_path / "again", 1000, 10)
    assert len(told) == 3


UNNAMED = """() => [...document.querySelectorAll('button, input:not([type=hidden]), select, textarea, img,'
  + 'canvas[tabindex], [role=slider], [role=tab], [role=checkbox]')].filter(e => e.offsetParent !== null).filter(e => {
  const by = (e.getAttribute('aria-labelledby') || '').split(' ');
  const told = by.map(i => document.getElementById(i)?.textContent).join('');
  return ![e.getAttribute('aria-label'), told, e.getAttribute('alt'), e.title, e.placeholder, e.textContent,
    ...[...(e.labels || [])].map(l => l.textContent)].some(s => s && s.trim()); })
  .map(e => e.outerHTML.slice(0, 160))"""
"""Controls and pictures in sight without a name for who does not see them."""


@pytest.mark.browser
def test_every_control_has_a_name(page: Any) -> None:
    page.evaluate("() => { window.patience = performance.now() + 20000 }")
    for name in ("Guide", "Correct", "Paths", "Export", "Open", "Time line", "Playback"):
        tab(page, name)
        page.wait_for_function(
            f"() => ({UNNAMED})().length === 0 || performance.now() > window.patience", timeout=30_000
        )
        assert page.evaluate(UNNAMED) == [], name
    tab(page, "Guide")
    tab(page, "Time line")


@pytest.mark.browser
def test_keys_are_listed_after_a_click_on_anything(page: Any, hub: Hub) -> None:
    for place in (".sc-picture", ".sc-time", "[role=tab]", ".sc-thumbs button"):
        page.locator(place).first.click()
        page.wait_for_timeout(150)
        page.keyboard.press("?")
        until(lambda: page.get_by_role("dialog", name="Keys").is_visible(), what=f"keys after {place}")
        page.keyboard.press("Escape")
        until(lambda: page.get_by_role("dialog", name="Keys").count() == 0, what="list gone")
    assert hub.shared.settings.preset == "Inspect"


def test_long_work_tells_how_long_it_still_takes() -> None:
    now, notes = [0.0], []

    class Note(SimpleNamespace):
        def remove(self) -> None:
            notes.append("gone")

    def add(title: str, body: str, **_: Any) -> Note:
        notes.append(f"{title}: {body}")
        return Note(body=body)

    with LongWork(SimpleNamespace(add_notification=add), "Writing", clock=lambda: now[0]) as work:
        work.at(0, 10)
        assert notes == []
        now[0] = 2.0
        work.at(4, 10)
        assert notes == ["Writing: 4 of 10 · 3 s left"]
        now[0] = 4.0
        work.at(8, 10)
        assert work._note.body == "8 of 10 · 1 s left"
    assert notes[-1] == "gone"


@pytest.mark.browser
def test_a_recording_tells_how_far_it_is(page: Any, hub: Hub, monkeypatch: pytest.MonkeyPatch) -> None:
    views = hub.shared.session.views
    made = views.stages

    def slow(index: int) -> Any:
        time.sleep(0.15)
        return made(index)

    monkeypatch.setattr(views, "stages", slow)
    tab(page, "Export")
    with page.expect_download() as download:
        page.get_by_role("button", name="Recording, rrd").click()
        until(lambda: page.get_by_text(re.compile(r"\d+ of 24 · \d+ s left")).count(), what="time left")
    assert download.value.suggested_filename.endswith("recording.rrd")
    until(lambda: page.get_by_text("Writing recording.rrd").count() == 0, what="note gone")
    tab(page, "Guide")


def test_the_map_of_eq_16_is_seen_from_the_camera() -> None:
    poses = np.tile(np.eye(4), (5, 1, 1))
    poses[:, 2, 3] = np.arange(5.0)
    turned = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    poses[3, :3, :3] = turned
    np.testing.assert_allclose(path_around(poses, 1), [[0, z] for z in (-1, 0, 1, 2, 3)])
    # the camera of frame 3 looks along x of the world, z of the world is at its left
    np.testing.assert_allclose(path_around(poses, 3), [[x, 0] for x in (3, 2, 1, 0, -1)], atol=1e-12)
    assert path_around(poses, 9) is None
