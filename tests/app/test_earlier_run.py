"""Runs of another version, or damaged ones: opened as far as they go, or refused in one line."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from stereocalib_app.drive.earlier_run import open_run
from stereocalib_app.drive.panels.header import drive_title
from stereocalib_app.drive.session import Session

from stereocalib_core.errors import SourceError
from stereocalib_core.run.drive import run_drive

FRAMES = 5


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "run"
    run_drive(f"synthetic:plane?frames={FRAMES}", folder)
    return folder


@pytest.fixture
def run(written: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(written, tmp_path / "run"))


@pytest.fixture
def opened(run: Path) -> Iterator[Callable[[], Session]]:
    sessions: list[Session] = []

    def go() -> Session:
        sessions.append(open_run(run))
        sessions[-1].start()
        assert sessions[-1].wait(20.0)
        return sessions[-1]

    yield go
    for session in sessions:
        session.close()


def changed(run: Path, **values: Any) -> None:
    report = json.loads((run / "report.json").read_text())
    (run / "report.json").write_text(json.dumps({**report, **values}))


def test_a_whole_run_has_its_tracks_and_nothing_to_note(opened: Callable[[], Session]) -> None:
    session = opened()
    assert session.tracks
    assert session.notices == ()
    assert session.snapshot.paths is not None


@pytest.mark.parametrize("damage", [lambda d: d[: len(d) // 2], lambda d: b"", lambda d: b"SCF0" + d[4:]])
def test_damaged_frames_leave_the_numbers(
    run: Path, opened: Callable[[], Session], damage: Callable[[bytes], bytes]
) -> None:
    (run / "frames.bin").write_bytes(damage((run / "frames.bin").read_bytes()))
    session = opened()
    assert not session.tracks
    assert len(session.snapshot.results) == FRAMES
    assert session.snapshot.problem == ""
    assert any("frames.bin is damaged or of another version" in line for line in session.notices)


def test_settings_of_another_version_are_named(run: Path, opened: Callable[[], Session]) -> None:
    (run / "config.json").write_text('{"a_setting_of_yore": 1}')
    assert "config.json is of another version" in opened().notices[0]


def test_pictures_that_are_gone_are_named(run: Path, opened: Callable[[], Session]) -> None:
    changed(run, source="/nowhere/at/all")
    session = opened()
    assert "the pictures are not where they were" in session.notices[0]
    assert "run run" in drive_title(session)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"mount": {"height_m": 1.65}}, "mount.height_m is no object"),
        ({"shifts": [{"axis": "pitch"}]}, "shifts.0..frame is no number"),
        ({"rectification": "good"}, "rectification is no object"),
        ({"source": 5}, "source is no text"),
        ({"gaps": [[1, "2"]]}, "gaps is no list of pairs"),
        ({"odometry": {"autocalibrated": {"path_m": "far"}}}, "odometry.autocalibrated.path_m is no number"),
        ({"mount": None, "shifts": None, "odometry": None}, ""),
    ],
)
def test_reports_of_another_shape(run: Path, values: dict[str, Any], words: str) -> None:
    changed(run, **values)
    if not words:
        open_run(run)
        return
    with pytest.raises(SourceError, match=words):
        open_run(run)


@pytest.mark.parametrize(
    ("rows", "words"),
    [(1, "run without frames"), (0, "no extrinsics table|cannot be read")],
)
def test_tables_without_rows(run: Path, rows: int, words: str) -> None:
    lines = (run / "extrinsics.csv").read_text().splitlines()[:rows]
    (run / "extrinsics.csv").write_text("".join(f"{line}\n" for line in lines))
    with pytest.raises(SourceError, match=words):
        open_run(run)


def test_a_table_without_a_column(run: Path) -> None:
    table = run / "extrinsics.csv"
    table.write_text(table.read_text().replace("roll_filtered_sigma_deg", "roll_filtered_error_deg"))
    with pytest.raises(SourceError, match="no extrinsics table"):
        open_run(run)
