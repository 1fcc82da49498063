"""Times, poses and scans in the forms that recorders write; what cannot be read is a note."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from drive_writer import plain_drive

from stereocalib_core.frames import FrameSource
from stereocalib_core.geometry import rotation_y, transform
from stereocalib_core.sources import open_source

EPOCH = 1403636579763555584
DATES = [f"2011-09-26 13:02:{25 + i // 10}.{i % 10}64389445" for i in range(5)]
STEPS = 0.1 * np.arange(5)

TIMES = {
    "seconds": ("".join(f"{0.1 * i}\n" for i in range(5)), STEPS, None),
    "a header": ("time\n" + "".join(f"{0.1 * i}\n" for i in range(5)), STEPS, None),
    "a comment": ("# seconds\n" + "".join(f"{0.1 * i}\n" for i in range(5)), STEPS, None),
    "index and time": ("".join(f"{i} {0.1 * i}\n" for i in range(5)), STEPS, None),
    "index, time, header": ("frame,timestamp\n" + "".join(f"{i},{0.1 * i}\n" for i in range(5)), STEPS, None),
    "time and name": ("".join(f"{0.1 * i} {i:03d}.png\n" for i in range(5)), STEPS, None),
    "decimal commas": ("".join(f"0,{i}\n" for i in range(5)), STEPS, None),
    "milliseconds": ("".join(f"{100 * i}\n" for i in range(5)), STEPS, "is in ms"),
    "microseconds": ("".join(f"{100_000 * i}\n" for i in range(5)), STEPS, "is in us"),
    "nanoseconds": ("".join(f"{10**8 * i}\n" for i in range(5)), STEPS, "is in ns"),
    "nanoseconds since 1970": ("".join(f"{EPOCH + 10**8 * i}\n" for i in range(5)), EPOCH / 1e9 + STEPS, "is in ns"),
    "seconds and nanoseconds": ("".join(f"1403636579 {10**8 * i}\n" for i in range(5)), 1403636579 + STEPS, "is in ns"),
    "dates": ("\n".join(DATES) + "\n", STEPS, None),
    "ISO dates": ("\n".join(d.replace(" ", "T") + "Z" for d in DATES) + "\n", STEPS, None),
}  # fmt: skip


@pytest.mark.parametrize("name", list(TIMES))
def test_times_in_every_form(tmp_path: Path, name: str) -> None:
    text, wanted, said = TIMES[name]
    folder = plain_drive(tmp_path)
    for encoded in (text.encode(), b"\xef\xbb\xbf" + text.encode(), text.encode("utf-16")):
        (folder / "times.txt").write_bytes(encoded)
        source = open_source(str(folder))
        np.testing.assert_allclose(source.epoch_s + source.timestamps_s, wanted, rtol=0, atol=2e-6)
        assert any("times.txt" in note for note in source.notices) is (said is not None)
        assert said is None or any(said in note for note in source.notices)


def test_an_empty_row_has_no_time_and_shifts_none(tmp_path: Path) -> None:
    folder = plain_drive(tmp_path)
    (folder / "times.txt").write_text("0.0\n0.1\n\n0.3\n0.4\n\n\n")
    source = open_source(str(folder))
    np.testing.assert_allclose(source.timestamps_s, STEPS, atol=1e-9)
    assert any("no time for 1 frames" in note for note in source.notices)


POSES = np.array([transform(rotation_y(0.02 * i), np.array([0.01 * i, 0.0, 1.0 * i])) for i in range(5)])


def _truth(source: FrameSource) -> np.ndarray:
    assert source.ground_truth is not None, source.notices
    assert source.ground_truth.poses is not None
    return source.ground_truth.poses


def _tum(stamps: np.ndarray, poses: np.ndarray, w_first: bool = False) -> list[str]:
    rows = []
    for stamp, pose in zip(stamps, poses, strict=True):
        half = np.arctan2(pose[0, 2], pose[0, 0]) / 2
        quaternion = [0.0, np.sin(half), 0.0, np.cos(half)]
        if w_first:
            quaternion = quaternion[-1:] + quaternion[:-1]
        rows.append([stamp, *pose[:3, 3], *quaternion])
    return [" ".join(repr(float(v)) for v in row) for row in rows]


def _kitti(pose: np.ndarray) -> str:
    return " ".join(repr(float(v)) for v in pose[:3].ravel())


FORMS = {
    "KITTI": [_kitti(pose) for pose in POSES],
    "KITTI with comments": ["# poses", *[_kitti(pose) for pose in POSES]],
    "KITTI, 16 numbers": [f"{_kitti(pose)} 0 0 0 1" for pose in POSES],
    "KITTI, numbered and out of order": [f"{i} {_kitti(POSES[i])}" for i in (3, 0, 4, 1, 2)],
    "TUM": ["# timestamp tx ty tz qx qy qz qw", *_tum(STEPS, POSES)],
    "TUM, twice as often": _tum(np.arange(9) * 0.05, np.repeat(POSES, 2, axis=0)[:9]),
    "EuRoC": ["#timestamp, p_x, p_y, p_z, q_w [], q_x [], q_y [], q_z []"]
    + [row.replace(" ", ",") for row in _tum(STEPS, POSES, w_first=True)],
}


@pytest.mark.parametrize("name", list(FORMS))
def test_poses_in_every_form(tmp_path: Path, name: str) -> None:
    folder = plain_drive(tmp_path)
    (folder / "times.txt").write_text("".join(f"{t}\n" for t in STEPS))
    (folder / "poses.txt").write_text("\n".join(FORMS[name]) + "\n")
    np.testing.assert_allclose(_truth(open_source(str(folder))), POSES, atol=1e-9)


def test_poses_between_the_pictures_are_interpolated_and_gaps_are_not(tmp_path: Path) -> None:
    folder = plain_drive(tmp_path)
    (folder / "times.txt").write_text("".join(f"{t}\n" for t in STEPS))
    stamps = np.array([-0.03, 0.02, 0.07, 0.12, 0.17, 0.22, 0.27, 0.45])
    poses = np.array([transform(rotation_y(0.2 * t), np.array([0.0, 0.0, 10 * t])) for t in stamps])
    (folder / "poses.txt").write_text("\n".join(_tum(stamps, poses)) + "\n")
    truth = _truth(open_source(str(folder)))
    np.testing.assert_allclose(truth[:3, 2, 3], [0.0, 1.0, 2.0], atol=1e-3)
    assert np.isnan(truth[3:]).all()


def test_poses_of_a_vehicle_are_turned_into_the_cameras_axes(tmp_path: Path) -> None:
    folder = plain_drive(tmp_path)
    (folder / "times.txt").write_text("".join(f"{t}\n" for t in STEPS))
    rows = [f"{t} {10 * t} 0 0 0 0 0 1" for t in STEPS]
    (folder / "poses.txt").write_text("\n".join(rows) + "\n")
    source = open_source(str(folder))
    np.testing.assert_allclose(_truth(source)[:, :3, 3], np.outer(10 * STEPS, [0, 0, 1]), atol=1e-9)
    assert any("vehicle" in note for note in source.notices)


def test_rows_of_nan_are_unknown(tmp_path: Path) -> None:
    folder = plain_drive(tmp_path)
    rows = [_kitti(pose) for pose in POSES]
    rows[2] = " ".join(["nan"] * 12)
    (folder / "poses.txt").write_text("\n".join(rows) + "\n")
    source = open_source(str(folder))
    assert np.isfinite(_truth(source)).all(axis=(1, 2)).tolist() == [True, True, False, True, True]
    assert any("4 of 5" in note for note in source.notices)


def test_times_and_poses_that_are_none_end_nothing(tmp_path: Path) -> None:
    folder = plain_drive(tmp_path)
    for content in (
        b"\x00\xff" * 300,
        b"soon\nlater\n",
        b"1 2 3\n4\n",
        b"[" * 5000,
        b"1\n" * 5 + b"x" * 9000,
    ):
        (folder / "times.txt").write_bytes(content)
        (folder / "poses.txt").write_bytes(content)
        source = open_source(str(folder))
        assert len(source) == 5
        assert source[4].failure is None
        assert source.ground_truth is None
        assert any("poses.txt is not used" in note for note in source.notices)
        assert np.all(np.diff(source.timestamps_s) > 0)


def _scan_drive(tmp_path: Path) -> Path:
    folder = plain_drive(tmp_path)
    with (folder / "camera.yaml").open("a") as file:
        file.write("T_camera_lidar: [[0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]]\n")
    (folder / "velodyne").mkdir()
    return folder


def test_scans_with_five_numbers_a_point(tmp_path: Path) -> None:
    folder = _scan_drive(tmp_path)
    rng = np.random.default_rng(2)
    scans = [
        np.column_stack([rng.normal(0, 9, (40, 3)), rng.uniform(0, 1, 40), np.arange(40) % 32])
        for _ in range(5)
    ]
    for i, scan in enumerate(scans):
        scan.astype(np.float32).tofile(folder / "velodyne" / f"{i:03d}.bin")
    lidar = open_source(str(folder))[3].lidar
    assert lidar is not None
    np.testing.assert_array_equal(lidar, scans[3][:, :4].astype(np.float32))


def test_scans_that_cannot_be_right_are_a_note(tmp_path: Path) -> None:
    folder = _scan_drive(tmp_path)
    for i in range(5):
        rng = np.random.default_rng(i)
        (1000 * rng.normal(0, 9, (40, 4))).astype(np.float32).tofile(folder / "velodyne" / f"{i:03d}.bin")
    source = open_source(str(folder))
    assert source[1].lidar is None
    assert any("in mm?" in note for note in source.notices)
    for path in (folder / "velodyne").iterdir():
        path.write_bytes(b"123")
    assert any("cannot be read" in note for note in open_source(str(folder)).notices)
