"""What people look for first, on real drives in a real browser: values, pictures, LiDAR, pair, why, exports, links."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from conftest import computed_page, press, seen_page, shown_frame, start_page, stop_page, tab, until
from stereocalib_app.server.hub import Hub

from stereocalib_core.geometry import image_to_road
from stereocalib_core.sources import open_source

pytestmark = pytest.mark.browser
FRAMES, DARK = 12, (7, 8)


@pytest.fixture(scope="module")
def hub(kitti_raw_0009: Path, data_dir: Path) -> Iterator[Hub]:
    """The first frames of a real drive with a LiDAR, completely computed."""
    yield from computed_page(str(kitti_raw_0009), data_dir, frames=(0, FRAMES))


@pytest.fixture(scope="module")
def page(hub: Hub, browser: Any) -> Iterator[Any]:
    yield from seen_page(browser, hub)


@pytest.fixture(autouse=True)
def _put_back(hub: Hub) -> None:
    hub.shared.playback.play(False)
    hub.shared.what_if.reset()
    hub.shared.change(layout="left image", preset="Inspect")
    hub.shared.playback.seek(0)
    until(lambda: hub.shared.shown_frame == 0, what="frame 0")


def x_of(page: Any, frame: int) -> float:
    box = page.locator(".sc-time").bounding_box()
    return float(box["x"] + 46 + frame / (FRAMES - 1) * (box["width"] - 54))


def test_the_time_line_reads_off_and_leads_there(page: Any, hub: Hub) -> None:
    box = page.locator(".sc-time").bounding_box()
    page.mouse.move(x_of(page, 4), box["y"] + 40)
    until(
        lambda: "pointer: frame 4" in page.locator(".sc-note").text_content(), what="value under the pointer"
    )
    page.mouse.click(x_of(page, 9), box["y"] + 40)
    until(lambda: page.locator(".sc-picture[data-frame='9']").count(), what="its picture")
    page.mouse.move(5, 5)
    page.get_by_role("button", name="Signals…").click()
    for label in ("speed [m/s]", "row offset [px]"):
        assert page.get_by_label(label, exact=True).count() == 1, label
    assert page.locator(".sc-list legend", has_text="LiDAR").count() == 1
    page.get_by_role("button", name="Signals…").click()


def test_a_pixel_of_the_road_is_read_off_in_metres(page: Any, hub: Hub) -> None:
    session = hub.shared.session
    road = session.snapshot.results[0].road
    stages = session.views.stages(0).stages
    assert road is not None
    assert stages is not None
    rows, columns = np.nonzero(stages.road & np.isfinite(stages.disparity.values))
    middle = len(rows) // 2
    u = float(stages.disparity.columns_u()[columns[middle]])
    v = float(stages.disparity.rows_v()[rows[middle]])
    canvas, camera = page.locator(".sc-picture"), session.source.camera
    until(lambda: canvas.get_attribute("data-size") == f"{camera.width}x{camera.height}", what="native size")
    box = canvas.bounding_box()
    page.mouse.move(
        box["x"] + (u + 0.5) * box["width"] / camera.width,
        box["y"] + (v + 0.5) * box["height"] / camera.height,
    )
    until(lambda: "over the road" in page.locator(".sc-read").text_content(), what="read-out")
    words = page.locator(".sc-read").text_content().replace("−", "-").split()
    numbers = [float(w) for w in words if w.replace(".", "").lstrip("-").isdigit()]
    wanted = image_to_road(camera, road.extrinsics, numbers[0], numbers[1], numbers[2])
    np.testing.assert_allclose(numbers[3:5], [wanted[0], wanted[2]], atol=0.1)
    assert abs(numbers[5]) < 0.4


def test_the_lidar_is_seen_in_the_picture_and_told(page: Any, hub: Hub) -> None:
    page.get_by_role("button", name="Show LiDAR large").click()
    until(lambda: hub.shared.settings.layout == "LiDAR", what="stage")
    until(lambda: "road 0 m" in page.locator(".sc-legend").text_content(), what="scale of heights")
    view = hub.shared.session.views.get(0, hub.shared._look(0, hub.shared.settings))
    picture = cv2.imdecode(np.frombuffer(view.jpeg, np.uint8), cv2.IMREAD_COLOR).astype(int)
    colored = np.ptp(picture, axis=2) > 40
    assert colored.mean() > 0.01
    until(lambda: page.get_by_text("LiDAR − stereo").count(), what="row of the card")
    tab(page, "LiDAR")
    until(
        lambda: (
            page.get_by_text("LiDAR against its calibration").count()
            or page.get_by_text("Not measured").count()
        ),
        what="the LiDAR against its calibration, or why not",
    )
    tab(page, "Time line")


def test_the_pair_is_judged_and_says_why(page: Any, hub: Hub) -> None:
    tab(page, "Pair")
    drive = hub.shared.session.snapshot.drive
    assert drive is not None
    until(lambda: page.get_by_text("Mend the pair").is_visible(), what="panel of the pair")
    until(lambda: page.locator("strong", has_text=drive.pair.verdict).count(), what="verdict")
    tab(page, "Time line")


def test_what_the_truth_is_good_for_is_said(page: Any) -> None:
    tab(page, "Guide")
    until(
        lambda: page.get_by_text("Truth: good for the length of the path only").count() == 1,
        what="in one place",
    )
    tab(page, "Paths")
    page.get_by_label("Colour by error").click()
    until(lambda: page.get_by_text("cannot be coloured").count(), what="no scale for what is not known")
    page.get_by_label("Colour by error").click()
    tab(page, "Guide")


def test_exports_with_sliders_moved_hold_what_their_names_say(page: Any, hub: Hub, tmp_path: Path) -> None:
    hub.shared.what_if.set(pitch_error_deg=0.5, model="planar")
    tab(page, "Export")
    until(
        lambda: page.get_by_text("Path, report and figures: pitch +0.5 °, planar").count(),
        what="what they hold",
    )
    saved = {}
    for label in ("Trajectory, TUM", "Report, JSON"):
        with page.expect_download() as download:
            press(page, label)
        name = download.value.suggested_filename
        assert "pitch_error_deg=0.5" in name
        assert "model=planar" in name
        assert "frames_0-11" in name
        saved[label] = tmp_path / name
        download.value.save_as(saved[label])
    paths = hub.shared.session.snapshot.paths
    assert paths is not None
    numbers = np.loadtxt(saved["Trajectory, TUM"])
    np.testing.assert_allclose(
        numbers[:, 1:4], paths.live(hub.shared.settings.corrections).poses[:, :3, 3], atol=1e-5
    )
    report = json.loads(saved["Report, JSON"].read_text())
    assert report["page"]["corrections"]["pitch_error_deg"] == 0.5
    copy = page.get_by_role("button", name="shows this page")
    until(lambda: "pitch_error_deg=0.5" in copy.get_attribute("data-text"), what="command with the sliders")
    tab(page, "Guide")


def test_a_link_leads_a_second_browser_to_the_same_moment(page: Any, hub: Hub, browser: Any) -> None:
    hub.shared.playback.seek(6)
    hub.shared.change(layout="v-disparity")
    until(lambda: "at=6" in page.evaluate("location.href") and "v-disparity" in page.evaluate("location.href"),
          what="address")  # fmt: skip
    link = page.evaluate("location.href")
    hub.shared.change(layout="left image")
    hub.shared.playback.seek(1)
    other = browser.new_page()
    other.goto(link)
    own = until(lambda: next(iter(hub._own.values()), None), what="a page of its own")
    until(lambda: own.shown_frame == 6, what="the frame of the link")
    assert own.settings.layout == "v-disparity"
    other.close()
    until(lambda: not hub._own, what="gone")


def test_drives_below_the_root_are_listed_with_pictures(page: Any, hub: Hub) -> None:
    tab(page, "Open")
    entries = page.locator(".sc-shelf button")
    until(lambda: entries.count() >= 4, what="drives")
    words = " ".join(entries.all_text_contents())
    assert "kitti_odometry/sequences/06" in words
    assert "51 frames" in words
    page.get_by_label("Search drives and runs").fill("drive_0009")
    until(lambda: entries.count() == 1, what="found")
    until(lambda: page.locator(".sc-shelf img").evaluate("i => i.naturalWidth") > 100, what="its picture")
    page.get_by_label("Search drives and runs").fill("")
    tab(page, "Guide")


@pytest.fixture(scope="module")
def night(kitti_06: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Hub]:
    """A real drive two of whose frames are taken at night."""
    source, folder = open_source(str(kitti_06)), tmp_path_factory.mktemp("night") / "night"
    for side in ("left", "right"):
        (folder / side).mkdir(parents=True)
    for i in range(14):
        frame = source[i]
        for side, picture in (("left", frame.left), ("right", frame.right)):
            assert picture is not None
            cv2.imwrite(str(folder / side / f"{i:06d}.png"), picture // 40 if i in DARK else picture)
    c = source.camera
    (folder / "camera.yaml").write_text(
        f"width: {c.width}\nheight: {c.height}\nfocal_px: {c.focal_px}\ncx_px: {c.cx_px}\ncy_px: {c.cy_px}\n"
        f"baseline_m: {c.baseline_m}\nfps: 10\n"
    )
    running = start_page(str(folder), folder.parent)
    assert running.shared.session.wait(180.0)
    running.shared.playback.play(False)
    yield running
    stop_page(running)


def test_why_a_night_frame_failed_is_found_from_the_page(night: Hub, open_page: Any) -> None:
    """Debug, next failure, and the cause stands there with both numbers and what to do."""
    night.shared.playback.seek(0)
    page = open_page(night)
    until(lambda: shown_frame(page) == 0, what="page")
    press(page, "Debug")
    page.get_by_role("button", name="failure ▶").first.click()
    until(lambda: shown_frame(page) == DARK[0], what="the failure")
    until(lambda: page.get_by_text("too dark: grey").count(), what="cause")
    assert page.get_by_text("raise exposure or gain").count()
    changed = page.locator("li", has_text="grey").first.text_content()
    assert " instead of " in changed
    spans = page.get_by_text("Failures", exact=True).locator("xpath=ancestor::*[.//input][1]")
    spans.locator("input").first.click()
    until(lambda: page.get_by_role("option", name=f"{DARK[0]} to {DARK[1]} · DARK").count(), what="one span")
    page.keyboard.press("Escape")
