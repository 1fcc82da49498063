"""What may be opened from the page."""

from __future__ import annotations

import io
import stat
import zipfile
from pathlib import Path

import numpy as np
import pytest
from stereocalib_app.server import library
from stereocalib_app.server.library import Library, drive_folder, part_of, unpack

from stereocalib_core.config import PipelineConfig
from stereocalib_core.errors import SourceError
from stereocalib_core.frames import GroundTruth, Recording, StereoFrame
from stereocalib_core.geometry import StereoCamera


def zipped(entries: dict[str, bytes], link: str | None = None, method: int = zipfile.ZIP_STORED) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", method) as archive:
        for name, content in entries.items():
            archive.writestr(name, content)
        if link is not None:
            info = zipfile.ZipInfo(link)
            info.external_attr = (stat.S_IFLNK | 0o777) << 16
            archive.writestr(info, "/etc/passwd")
    return buffer.getvalue()


@pytest.fixture
def shelf(tmp_path: Path) -> Library:
    (tmp_path / "root" / "drive").mkdir(parents=True)
    (tmp_path / "secret").mkdir()
    (tmp_path / "root" / "way_out").symlink_to(tmp_path / "secret")
    return Library(tmp_path / "root", PipelineConfig())


@pytest.mark.parametrize(
    "text", ["../secret", "/etc", "way_out", "drive/../../secret", "~root", "\0", "", "   "]
)
def test_paths_outside_the_root_are_refused(shelf: Library, text: str) -> None:
    with pytest.raises(SourceError):
        shelf.resolve(text)


def test_paths_below_the_root_and_synthetic_drives_pass(shelf: Library) -> None:
    assert shelf.resolve("drive") == str(shelf.root / "drive")
    assert shelf.resolve(str(shelf.root / "drive")) == str(shelf.root / "drive")
    assert shelf.resolve("synthetic:plane?frames=3") == "synthetic:plane?frames=3"


@pytest.mark.parametrize(
    "text",
    [
        *("synthetic?path=/etc/passwd", "video:0?camera=/etc/passwd", "drive?calibration=/etc/passwd"),
        *("drive?calibration=../secret/c.yaml", "drive?x=1"),
    ],
)
def test_sources_that_read_other_files_are_refused(shelf: Library, text: str) -> None:
    with pytest.raises(SourceError):
        shelf.resolve(text)


@pytest.mark.parametrize(
    "name", ["../out.png", "/etc/out.png", "a/../../out.png", "..\\out.png", "C:/out.png"]
)
def test_zip_names_that_lead_outside_are_refused(tmp_path: Path, name: str) -> None:
    folder = tmp_path / "unpacked"
    folder.mkdir()
    with pytest.raises(SourceError, match="unsafe"):
        unpack("x.zip", zipped({name: b"x"}), folder)
    assert not folder.exists() or list(folder.iterdir()) == []
    assert [path.name for path in tmp_path.iterdir() if path.name != "unpacked"] == []


def test_links_bombs_and_rubbish_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(SourceError, match="unsafe"):
        unpack("x.zip", zipped({}, link="left"), tmp_path / "b")
    with pytest.raises(SourceError, match="cannot be read"):
        unpack("x.zip", b"no zip at all", tmp_path / "c")
    monkeypatch.setattr(library, "UNPACKED_BYTES", 10)
    with pytest.raises(SourceError, match="too much"):
        unpack("x.zip", zipped({"a.png": b"x" * 11}), tmp_path / "a")
    monkeypatch.setattr(library, "UPLOAD_BYTES", 10)
    with pytest.raises(SourceError, match="too large"):
        unpack("x.zip", zipped({"a.png": b"x"}), tmp_path)


@pytest.mark.parametrize(
    "method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA]
)
def test_every_damaged_zip_is_one_kind_line(tmp_path: Path, method: int) -> None:
    noise = np.random.default_rng(method)
    intact = zipped({"left/0.png": noise.bytes(200) * 4, "camera.yaml": b"a: 1\n" * 20}, method=method)
    refused = 0
    for trial in range(400):
        damaged = bytearray(intact)
        for place in noise.integers(len(damaged), size=1 + trial % 4):
            damaged[place] ^= int(noise.integers(1, 256))
        cut = int(noise.integers(len(damaged))) if trial % 8 == 0 else len(damaged)
        try:
            unpack("mine.zip", bytes(damaged[:cut]), tmp_path / str(trial))
        except SourceError as error:
            refused += 1
            assert error.remedy
    assert refused > 300


def test_a_zip_without_a_drive_says_so(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="no stereo drive in the zip"):
        unpack("x.zip", zipped({"notes/readme.docx": b"hello"}), tmp_path / "nothing")
    unpack("x.zip", zipped({"notes/readme.txt": b"hello"}), tmp_path)
    with pytest.raises(SourceError, match="no stereo drive in the zip"):
        drive_folder(tmp_path, "mine.zip")


def test_part_of_a_drive_starts_at_its_own_zero() -> None:
    camera = StereoCamera(64, 48, 50.0, 32.0, 24.0, 0.5)
    poses = np.tile(np.eye(4), (6, 1, 1))
    poses[:, 2, 3] = np.arange(6)
    source = Recording(
        "x", camera, np.arange(6.0), lambda i: StereoFrame(i, float(i), None, None), GroundTruth(poses=poses)
    )
    part = part_of(source, 2, 5)
    assert len(part) == 3
    assert (part[0].index, part[0].timestamp_s) == (0, 2.0)
    assert part.ground_truth is not None
    assert part.ground_truth.poses is not None
    np.testing.assert_allclose(part.ground_truth.poses[:, 2, 3], [0, 1, 2])
    assert part_of(source, 0, 6) is source
