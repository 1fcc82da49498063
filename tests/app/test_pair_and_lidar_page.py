"""Pair and LiDAR on the page, through a real browser, of a rendered rig in which both are broken on purpose."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import computed_page, press, seen_page, slider_entry, tab, until
from stereocalib_app.drive.panels.lidar import AFTER, BEFORE, overlay
from stereocalib_app.server.hub import Hub
from stereocalib_app.words.lessons import LESSONS, TURNED

pytestmark = pytest.mark.browser

DRIVE = "synthetic:town?frames=16&lidar=1&fault=rectification:yaw=0.1&fault=lidar_knock:yaw=0.8@0"
SHOTS = os.environ.get("STEREOCALIB_SHOTS")
"""A folder for pictures of what the tests look at, to be looked at by people."""


@pytest.fixture(scope="module")
def hub(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Hub]:
    yield from computed_page(DRIVE, tmp_path_factory.mktemp("root"))


@pytest.fixture(scope="module")
def page(hub: Hub, browser: Any) -> Iterator[Any]:
    yield from seen_page(browser, hub)


def shot(page: Any, name: str) -> None:
    if SHOTS:
        page.screenshot(path=str(Path(SHOTS) / f"{name}.png"))


def test_the_lidar_tab_names_the_axis_and_shows_the_scan_before_and_after(page: Any, hub: Hub) -> None:
    tab(page, "LiDAR")
    page.get_by_text("LiDAR against its calibration, frames").wait_for()
    row = page.locator("tr", has_text="yaw").filter(has_text="looks further left")
    row.first.wait_for()
    assert "+0.8" in (row.first.text_content() or "").replace("−", "-")
    page.get_by_text("calibration off by").first.wait_for()
    page.get_by_text("Copy its ROS 2 static transform").wait_for()
    panel = hub.shared.parts["LiDAR"]
    until(lambda: panel._picture is not None and page.get_by_text("Depth edges of the scan").is_visible())
    shot(page, "lidar")


def test_the_edges_as_found_lie_on_the_pictures_and_those_as_calibrated_do_not(hub: Hub) -> None:
    session = hub.shared.session
    drive, result = session.snapshot.drive, session.snapshot.result(8)
    assert drive is not None and drive.lidar is not None and drive.lidar.pose is not None
    assert result is not None and result.scan is not None
    left = session.views.stages(8).frame.left
    drawn = overlay(left, result.scan, drive.lidar.pose, session.camera)
    on = [np.argwhere((drawn == colour).all(axis=2)) for colour in (BEFORE, AFTER)]
    assert all(len(points) > 50 for points in on)
    edges = result.scan.picture_edges
    away = []
    for points in on:
        near = np.abs(edges[:, 1][:, None] - points[:, 0]) < 3.0
        gap = np.where(near, np.abs(edges[:, 0][:, None] - points[:, 1]), np.inf).min(axis=0)
        away.append(float(np.median(gap[np.isfinite(gap)])))
    # 0.8 deg are 10 px
    assert away[1] < 0.6 * away[0], away


def test_the_pair_tab_says_what_is_wrong_and_the_switch_mends_the_drive(page: Any, hub: Hub) -> None:
    tab(page, "Pair")
    page.get_by_text("relative yaw", exact=False).first.wait_for()
    page.get_by_text("How far the car drove by points nearer", exact=False).first.wait_for()
    panel = hub.shared.parts["Pair"]
    before = hub.shared.session.snapshot.drive
    box = page.get_by_label("Mend the pair")
    box.scroll_into_view_if_needed()
    box.check()
    until(lambda: panel.mended is not None)
    mended = panel.mended
    # the LiDAR is not where it was calibrated: it gives no scale
    assert before.pair.depth_scale is None or before.pair.depth_scale.source != "lidar"
    assert before.pair.relative_yaw_rad.value == pytest.approx(np.deg2rad(0.1), abs=np.deg2rad(0.004))
    assert abs(mended.pair.relative_yaw_rad.value) < np.deg2rad(0.004)
    pitch = [np.rad2deg(np.nanmedian(d.frames.pitch_rad)) for d in (before, mended)]
    # h / b of pitch per yaw: 0.31 deg
    assert pitch[1] - pitch[0] == pytest.approx(0.31, abs=0.03)
    page.get_by_text("mended", exact=True).first.wait_for()
    shot(page, "pair")
    box.uncheck()
    until(lambda: panel.mended is None)


def test_the_slider_of_the_lesson_bends_pictures_and_numbers(page: Any, hub: Hub) -> None:
    step = next(k for k, lesson in enumerate(LESSONS) if lesson.breakage.stages in TURNED)
    hub.shared.choose("Teach")
    hub.shared.parts["Teach"].go(step)
    tab(page, "Guide")
    entry = slider_entry(page, "Turn (°)")
    entry.wait_for()
    entry.fill("-0.1")
    entry.press("Enter")
    page.get_by_text("motion finds", exact=False).wait_for()
    until(lambda: hub.shared.settings.broken_stage in TURNED)
    assert TURNED[hub.shared.settings.broken_stage] == pytest.approx(np.deg2rad(-0.1))
    page.locator("svg[aria-label^='Path from above']").scroll_into_view_if_needed()
    shot(page, "bend")
    press(page, "Mend it")
    page.get_by_text("Move the slider", exact=False).wait_for()
