"""A drive with failures, as somebody with a problem would meet it; and finished runs on the page."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from conftest import start_page, stop_page, until
from stereocalib_app.drive import exports
from stereocalib_app.drive.earlier_run import open_run
from stereocalib_app.drive.frame_views import Look
from stereocalib_app.drive.signals.extrinsics import extrinsics
from stereocalib_app.drive.signals.row import Known
from stereocalib_app.server.hub import Hub

from stereocalib_core.back.spans import failed_spans
from stereocalib_core.errors import SourceError
from stereocalib_core.files.run_folder import write_run as save
from stereocalib_core.sources import open_source

FRAMES = 8
DARK_FRAME, MISSING_FRAME = 3, 5


@pytest.fixture(scope="module")
def broken_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eight pairs of a textured plane as a plain folder: one pair dark, one without its right picture."""
    folder = tmp_path_factory.mktemp("root") / "broken <b>drive"
    source = open_source(f"synthetic:plane?frames={FRAMES}")
    for side in ("left", "right"):
        (folder / side).mkdir(parents=True)
    for i in range(FRAMES):
        frame = source[i]
        assert frame.left is not None
        assert frame.right is not None
        for side, picture in (("left", frame.left), ("right", frame.right)):
            shown = picture // 60 if i == DARK_FRAME else picture
            if (i, side) != (MISSING_FRAME, "right"):
                cv2.imwrite(str(folder / side / f"{i:06d}.png"), shown)
    c = source.camera
    (folder / "camera.yaml").write_text(
        f"width: {c.width}\nheight: {c.height}\nfocal_px: {c.focal_px}\ncx_px: {c.cx_px}\ncy_px: {c.cy_px}\n"
        f"baseline_m: {c.baseline_m}\nfps: 10\n"
    )
    return folder


@pytest.fixture(scope="module")
def hub(broken_folder: Path) -> Iterator[Hub]:
    running = start_page(str(broken_folder), broken_folder.parent)
    assert running.shared.session.wait(120.0)
    yield running
    stop_page(running)


def test_failures_are_found_with_their_reasons(hub: Hub) -> None:
    spans = failed_spans(hub.shared.session.snapshot.results)
    assert [span.words for span in spans] == [f"{DARK_FRAME} · DARK", f"{MISSING_FRAME} · MISSING_PAIR"]
    hub.shared.playback.seek(0)
    assert hub.shared.playback.seek_failure(1) == DARK_FRAME
    until(lambda: hub.shared.shown_frame == DARK_FRAME, what="dark frame shown")
    words = hub.shared.parts["Debug"]._verdict.content
    assert "DARK" in words
    assert "Likely cause" in words
    assert "What to do" in words
    assert "✗ mean grey is outside" in hub.shared.parts["Debug"]._checks.content


def test_playback_stops_at_the_failure(hub: Hub) -> None:
    playback = hub.shared.playback
    playback.seek(0)
    playback.set_pause_on_failure(True)
    playback.play()
    until(lambda: not playback.state.playing, what="pause")
    assert playback.state.frame == DARK_FRAME
    playback.set_pause_on_failure(False)


def test_names_from_outside_are_inert(hub: Hub) -> None:
    shown = hub.shared.header._drive.content
    assert "&lt;b&gt;drive" in shown
    assert "<b>" not in shown


@pytest.mark.browser
def test_from_the_page_to_a_finding(hub: Hub, open_page: Any) -> None:
    """As a new user would: open the page, Debug, next failure, read the reason."""
    hub.shared.playback.seek(0)
    page = open_page(hub)
    page.get_by_role("button", name="Debug", exact=True).click()
    page.get_by_role("button", name="failure ▶").first.click()
    until(lambda: page.get_by_text("too dark: grey").count(), 30.0, "cause on the page")
    assert page.get_by_text("Frame 3 failed: DARK").first.is_visible()
    assert page.foreign == []
    hub.shared.choose("Inspect")


def write_run(hub: Hub, folder: Path) -> Path:
    folder.mkdir()
    page = hub.shared
    drive = exports.shown_drive(page.session, page.session.snapshot, page.settings.corrections)
    save(drive, folder)
    return folder


def test_a_finished_run_opens_again(hub: Hub, broken_folder: Path) -> None:
    folder = write_run(hub, broken_folder.parent / "run one")
    session = open_run(folder)
    session.start()
    assert session.wait(20.0)
    before, after = hub.shared.session.snapshot, session.snapshot
    assert [r.reason for r in after.results] == [r.reason for r in before.results]
    heights = [[r.road.extrinsics.height_m for r in s.results if r.road] for s in (before, after)]
    np.testing.assert_allclose(heights[1], heights[0], atol=1e-6)
    assert after.drive is not None
    assert after.drive.poses is not None
    assert before.drive is not None
    np.testing.assert_allclose(after.drive.poses, before.drive.poses, atol=1e-4)
    assert session.views.get(0, Look("left image")).jpeg[:2] == b"\xff\xd8"
    session.close()


def test_a_run_whose_pictures_are_gone_still_shows_its_numbers(hub: Hub, broken_folder: Path) -> None:
    folder = write_run(hub, broken_folder.parent / "run two")
    report = (folder / "report.json").read_text()
    (folder / "report.json").write_text(report.replace(str(broken_folder), "/nowhere"))
    session = open_run(folder)
    assert len(session.source) == FRAMES
    assert "pictures not found" in session.source.notices[0]
    assert session.views.get(0, Look("left image")).jpeg


def test_another_run_is_laid_beside(hub: Hub, broken_folder: Path) -> None:
    folder = write_run(hub, broken_folder.parent / "run three")
    page = hub.shared
    hub.compare(page, folder.name)
    until(lambda: page.parts["Open"]._difference.content, what="difference")
    assert "height" in page.parts["Open"]._difference.content
    moment = hub.desk._last[page.name][0]
    known = Known(moment.snapshot, page.session.source.timestamps_s, None, moment.paths, moment.compared)
    other = next(trace for trace in extrinsics(known)[0].traces if trace.name == "other run")
    assert np.isfinite(other.values).any()
    hub.compare(page, "")
    until(lambda: page.compared is None and not page.parts["Open"]._difference.content, what="taken away")
    with pytest.raises(SourceError):
        hub.compare(page, "no such run")


def test_another_drive_opens_from_the_page_and_from_a_zip(hub: Hub, broken_folder: Path) -> None:
    before = hub.shared
    hub.open(hub.shared, broken_folder.name)
    assert hub.shared is not before
    until(lambda: hub.shared.shown_frame >= 0, what="new page shown")
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for path in sorted(broken_folder.rglob("*")):
            if path.is_file() and path.stem != "000007":
                archive.write(path, f"my drive/{path.relative_to(broken_folder)}")
    hub.open_upload(hub.shared, SimpleNamespace(name="mine.zip", content=buffer.getvalue()))
    assert hub.shared.playback.total == FRAMES - 1
    assert hub.shared.session.wait(60.0)
    hub.open(hub.shared, broken_folder.name)
    assert hub.shared.session.wait(60.0)
    assert len(hub._sessions) == 1
