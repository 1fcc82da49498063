"""Our own time line and picture in a real browser: read off, zoom, seek, look closely."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import computed_page, press, seen_page, shown_frame, until
from stereocalib_app.benches.raw_client import LinkClient
from stereocalib_app.server.hub import Hub

pytestmark = pytest.mark.browser
FRAMES = 24
DRIVE = f"synthetic:town?frames={FRAMES}&fault=drop@14-16"
LEFT, RIGHT, RULER, MAP = 46, 8, 18, 24
"""As timeline.js has them."""


@pytest.fixture(scope="module")
def hub(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Hub]:
    yield from computed_page(DRIVE, tmp_path_factory.mktemp("root"))


@pytest.fixture(scope="module")
def page(hub: Hub, browser: Any) -> Iterator[Any]:
    yield from seen_page(browser, hub)


@pytest.fixture(autouse=True)
def _put_back(hub: Hub, page: Any) -> None:
    hub.shared.playback.play(False)
    hub.shared.change(layout="left image", preset="Inspect")
    page.get_by_role("button", name="Whole drive").evaluate("b => b.click()")

    def back() -> bool:
        # A click of the test before may still be on its way.
        hub.shared.playback.seek(0)
        return shown_frame(page) == 0

    until(back, what="frame 0")


def box_of(page: Any) -> dict[str, float]:
    line = page.locator(".sc-time")
    line.scroll_into_view_if_needed()
    found = line.bounding_box()
    assert found is not None
    return found  # type: ignore[no-any-return]


def x_of(page: Any, frame: float, first: float = 0, last: float = FRAMES - 1) -> float:
    box = box_of(page)
    return box["x"] + LEFT + (frame - first) / (last - first) * (box["width"] - LEFT - RIGHT)


def address(page: Any) -> str:
    return str(page.evaluate("() => location.href"))


def note(page: Any) -> str:
    return page.locator(".sc-note").text_content() or ""


def test_a_click_leads_to_its_frame(page: Any, hub: Hub) -> None:
    box = box_of(page)
    began = time.monotonic()
    page.mouse.click(x_of(page, 9), box["y"] + RULER + 30)
    until(lambda: hub.shared.playback.state.frame == 9, what="seek")
    until(lambda: page.locator(".sc-picture[data-frame='9']").count(), what="its picture")
    assert time.monotonic() - began < 20.0
    page.locator(".sc-time").click(position={"x": x_of(page, 20) - box["x"], "y": box["height"] - 8})
    until(lambda: shown_frame(page) == 20, what="seek in the map of the whole drive")


def test_the_pointer_reads_off_and_says_why(page: Any) -> None:
    box = box_of(page)
    page.mouse.move(x_of(page, 15), box["y"] + RULER + 30)
    until(lambda: "pointer: frame 15" in note(page), what="frame under the pointer")
    assert "failed 14–16" in note(page)
    page.mouse.move(5, 5)
    until(lambda: note(page).startswith("frame 0 ·"), what="where we are")


def test_dragging_zooms_and_a_double_click_shows_all(page: Any, hub: Hub) -> None:
    box = box_of(page)
    page.mouse.move(x_of(page, 5), box["y"] + RULER + 40)
    page.mouse.down()
    page.mouse.move(x_of(page, 12), box["y"] + RULER + 40, steps=4)
    page.mouse.up()
    until(lambda: page.get_by_role("button", name="Whole drive").is_enabled(), what="zoomed")
    assert hub.shared.playback.state.frame == 0
    page.mouse.click(x_of(page, 8, 5, 12), box["y"] + RULER + 30)
    until(lambda: shown_frame(page) == 8, what="seek in the stretch")
    until(lambda: "range=5-12" in address(page), what="stretch in the address")
    page.mouse.dblclick(x_of(page, 10, 5, 12), box["y"] + RULER + 30)
    until(lambda: page.get_by_role("button", name="Whole drive").is_disabled(), what="whole drive")
    until(lambda: shown_frame(page) == 8, what="back at the frame before the double click")


def test_signals_are_picked_and_remembered(page: Any, hub: Hub) -> None:
    page.get_by_role("button", name="Signals…").click()
    for label in ("speed [m/s]", "mean grey", "position error [m]", "row offset [px]"):
        assert page.get_by_label(label, exact=True).count() == 1, label
    before = box_of(page)["height"]
    page.get_by_label("mean grey", exact=True).check()
    until(lambda: box_of(page)["height"] > before + 30, what="another row")
    kept = page.evaluate("() => JSON.parse(localStorage.getItem('stereocalib.rows'))")
    assert kept == ["height", "pitch", "roll", "image/mean grey"]
    page.reload()
    until(
        lambda: page.locator(".sc-time").count() and box_of(page)["height"] > before + 30, what="remembered"
    )
    page.get_by_role("button", name="Signals…").click()
    page.get_by_label("mean grey", exact=True).uncheck()
    until(lambda: box_of(page)["height"] == before, what="row gone")
    page.get_by_role("button", name="Signals…").click()


def test_signals_are_those_of_the_drive(hub: Hub) -> None:
    line = LinkClient(hub.server.get_port())
    line.until(lambda told: told.head["t"] == "now")
    line.say({"t": "signals", "names": ["height", "speed", "image/mean grey"]})
    told = line.until(lambda told: told.head["t"] == "signals")
    line.close()
    columns = np.frombuffer(told.body, "<f4").reshape(-1, FRAMES)
    names = [trace[0] for row in told.head["rows"] for trace in row["traces"]]
    assert told.head["failed"] == [[14, 16, hub.shared.session.snapshot.results[14].reason]]
    at = 1
    found = {}
    for row in told.head["rows"]:
        for name, _, _, sigma in row["traces"]:
            found[row["key"], name] = columns[at]
            at += 2 if sigma else 1
    assert at == len(columns)
    assert {"this pair", "filtered", "truth"} <= set(names)
    results = hub.shared.session.snapshot.results
    wanted = [np.nan if r.road is None else r.road.extrinsics.height_m for r in results]
    np.testing.assert_allclose(found["height", "this pair"], wanted, rtol=1e-6)
    truth = hub.shared.session.source.ground_truth
    assert truth is not None
    assert truth.poses is not None
    step = np.linalg.norm(np.diff(truth.poses[:, :3, 3], axis=0), axis=1)
    times = np.diff(hub.shared.session.source.timestamps_s)
    np.testing.assert_allclose(found["speed", "truth"][1:], step / times, rtol=1e-4)


def test_a_seek_shows_its_frame_at_once(hub: Hub) -> None:
    line = LinkClient(hub.server.get_port())
    line.until(lambda told: told.head["t"] == "now")
    times = []
    for frame in (3, 19, 7, 11, 3, 19, 7, 11):
        began = time.monotonic()
        line.say({"t": "seek", "frame": frame})
        line.until(lambda told, f=frame: told.pictured and told.head["frame"] == f)  # type: ignore[misc]
        times.append(time.monotonic() - began)
    line.close()
    assert np.median(times[4:]) < 0.5, times


def whole_picture(page: Any) -> Any:
    """The canvas, not zoomed: whatever a test before this one, or a try before, has left."""
    canvas = page.locator(".sc-picture")
    page.get_by_role("button", name="Whole picture").click()
    until(lambda: canvas.get_attribute("data-zoom") == "1.00", what="whole")
    return canvas


def test_the_picture_is_native_and_zooms_without_the_server(page: Any, hub: Hub) -> None:
    camera = hub.shared.session.source.camera
    canvas = whole_picture(page)
    assert canvas.get_attribute("data-size") == f"{camera.width}x{camera.height}"
    page.evaluate("() => { window.sent = []; const s = WebSocket.prototype.send;"
                  " WebSocket.prototype.send = function (m) {"
                  " if (typeof m === 'string') window.sent.push(JSON.parse(m).t);"
                  " return s.call(this, m); }; }")  # fmt: skip
    page.get_by_role("button", name="Zoom in").click()
    until(lambda: canvas.get_attribute("data-zoom") == "1.50", what="zoomed")
    box = canvas.bounding_box()
    page.mouse.move(box["x"] + 50, box["y"] + 50)
    page.mouse.wheel(0, -400)
    until(lambda: float(canvas.get_attribute("data-zoom")) > 2.0, what="zoomed by the wheel")
    # the disparity under the pointer, once; "shown" answers what the server sent of itself, as pictures that come late
    assert [kind for kind in page.evaluate("() => window.sent") if kind != "shown"] in ([], ["disparity"])
    whole_picture(page)


def test_a_pixel_is_read_off_in_metres(page: Any, hub: Hub) -> None:
    """A point of the road ahead: its place by eq. 13 and 14, and about no height over the road."""
    result = hub.shared.session.snapshot.results[0]
    assert result.road is not None
    session = hub.shared.session
    from stereocalib_core.geometry import image_to_road, road_to_image

    u, v, _ = road_to_image(session.source.camera, result.road.extrinsics, np.array([0.5, 0.0, 9.0]))
    canvas = whole_picture(page)
    canvas.scroll_into_view_if_needed()
    box = canvas.bounding_box()
    scale = box["width"] / session.source.camera.width
    page.mouse.move(box["x"] + (u + 0.5) * scale, box["y"] + (v + 0.5) * scale)
    read = page.locator(".sc-read")
    until(lambda: "over the road" in (read.text_content() or ""), what="read-out")
    numbers = [
        float(w)
        for w in read.text_content().replace("−", "-").split()
        if w.replace(".", "").lstrip("-").isdigit()
    ]
    at_u, at_v, disparity, x, z, height = numbers
    assert abs(at_u - u) < 3
    assert abs(at_v - v) < 3
    wanted = image_to_road(session.source.camera, result.road.extrinsics, at_u, at_v, disparity)
    np.testing.assert_allclose([x, z], [wanted[0], wanted[2]], atol=0.03)
    assert abs(z - 9.0) < 1.0
    assert abs(height) < 0.15


def test_stages_are_chosen_by_their_thumbnails(page: Any, hub: Hub) -> None:
    for name in ("v-disparity", "left − right"):
        page.get_by_role("button", name=f"Show {name} large").click()
        until(lambda name=name: hub.shared.settings.layout == name, what=name)
        until(
            lambda name=name: (page.locator(".sc-picture").get_attribute("aria-label") or "").startswith(
                name
            ),
            what=f"{name} on show",
        )
    page.get_by_role("button", name="Show v-disparity large").click()
    until(lambda: "v-disparity" in (page.locator(".sc-picture").get_attribute("aria-label") or ""), what="v")
    box = page.locator(".sc-picture").bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    until(lambda: "row v" in (page.locator(".sc-read").text_content() or ""), what="axes of the histogram")


def test_a_picture_over_the_whole_window_and_saved(page: Any, tmp_path: Path) -> None:
    press(page, "Picture over the whole window")
    until(lambda: page.locator("dialog.sc-full .sc-picture").count(), what="large")
    size = page.viewport_size
    assert page.locator("dialog.sc-full .sc-picture").bounding_box()["width"] > 0.9 * size["width"]
    with page.expect_download() as download:
        page.get_by_role("button", name="Save this picture as PNG").click()
    assert (
        download.value.suggested_filename == "synthetic_town_frames_24_fault_drop_14-16_frame0_left_image.png"
    )
    page.keyboard.press("Escape")
    until(lambda: page.locator("stereocalib-picture .sc-picture").count(), what="back in its panel")


def test_the_address_opens_what_was_seen(page: Any, hub: Hub, browser: Any) -> None:
    hub.shared.what_if.set(pitch_error_deg=0.5)
    hub.shared.change(preset="Debug", layout="v-disparity")
    hub.shared.playback.seek(15)
    until(
        lambda: all(w in address(page) for w in ("at=15", "v-disparity", "pitch_error_deg", "camera=")),
        what="address",
    )
    link = address(page)
    until(lambda: page.title().startswith("synthetic:town · frame 15"), what="title")
    assert "camera=" in link
    hub.shared.what_if.reset()
    hub.shared.change(preset="Inspect", layout="left image")
    hub.shared.playback.seek(2)
    until(lambda: shown_frame(page) == 2, what="elsewhere")
    other = browser.new_page()
    other.goto(link)
    other.wait_for_selector("stereocalib-timeline canvas")
    own = until(lambda: next(iter(hub._own.values()), None), what="a page of its own for the second browser")
    until(lambda: own.shown_frame == 15, what="the frame of the link")
    assert own.settings.layout == "v-disparity"
    assert own.settings.preset == "Debug"
    assert own.settings.corrections.pitch_error_deg == 0.5
    assert hub.shared.playback.state.frame == 2
    other.close()
    until(lambda: not hub._own, what="gone")


def test_keys_work_after_a_click_on_a_box_and_can_be_listed(page: Any, hub: Hub) -> None:
    page.get_by_role("tab", name="Playback", exact=True).click()
    page.get_by_label("Loop").click()
    until(lambda: hub.shared.playback.state.loop, what="box ticked")
    page.wait_for_timeout(200)
    page.keyboard.press("n")
    until(
        lambda: shown_frame(page) == 1 or hub.shared.playback.state.frame == 1, what="next frame by its key"
    )
    page.keyboard.press("?")
    until(lambda: page.get_by_role("dialog", name="Keys").is_visible(), what="list of keys")
    assert page.get_by_text("Next failure").count()
    page.keyboard.press("Escape")
    until(lambda: page.get_by_role("dialog", name="Keys").count() == 0, what="list gone")
    hub.shared.playback.set_loop(False)
    page.get_by_role("tab", name="Time line", exact=True).click()
    until(
        lambda: page.locator(".mantine-Slider-thumb[aria-label='Frame']").count(), what="name of the slider"
    )


def test_title_and_icon_are_ours(page: Any) -> None:
    assert (
        page.evaluate("() => document.querySelector('link[rel=icon]').getAttribute('href')")
        == "/own/icon.svg"
    )
    assert page.title().endswith("stereocalib")
    assert json.dumps(page.title())


def test_what_can_be_opened_is_listed_found_and_opened(page: Any, hub: Hub) -> None:
    """Drives and runs below the root, a name that is markup among them."""
    from stereocalib_core.run.drive import run_drive
    from stereocalib_core.run.synth import synth

    root = hub.library.root
    synth(root / "garage" / "monday", "plane", {"frames": "3"}, [], None)
    run_drive("synthetic:plane?frames=2", root / "runs <img src=x onerror=window.hit=1>")
    (root / "nothing").mkdir()
    page.get_by_role("tab", name="Open", exact=True).click()
    found = page.locator(".sc-shelf button")
    until(lambda: found.count() == 2, what="two entries")
    words = " ".join(found.all_text_contents())
    assert "garage/monday/sequences/00" in words
    assert "KITTI odometry sequence · 3 frames" in words
    assert "run · 2 frames" in words
    assert page.evaluate("() => window.hit") is None
    until(lambda: page.locator(".sc-shelf img").evaluate("i => i.naturalWidth") > 100, what="thumbnail")
    page.get_by_label("Search drives and runs").fill("monday kitti")
    until(lambda: found.count() == 1, what="found")
    before = hub.shared
    found.first.click()
    until(lambda: hub.shared is not before, what="opened")
    assert hub.shared.playback.total == 3
    until(lambda: "source=garage/monday/sequences/00" in address(page), what="its address")
