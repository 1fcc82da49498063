"""A calibration session: a folder that grows while its page is open, and the next pose that is asked for."""

from __future__ import annotations

import re
import shutil
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import tab, until
from stereocalib_app.boards import serve as lidar_view
from stereocalib_app.boards.serve import LidarView
from stereocalib_app.boards.watch import FolderWatch, wait_for_pairs

from stereocalib_core.boards import BoardCamera, BoardSpec, Memo, detect, open_folder
from stereocalib_core.boards.rotations import rotation_from_vector
from stereocalib_core.geometry import transform

CAMERA = BoardCamera("pinhole", 640, 420, np.array([[480.0, 0, 320], [0, 480, 210], [0, 0, 1]]), np.zeros(4))
NAMES = [f"pair{i:02d}" for i in range(5)]


@pytest.fixture(scope="module")
def pairs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five pairs to put into folders one by one."""
    sys.path.insert(0, str(Path(__file__).parents[1] / "boards"))
    from lidar_scenes import FLU_TO_RDF, vlp16, write_folder

    folder = tmp_path_factory.mktemp("lidar") / "all"
    truth = transform(rotation_from_vector(np.deg2rad([2.0, -3.0, 1.0])) @ FLU_TO_RDF, [0.1, -0.25, -0.15])
    write_folder(folder, CAMERA, BoardSpec(7, 5, 0.11), truth, vlp16(), len(NAMES), seed=9, held=False)
    return folder


def put(pairs: Path, folder: Path, name: str) -> None:
    """As a person would: the picture, then the cloud."""
    for part in (f"images/{name}.png", f"clouds/{name}.bin"):
        shutil.copy(pairs / part, folder / part)


def fresh(pairs: Path, folder: Path) -> Path:
    for part in ("images", "clouds"):
        (folder / part).mkdir(parents=True)
    for part in ("camera.yaml", "board.yaml"):
        shutil.copy(pairs / part, folder)
    return folder


@pytest.fixture(scope="module")
def view(pairs: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[LidarView]:
    folder = fresh(pairs, tmp_path_factory.mktemp("rig") / "rig")
    for name in NAMES[:4]:
        put(pairs, folder, name)
    started = lidar_view.start(folder, port=0, watch=True)
    until(lambda: started.session.snapshot.stage in {"ready", "failed"}, 60.0, "solved")
    yield started
    started.close()


@pytest.mark.browser
def test_a_new_pair_is_taken_in_while_the_page_is_open(view: LidarView, pairs: Path, browser: Any) -> None:
    session, scene = view.session, view.page.scene
    page = browser.new_page()
    page.goto(f"http://127.0.0.1:{view.server.get_port()}/")
    page.get_by_role("tab", name="Export", exact=True).wait_for(timeout=30_000)
    tab(page, "Pairs")
    until(lambda: page.get_by_text("4 of 4 pairs used").is_visible(), what="four pairs")
    asked = until(lambda: session.snapshot.answer and session.snapshot.answer.pose, what="a pose to add")
    until(lambda: scene._next_name.visible, what="the ghost")
    np.testing.assert_allclose(scene._next_name.position, asked.T_camera_board[:3, 3], atol=1e-6)
    until(lambda: page.get_by_text(re.compile("hold a board")).is_visible(), what="the pose in words")
    before = session.snapshot.result
    put(pairs, session.path, NAMES[4])
    until(lambda: page.get_by_text("5 of 5 pairs used").is_visible(), what="the fifth pair")
    until(lambda: page.locator(".pair-4").is_visible(), what="its row")
    until(lambda: page.get_by_text(re.compile("Pair 5 of 5")).is_visible(), what="it on show")
    now = until(lambda: session.snapshot.answer and session.snapshot.answer.pose, what="another pose to add")
    assert before is not None
    assert session.snapshot.result is not None
    assert not np.array_equal(session.snapshot.result.T_camera_lidar, before.T_camera_lidar)
    until(
        lambda: np.allclose(scene._next_name.position, now.T_camera_board[:3, 3]), what="the ghost has moved"
    )
    np.testing.assert_allclose(now.sigma_before[3:], session.snapshot.result.sigma_translation_m)
    page.get_by_label("use pair04").dispatch_event("click")
    until(lambda: session.snapshot.solved_for == {"pair04"}, what="its tick")
    page.close()


def test_settings_that_are_being_edited_are_told_and_mended(view: LidarView) -> None:
    session = view.session
    good = (session.path / "board.yaml").read_text()
    (session.path / "board.yaml").write_text("columns: 7\n")
    until(lambda: "board has no rows" in session.snapshot.problem, what="told")
    assert session.snapshot.result is not None
    (session.path / "board.yaml").write_text(good)
    until(lambda: not session.snapshot.problem and session.snapshot.stage == "ready", what="mended")


def test_what_was_looked_at_is_not_looked_at_again(
    pairs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = sys.modules["stereocalib_core.boards.detect"]
    looked: list[str] = []
    for name in ("find_corners", "find_candidates"):
        real = getattr(module, name)
        monkeypatch.setattr(module, name, lambda *a, real=real, name=name: (looked.append(name), real(*a))[1])
    folder, memo = fresh(pairs, tmp_path / "rig"), Memo()
    for name in NAMES[:3]:
        put(pairs, folder, name)
    detect(open_folder(folder), memo=memo)
    assert sorted(looked) == ["find_candidates"] * 3 + ["find_corners"] * 3
    looked.clear()
    put(pairs, folder, NAMES[3])
    grown = detect(open_folder(folder), memo=memo)
    assert sorted(looked) == ["find_candidates", "find_corners"]
    cold = detect(open_folder(folder))
    for a, b in zip(grown.observations, cold.observations, strict=True):
        np.testing.assert_array_equal(a.points_lidar, b.points_lidar)


def test_a_file_is_believed_when_it_has_come_to_rest(pairs: Path, tmp_path: Path) -> None:
    folder = fresh(pairs, tmp_path / "rig")
    watch = FolderWatch(folder)
    assert not watch.settled()
    cloud = folder / "clouds" / "a.bin"
    cloud.write_bytes(b"1234")
    assert not watch.settled()
    cloud.write_bytes(b"12345678")
    assert not watch.settled()
    assert watch.settled()
    assert not watch.settled()


def test_a_folder_without_pairs_is_waited_for(pairs: Path, tmp_path: Path) -> None:
    folder = fresh(pairs, tmp_path / "rig")
    waiting = threading.Thread(target=wait_for_pairs, args=(folder, 0.02), daemon=True)
    waiting.start()
    time.sleep(0.1)
    assert waiting.is_alive()
    put(pairs, folder, NAMES[0])
    waiting.join(30.0)
    assert not waiting.is_alive()
