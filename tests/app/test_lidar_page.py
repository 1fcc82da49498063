"""The page of a camera and a LiDAR on a small simulated room, through a real browser."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from conftest import tab, until
from stereocalib_app.benches.raw_client import RawClient
from stereocalib_app.boards import serve as lidar_view
from stereocalib_app.boards.panels import command
from stereocalib_app.boards.serve import LidarView
from stereocalib_app.boards.session import LidarSession
from websockets.exceptions import InvalidStatus

from stereocalib_core.boards import BoardCamera, BoardSpec
from stereocalib_core.boards.rotations import rotation_from_vector
from stereocalib_core.errors import SourceError
from stereocalib_core.geometry import transform

CAMERA = BoardCamera("pinhole", 640, 420, np.array([[480.0, 0, 320], [0, 480, 210], [0, 0, 1]]), np.zeros(4))
PAIRS = 6


@pytest.fixture(scope="module")
def view(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LidarView]:
    """A room of six pairs, one of whose clouds is cut off, completely solved."""
    sys.path.insert(0, str(Path(__file__).parents[1] / "boards"))
    from lidar_scenes import FLU_TO_RDF, vlp16, write_folder

    folder = tmp_path_factory.mktemp("lidar") / "room"
    truth = transform(rotation_from_vector(np.deg2rad([2.0, -3.0, 1.0])) @ FLU_TO_RDF, [0.1, -0.25, -0.15])
    write_folder(folder, CAMERA, BoardSpec(7, 5, 0.11), truth, vlp16(), PAIRS, seed=9, held=False)
    cut = folder / "clouds" / "pair02.bin"
    cut.write_bytes(cut.read_bytes()[:-7])
    started = lidar_view.start(folder, port=0)
    until(lambda: started.session.snapshot.stage in {"ready", "failed"}, 60.0, "solved")
    assert started.session.snapshot.problem == ""
    yield started
    started.close()


@pytest.fixture(scope="module")
def page(view: LidarView, browser: Any) -> Iterator[Any]:
    opened = browser.new_page()
    opened.foreign = []
    own = f"127.0.0.1:{view.server.get_port()}"
    opened.on(
        "request",
        lambda r: (
            opened.foreign.append(r.url)
            if own not in r.url and not r.url.startswith(("data:", "blob:"))
            else None
        ),
    )
    opened.goto(f"http://{own}/")
    opened.get_by_role("tab", name="Export", exact=True).wait_for(timeout=30_000)
    until(lambda: view.server.get_clients(), what="browser connected")
    opened.evaluate("() => document.querySelector('.mantine-Notification-closeButton')?.click()")
    yield opened
    assert opened.foreign == []
    opened.close()


@pytest.fixture(autouse=True)
def _put_back(view: LidarView) -> None:
    session = view.session
    session.change(pair=0, excluded=frozenset(), nudge=(0.0,) * 6, close_up=False)
    until(lambda: session.snapshot.wish is session.wish, what="put back")


@pytest.mark.browser
def test_pairs_are_listed_with_thumbnails_residuals_and_reasons(page: Any) -> None:
    tab(page, "Pairs")
    until(lambda: page.get_by_text("5 of 6 pairs used").is_visible(), what="headline")
    assert page.get_by_text(re.compile(r"good|weak")).first.is_visible()
    for index in range(PAIRS):
        thumb = page.locator(f".pair-{index}")
        image = thumb.evaluate("e => getComputedStyle(e).backgroundImage")
        assert image.startswith('url("data:image/jpeg'), image[:40]
    row = page.locator(".pair-0").locator("xpath=..").text_content()
    assert re.search(r"pair00[\d.]+ mm · [\d.]+ px · [\d.]+°", row), row
    assert "cut off" in page.locator(".pair-2").locator("xpath=..").text_content()
    assert page.get_by_label("use pair02").is_disabled()


@pytest.mark.browser
def test_a_browser_may_be_light(page: Any) -> None:
    def scheme() -> str:
        return str(page.evaluate("() => document.documentElement.dataset.mantineColorScheme"))

    assert scheme() == "dark"
    if not page.get_by_label("Light theme").is_visible():
        page.get_by_text("This browser").dispatch_event("click")
    for wanted in ("light", "dark"):
        page.get_by_label("Light theme").dispatch_event("click")
        until(lambda wanted=wanted: scheme() == wanted, what=wanted)


@pytest.mark.browser
def test_panels_leave_each_other_room_in_a_small_window(view: LidarView, browser: Any) -> None:
    opened = browser.new_page()
    opened.set_viewport_size({"width": 1024, "height": 768})
    opened.goto(f"http://127.0.0.1:{view.server.get_port()}/")

    def edges() -> tuple[float, float, float]:
        """Right edge of the pictures, left edge of the panel that chooses a pair and room right of it [px]."""
        picture = opened.get_by_label("Before and after").bounding_box()
        back = opened.get_by_role("button", name="◀ previous", exact=True).bounding_box()
        tick = opened.get_by_role("button", name="tick in or out", exact=True).bounding_box()
        pairs = opened.get_by_role("button", name="Use all pairs", exact=True).bounding_box()
        right = tick["x"] + tick["width"]
        return picture["x"] + picture["width"], back["x"], pairs["x"] - right

    opened.get_by_role("button", name="Use all pairs", exact=True).wait_for(timeout=30_000)
    until(lambda: edges()[0] < edges()[1] and edges()[2] > 0, what="no panel over another")
    opened.close()


@pytest.mark.browser
def test_ticking_a_pair_out_solves_at_once(page: Any, view: LidarView) -> None:
    tab(page, "Pairs")
    before = view.session.snapshot.result
    page.get_by_label("use pair01").dispatch_event("click")
    until(lambda: view.session.snapshot.solved_for == {"pair01"}, what="solved without it")
    now = view.session.snapshot
    assert now.result is not before
    assert now.result is not None
    assert now.result.pairs[1].reason == "left out"
    until(lambda: page.get_by_text("4 of 6 pairs used").is_visible(), what="told")
    tab(page, "Result")
    until(lambda: page.get_by_text(re.compile("Ticks moved it by")).is_visible(), what="change told")
    tab(page, "Export")
    copied = page.get_by_role("button", name="Copy the command").get_attribute("data-text")
    assert copied.endswith("--exclude pair01")
    tab(page, "Pairs")
    page.get_by_role("button", name="Use all pairs").click()
    until(lambda: view.session.snapshot.solved_for == set(), what="all again")
    np.testing.assert_array_equal(view.session.snapshot.result.T_camera_lidar, before.T_camera_lidar)  # type: ignore[union-attr]


@pytest.mark.browser
def test_solving_again_is_quick(view: LidarView) -> None:
    times = []
    for name in ("pair00", "pair01", "pair03", "pair04", "pair05"):
        view.session.change(excluded=frozenset({name}))
        until(lambda name=name: view.session.snapshot.solved_for == {name}, what="solved")  # type: ignore[misc]
        times.append(view.session.snapshot.solve_s)
    assert min(times) < 1.0


@pytest.mark.browser
def test_too_few_boards_are_told_with_the_direction_and_no_board_kindly(page: Any, view: LidarView) -> None:
    view.session.change(excluded=frozenset({"pair01", "pair03", "pair04", "pair05"}))
    until(lambda: page.get_by_text("Do not use this result").is_visible(), what="warned")
    assert page.get_by_text(re.compile("add a board turned")).is_visible()
    view.session.change(excluded=frozenset(f"pair0{i}" for i in range(PAIRS)))
    until(lambda: page.get_by_text(re.compile("no pair shows the board")).is_visible(), what="told")
    view.session.change(excluded=frozenset())
    until(lambda: page.get_by_text("5 of 6 pairs used").is_visible(), what="mended")


@pytest.mark.browser
def test_a_nudge_moves_cloud_and_residuals_and_comes_back(page: Any, view: LidarView) -> None:
    tab(page, "Nudge")
    solved = view.session.snapshot.result
    assert solved is not None
    row = page.get_by_text("shift z m", exact=True).locator("xpath=ancestor::*[.//input][1]")
    entry = row.locator(".mantine-NumberInput-input").first
    entry.fill("0.08")
    entry.press("Enter")
    trial = until(lambda: view.session.snapshot.trial, what="nudged")
    assert trial.total_rms_m > 2 * solved.plane_rms_m
    assert trial.T_camera_lidar[2, 3] == pytest.approx(solved.T_camera_lidar[2, 3] + 0.08)
    until(lambda: page.get_by_text(re.compile("Nudged: cloud to board")).is_visible(), what="told")
    until(
        lambda: np.allclose(view.page.scene._lidar.position, trial.T_camera_lidar[:3, 3]), what="moved in 3-D"
    )
    page.get_by_role("button", name="Back to the solution").click()
    until(lambda: view.session.snapshot.trial is None, what="back")
    until(lambda: entry.input_value() in {"0", "0.000"}, what="slider back")


@pytest.mark.browser
def test_the_slider_shows_another_pair(page: Any, view: LidarView) -> None:
    picture = view.page._after.jpeg
    page.get_by_role("button", name="next ▶").click()
    until(lambda: page.get_by_text(re.compile("Pair 2 of 6")).is_visible(), what="second pair")
    until(lambda: view.page._after.jpeg != picture, what="its picture")
    picture = view.page._after.jpeg
    page.get_by_label("Close-up").dispatch_event("click")
    until(lambda: view.page._after.jpeg not in (b"", picture), what="close-up")
    page.get_by_role("button", name="tick in or out").click()
    until(lambda: view.session.snapshot.solved_for == {"pair01"}, what="ticked out")
    view.session.change(pair=2)
    until(lambda: page.get_by_text(re.compile("Pair 3 of 6")).is_visible(), what="a refused pair")


@pytest.mark.browser
@pytest.mark.parametrize(("how", "changes"), [("blink", "opacity"), ("wipe", "clipPath")])
def test_before_and_after_in_one_place(page: Any, view: LidarView, how: str, changes: str) -> None:
    view.session.change(compare=how)
    page.locator(f'.compared[data-how="{how}"] img').nth(1).wait_for(timeout=30_000)
    assert not view.page._after.visible
    sizes = page.locator(".compared img").evaluate_all("all => all.map(e => [e.naturalWidth, e.clientWidth])")
    assert sizes[0] == sizes[1]
    assert sizes[0][0] > 400
    upper = page.locator(".compared img.over")
    seen = {upper.evaluate(f"e => getComputedStyle(e).{changes}")}

    def changed() -> bool:
        seen.add(upper.evaluate(f"e => getComputedStyle(e).{changes}"))
        return len(seen) > 1

    until(changed, what="motion")
    view.session.change(compare="one above the other")
    until(lambda: view.page._after.visible and not page.locator(".compared").count(), what="apart again")


@pytest.mark.browser
def test_exports(page: Any, view: LidarView, tmp_path: Path) -> None:
    tab(page, "Export")
    for label, name in (
        ("Calibration, JSON", "calibration.json"),
        ("Overlay of this pair, PNG", "overlay.png"),
        ("ROS 2 static transform, sh", "static_transform.sh"),
    ):
        with page.expect_download(timeout=30_000) as download:
            page.get_by_role("button", name=label).click()
        assert download.value.suggested_filename == name
        download.value.save_as(tmp_path / name)
    result = view.session.snapshot.result
    assert result is not None
    written = json.loads((tmp_path / "calibration.json").read_text())
    np.testing.assert_allclose(written["T_camera_lidar"], result.T_camera_lidar)
    pose = until(lambda: view.session.snapshot.answer.pose, what="the pose to add")
    assert written["next_pose"]["words"] == pose.words()
    assert all({"cause", "remedy", "spoils"} <= set(finding) for finding in written["causes"])
    assert cv2.imread(str(tmp_path / "overlay.png")).shape[1] > 1000
    assert result.ros2_static_transform() in (tmp_path / "static_transform.sh").read_text()


@pytest.mark.browser
def test_an_overlay_that_cannot_be_is_told_kindly(page: Any, view: LidarView) -> None:
    tab(page, "Export")
    view.session.change(pair=2)
    until(lambda: view.session.snapshot.wish.pair == 2, what="refused pair")
    page.get_by_role("button", name="Overlay of this pair, PNG").click()
    until(lambda: page.get_by_text("no overlay of this pair").count(), what="told")


def test_boards_lead_to_their_pair(view: LidarView) -> None:
    class Click:
        client = object()
        instance_index = 3

    view.page._board_clicked(Click(), 3)
    until(lambda: view.session.snapshot.wish.pair == 3, what="chosen")


def test_pages_from_elsewhere_are_refused(view: LidarView) -> None:
    with pytest.raises(InvalidStatus) as refused:
        RawClient(view.server.get_port(), "http://evil.example")
    assert refused.value.response.status_code == 403
    assert view.server.get_host() == "127.0.0.1"


def test_closing_stops_the_search_for_boards(view: LidarView) -> None:
    other = LidarSession(view.session.path)
    other.start()
    until(lambda: other.snapshot.done, what="first pair read")
    other.close()
    other._thread.join(10.0)
    assert not other._thread.is_alive()
    assert other.snapshot.detection is None
    assert other.snapshot.problem == ""


def test_a_folder_that_is_none_is_refused_before_a_server_starts(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="no folder of boards"):
        lidar_view.start(tmp_path, port=0)


def test_the_command_is_safe_to_paste() -> None:
    assert command(Path("/a b"), frozenset({"x", "c;d"})) == (
        "stereocalib lidar-camera '/a b' --out 'a b-calibration' --exclude 'c;d,x'"
    )
