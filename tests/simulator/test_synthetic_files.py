"""LiDAR, disk cache, run-ahead, and the written folder."""

from __future__ import annotations

import functools
import os
import threading
from pathlib import Path

import cv2
import numpy as np
import pytest

from stereocalib_core.geometry import Extrinsics
from stereocalib_core.run.drive import run_drive
from stereocalib_core.run.synth import synth
from stereocalib_core.simulator.cache import FrameCache, pack, trim, unpack
from stereocalib_core.simulator.lookahead import Lookahead
from stereocalib_core.simulator.settings import parse_spec
from stereocalib_core.sources import open_source
from stereocalib_core.sources.formats.synthetic import SyntheticSource

SMALL = {"width": "320", "height": "120", "focal_px": "185", "cx_px": "157.25", "cy_px": "55.5"}
SPEC = "&".join(f"{k}={v}" for k, v in SMALL.items())


def test_lidar_lies_on_the_true_plane() -> None:
    source = SyntheticSource.from_spec(f"synthetic:plane?frames=3&lidar=1&lidar_noise=0&{SPEC}")
    scan = source.studio.frame(1)[2]
    T = source.T_camera_lidar
    assert scan is not None and scan.dtype == np.float32 and scan.shape[0] > 50_000
    points = scan[:, :3].astype(float) @ T[:3, :3].T + T[:3, 3]
    away = Extrinsics(*source.ground_truth.extrinsics[1]).plane().signed_distance(points)
    assert np.abs(away).max() < 1e-4
    ranges = np.linalg.norm(scan[:, :3], axis=1)
    assert ranges.min() > 1.9 and ranges.max() < 90.1
    noisy = SyntheticSource.from_spec(f"synthetic:plane?frames=3&lidar=1&{SPEC}").studio.frame(1)[2]
    spread = (np.linalg.norm(noisy[:, :3], axis=1) - ranges).std()
    assert spread == pytest.approx(0.02, rel=0.05)


def test_cached_frames_are_the_same_bytes_and_survive_damage(tmp_path: Path) -> None:
    settings = parse_spec(f"synthetic:plane?frames=6&lidar=1&{SPEC}")

    def read() -> list[bytes]:
        source = SyntheticSource(settings, FrameCache("key", tmp_path))
        frames = [source[i] for i in range(6)]
        return [f.left.tobytes() + f.right.tobytes() + f.lidar.tobytes() for f in frames]

    first = read()
    files = sorted((tmp_path / "key").glob("*.frame"))
    assert len(files) == 6
    files[1].write_bytes(files[1].read_bytes()[:-100])
    damaged = bytearray(files[2].read_bytes())
    damaged[5000] ^= 255
    files[2].write_bytes(bytes(damaged))
    files[3].write_bytes(b"")
    (tmp_path / "key" / ".000004.frame.1.2").write_bytes(b"what a killed run leaves")
    assert read() == first


def test_cache_that_cannot_be_written_costs_nothing(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    source = SyntheticSource(parse_spec(f"synthetic:plane?frames=2&{SPEC}"), FrameCache("key", blocked))
    assert source[0].left is not None


def test_cache_is_bounded(tmp_path: Path) -> None:
    picture = np.zeros((100, 100), np.uint8)
    for key in ("old", "new"):
        cache = FrameCache(key, tmp_path)
        for i in range(10):
            cache.write(i, (picture, picture, None))

    for path in (tmp_path / "old").iterdir():
        os.utime(path, (1, 1))
    trim(tmp_path, 12 * len(pack((picture, picture, None))))
    assert len(list((tmp_path / "new").iterdir())) == 10
    assert not (tmp_path / "old").exists() or len(list((tmp_path / "old").iterdir())) <= 2


def test_folders_that_others_remove_meanwhile_are_gone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "000000.frame").write_bytes(bytes(1000))
    looks = {name: getattr(os, name) for name in ("listdir", "scandir")}

    def while_another_trims(look: str, folder: object = ".") -> object:
        if str(folder) == str(tmp_path / "a") and (tmp_path / "a").exists():
            (tmp_path / "a" / "000000.frame").unlink()
            (tmp_path / "a").rmdir()
        return looks[look](folder)

    for look in looks:
        monkeypatch.setattr(os, look, functools.partial(while_another_trims, look))
    trim(tmp_path, 500)
    monkeypatch.undo()
    assert list(tmp_path.iterdir()) == []


