"""Zips: only what a drive needs is unpacked, in a stream, and nothing is left of it."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
import zipfile
from pathlib import Path

import pytest
from drive_writer import odometry_drive, plain_drive

from stereocalib_core.errors import SourceError
from stereocalib_core.sources import SourceKind, open_source, source_kind

REPO = Path(__file__).resolve().parents[2]


def pack(folder: Path, path: Path, extra: dict[str, bytes] | None = None) -> str:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in sorted(folder.rglob("*")):
            if file.is_file():
                archive.write(file, file.relative_to(folder.parent))
        for name, content in (extra or {}).items():
            archive.writestr(name, content)
    return str(path)


@pytest.fixture(autouse=True)
def own_temporary_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    place = tmp_path / "tmp"
    place.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(place))
    return place


def test_a_zip_of_any_drive_opens(tmp_path: Path, own_temporary_folder: Path) -> None:
    plain = pack(
        plain_drive(tmp_path / "mine"),
        tmp_path / "a.zip",
        {"film.mov": b"x" * 5000, "notes/.hidden.txt": b"1"},
    )
    assert source_kind(plain) is SourceKind.ARCHIVE
    source = open_source(plain)
    assert len(source) == 5
    assert source[4].left is not None and source[4].left[0, 0] == 4
    assert source.name == "mine"
    unpacked = {path.name for path in own_temporary_folder.rglob("*")}
    assert "film.mov" not in unpacked and ".hidden.txt" not in unpacked
    kitti = pack(odometry_drive(tmp_path / "kitti", poses=6).parents[1], tmp_path / "b.zip")
    found = open_source(kitti)
    assert len(found) == 6
    assert found.ground_truth is not None
    assert open_source(kitti).content_key == found.content_key


@pytest.mark.parametrize(
    ("name", "content", "part"),
    [
        ("mine/times.txt", b"0.1\n" * 20_000_000, "at most|unfolds too far"),
        ("mine/calib.txt", b"P0: 0\n" * 2_000_000, "unfolds too far"),
        ("mine/camera.yaml", b"a: 1\n" * 100_000, "at most 256 kB"),
        ("mine/left/9.png", bytes(100_000_000), "unfolds too far"),
    ],
)
def test_bombs_are_one_line_and_leave_nothing(
    tmp_path: Path, own_temporary_folder: Path, name: str, content: bytes, part: str
) -> None:
    path = pack(plain_drive(tmp_path / "mine"), tmp_path / "a.zip", {name: content})
    assert Path(path).stat().st_size < 2_000_000
    with pytest.raises(SourceError, match=part) as caught:
        open_source(path)
    assert "\n" not in str(caught.value)
    assert list(own_temporary_folder.iterdir()) == []


LARGE_LIST = """
import resource, sys
from stereocalib_core.sources import open_source
import stereocalib_core.sources.formats

before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
source = open_source(sys.argv[1])
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before, *source.notices, sep="|")
"""


@pytest.mark.parametrize("name", ["times.txt", "poses.txt", "calib.txt", "camera.yaml", "extrinsics_gt.csv"])
def test_a_file_that_is_endless_takes_no_memory(tmp_path: Path, name: str) -> None:
    """Sparse files of 3 GB, of which no reader may take more than its content justifies."""
    folder = plain_drive(tmp_path / "mine")
    keep = (folder / "camera.yaml").read_bytes()
    with open(folder / name, "r+b" if name == "camera.yaml" else "wb") as file:
        os.truncate(file.fileno(), 3 << 30)
    done = subprocess.run(
        [sys.executable, "-c", LARGE_LIST, str(folder)], capture_output=True, text=True, cwd=REPO, timeout=60
    )
    if name == "camera.yaml":
        assert "too large" in done.stderr.splitlines()[-1]
        (folder / name).write_bytes(keep)
        return
    assert done.returncode == 0, done.stderr
    grown_kb, *notes = done.stdout.split("|")
    assert int(grown_kb) < 100_000
    assert name == "calib.txt" or any(name in note for note in notes)


def test_a_list_of_millions_of_rows_is_cut_short(tmp_path: Path) -> None:
    folder = plain_drive(tmp_path / "mine")
    (folder / "times.txt").write_bytes(b"1\n" * 40_000_000)
    done = subprocess.run(
        [sys.executable, "-c", LARGE_LIST, str(folder)], capture_output=True, text=True, cwd=REPO, timeout=60
    )
    grown_kb, *notes = done.stdout.split("|")
    assert int(grown_kb) < 300_000
    assert any("times.txt is not used" in note for note in notes)


@pytest.mark.wall_clock
def test_a_run_that_is_ended_leaves_nothing_unpacked(tmp_path: Path) -> None:
    names = [f"{i:04d}" for i in range(250)]
    path = pack(plain_drive(tmp_path / "mine", names), tmp_path / "a.zip")
    place = tmp_path / "unpacked"
    place.mkdir()
    environment = {**os.environ, "TMPDIR": str(place)}
    command = [sys.executable, "-m", "stereocalib_app.cli.main", "run", path, "--out", str(tmp_path / "out")]
    with subprocess.Popen(command, env=environment, cwd=REPO, stdout=subprocess.DEVNULL) as process:
        until = time.monotonic() + 60
        while not (tmp_path / "out" / "checkpoint.bin").is_file() and time.monotonic() < until:
            assert process.poll() is None
            time.sleep(0.05)
        assert list(place.glob("stereocalib-zip-*"))
        process.terminate()
        assert process.wait(30) == 143
    assert list(place.glob("stereocalib-zip-*")) == []