def test_pack_is_exact_or_refused() -> None:
    rng = np.random.default_rng(0)
    left, right = rng.integers(0, 255, (2, 12, 20), dtype=np.uint8)
    for scan in (None, np.zeros((0, 4), np.float32), rng.standard_normal((7, 4)).astype(np.float32)):
        data = pack((left, right, scan))
        back = unpack(data)
        assert back is not None and np.array_equal(back[0], left) and np.array_equal(back[1], right)
        assert (back[2] is None) == (scan is None) and (scan is None or np.array_equal(back[2], scan))
        assert unpack(data[:-1]) is None and unpack(data + b"x") is None and unpack(b"") is None


def test_lookahead_makes_ahead_and_hands_on_errors() -> None:
    made: list[int] = []
    third = threading.Event()

    def make(i: int) -> int:
        if i == 9:
            raise ValueError(i)
        made.append(i)
        if i == 3:
            third.set()
        return i * i

    ahead = Lookahead(make, 10, ahead=4)
    assert ahead.get(0) == 0
    assert third.wait(5)
    assert ahead.get(2) == 4 and ahead.get(1) == 1
    with pytest.raises(ValueError):
        ahead.get(9)
    assert ahead.get(5) == 25
    assert made[:4] == [0, 1, 2, 3]


def test_written_drive_reads_back_to_the_same_frames(tmp_path: Path) -> None:
    progress: list[int] = []
    options = {**SMALL, "frames": "7", "lidar": "1", "seed": "3"}
    synth(
        tmp_path, "straight", options, ["drop@3", "rain@5"], lambda done, total, what: progress.append(done)
    )
    assert progress == [1, 2, 3, 4, 5, 6, 7]
    direct = open_source(f"synthetic:straight?{SPEC}&frames=7&lidar=1&seed=3&fault=drop@3&fault=rain@5")
    folder = open_source(str(tmp_path / "sequences" / "00"))
    assert folder.camera == direct.camera and len(folder) == len(direct)
    assert np.array_equal(folder.timestamps_s, direct.timestamps_s)
    assert np.array_equal(folder.T_camera_lidar, direct.T_camera_lidar)
    for i in range(7):
        a, b = direct[i], folder[i]
        assert (a.failure is None) == (b.failure is None)
        if a.failure is None:
            assert np.array_equal(a.left, b.left) and np.array_equal(a.right, b.right)
        else:
            assert a.failure.reason is b.failure.reason
        assert np.array_equal(a.lidar, b.lidar)
    assert np.abs(folder.ground_truth.extrinsics - direct.ground_truth.extrinsics).max() < 1e-12
    assert np.abs(folder.ground_truth.poses - direct.ground_truth.poses).max() < 1e-9
    header = (tmp_path / "sequences" / "00" / "extrinsics_gt.csv").read_text().splitlines()[0]
    assert header == "frame,height_m,pitch_deg,roll_deg,yaw_deg"
    image = cv2.imread(
        str(tmp_path / "sequences" / "00" / "disparity_gt" / "000001.png"), cv2.IMREAD_UNCHANGED
    )
    true = np.nan_to_num(direct.truth(1).disparity)
    assert image.dtype == np.uint16 and np.abs(image / 256.0 - true).max() <= 0.5 / 256 + 1e-6


def test_a_run_on_the_written_drive_gives_the_same_bytes(tmp_path: Path) -> None:
    options = {**SMALL, "frames": "8", "seed": "3"}
    faults = ["drop@0", "drop@4", "drop@7"]
    synth(tmp_path, "straight", options, faults)
    spec = f"synthetic:straight?{SPEC}&frames=8&seed=3" + "".join(f"&fault={fault}" for fault in faults)
    folder = str(tmp_path / "sequences" / "00")
    for source, out in ((spec, "direct"), (folder, "written")):
        run_drive(source, tmp_path / out)
    for name in ("extrinsics.csv", "trajectory.txt", "trajectory.tum"):
        assert (tmp_path / "direct" / name).read_bytes() == (tmp_path / "written" / name).read_bytes()
    rows = (tmp_path / "written" / "extrinsics.csv").read_text().splitlines()[1:]
    assert len(rows) == 8
    assert [i for i, row in enumerate(rows) if ",MISSING_PAIR," in row] == [0, 4, 7]
