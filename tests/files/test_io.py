"""Files of a run: exact layout, stable bytes, and back again."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stereocalib_core.config import PipelineConfig
from stereocalib_core.errors import Failure, FailureReason, OutputError, SourceError
from stereocalib_core.files import io
from stereocalib_core.files.extrinsics import format_cell, read_extrinsics_csv, write_extrinsics_csv
from stereocalib_core.files.run_folder import write_run
from stereocalib_core.geometry import Extrinsics, rotation_x, rotation_y, rotation_z, transform
from stereocalib_core.results import (
    BEST,
    Drive,
    DrivePath,
    FilteredExtrinsics,
    FrameResult,
    FrameTable,
    Measured,
    OdometryErrors,
    Rig,
    RoadEstimate,
)
from stereocalib_core.system import whole_file

HEADER = (
    "frame,timestamp_s,status,reason,height_m,pitch_deg,roll_deg,height_sigma_m,pitch_sigma_deg,roll_sigma_deg,"
    "height_filtered_m,pitch_filtered_deg,roll_filtered_deg,height_filtered_sigma_m,pitch_filtered_sigma_deg,"
    "roll_filtered_sigma_deg,height_smoothed_m,pitch_smoothed_deg,roll_smoothed_deg,height_smoothed_sigma_m,"
    "pitch_smoothed_sigma_deg,roll_smoothed_sigma_deg,filter_state,free_fraction,inliers"
)


def good(frame: int) -> FrameResult:
    sigma = np.diag([0.01**2, np.deg2rad(0.02) ** 2, np.deg2rad(0.03) ** 2])
    road = RoadEstimate(Extrinsics.from_degrees(1.65, 0.8, -0.4), sigma, 1234, 0.51239, (5.0, 30.0))
    return FrameResult(frame, frame / 10, road)


def bad(frame: int) -> FrameResult:
    return FrameResult(frame, frame / 10, None, Failure(FailureReason.DARK, "mean grey 3 of at least 12"))


def smooth(states: list[str]) -> FilteredExtrinsics:
    values = np.tile([1.64, np.deg2rad(0.7), np.deg2rad(-0.3)], (len(states), 1))
    values[[state == "none" for state in states]] = np.nan
    covariance = np.tile(
        np.diag([0.005**2, np.deg2rad(0.01) ** 2, np.deg2rad(0.015) ** 2]), (len(states), 1, 1)
    )
    return FilteredExtrinsics(values, covariance, tuple(states))


def test_extrinsics_csv_to_the_letter(tmp_path: Path) -> None:
    path = tmp_path / "extrinsics.csv"
    filtered = smooth(["updated", "predicted", "none"])
    back = replace(filtered, values=filtered.values + [0.001, 0.0, 0.0])
    table = FrameTable.of([good(7), bad(8), bad(9)], filtered, back)
    write_extrinsics_csv(path, table)
    assert path.read_text() == (
        f"{HEADER}\n"
        "7,0.700000,ok,,1.650000,0.800000,-0.400000,0.010000,0.020000,0.030000,"
        "1.640000,0.700000,-0.300000,0.005000,0.010000,0.015000,"
        "1.641000,0.700000,-0.300000,0.005000,0.010000,0.015000,updated,0.5124,1234\n"
        "8,0.800000,failed,DARK,,,,,,,1.640000,0.700000,-0.300000,0.005000,0.010000,0.015000,"
        "1.641000,0.700000,-0.300000,0.005000,0.010000,0.015000,predicted,,\n"
        "9,0.900000,failed,DARK,,,,,,,,,,,,,,,,,,,none,,\n"
    )


def test_a_table_of_before_the_look_back_is_read(tmp_path: Path) -> None:
    path = tmp_path / "extrinsics.csv"
    write_extrinsics_csv(path, FrameTable.of([good(0), bad(1)]))
    rows = [line.split(",") for line in path.read_text().splitlines()]
    path.write_text("\n".join(",".join(row[:16] + row[22:]) for row in rows) + "\n")
    table = read_extrinsics_csv(path)
    assert table.ok.tolist() == [True, False] and np.isnan(table.height_smoothed_m).all()


def test_extrinsics_csv_without_a_filter_and_back(tmp_path: Path) -> None:
    path = tmp_path / "extrinsics.csv"
    write_extrinsics_csv(path, FrameTable.of([good(0), bad(1)]))
    table = read_extrinsics_csv(path)
    assert path.read_text().splitlines()[0] == HEADER
    assert table.ok.tolist() == [True, False]
    assert table.reason == ("", "DARK")
    assert table.filter_state == ("none", "none")
    assert np.rad2deg(table.pitch_rad[0]) == pytest.approx(0.8)
    assert np.isnan(table.pitch_rad[1])
    assert np.isnan(table.height_filtered_m).all()


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, ""),
        (float("nan"), ""),
        (float("inf"), ""),
        (-1e-9, "0.000000"),
        (-0.4, "-0.400000"),
        (12.3456789, "12.345679"),
    ],
)
def test_cells(value: float | None, text: str) -> None:
    assert format_cell(value) == text


def test_a_damaged_table_is_one_clear_line(tmp_path: Path) -> None:
    path = tmp_path / "extrinsics.csv"
    for text in ("", "a,b\n1,2\n", f"{HEADER}\n1,2\n", f"{HEADER}\n{'x,' * 18}x\n"):
        path.write_text(text)
        with pytest.raises(SourceError):
            read_extrinsics_csv(path)


def some_poses() -> np.ndarray:
    rotations = [rotation_x(0.01 * i) @ rotation_y(0.3 * i) @ rotation_z(-0.02 * i) for i in range(12)]
    return np.array([transform(R, [0.1 * i, -0.0, 1.5 * i]) for i, R in enumerate(rotations)])


def test_trajectories_round_trip(tmp_path: Path) -> None:
    poses, times_s = some_poses(), np.arange(12) * 0.1
    io.write_kitti(tmp_path / "trajectory.txt", poses)
    io.write_tum(tmp_path / "trajectory.tum", times_s, poses)
    lines = (tmp_path / "trajectory.txt").read_text().splitlines()
    assert [len(line.split()) for line in lines] == [12] * 12
    np.testing.assert_allclose(io.read_kitti(tmp_path / "trajectory.txt"), poses, atol=1e-8)
    read_times, read_poses = io.read_tum(tmp_path / "trajectory.tum")
    np.testing.assert_allclose(read_times, times_s)
    np.testing.assert_allclose(read_poses, poses, atol=1e-8)


def test_evo_reads_both_trajectories_alike(tmp_path: Path) -> None:
    file_interface = pytest.importorskip("evo.tools.file_interface")
    poses = some_poses()
    io.write_kitti(tmp_path / "trajectory.txt", poses)
    io.write_tum(tmp_path / "trajectory.tum", np.arange(12) * 0.1, poses)
    kitti = file_interface.read_kitti_poses_file(str(tmp_path / "trajectory.txt"))
    tum = file_interface.read_tum_trajectory_file(str(tmp_path / "trajectory.tum"))
    np.testing.assert_allclose(np.array(kitti.poses_se3), poses, atol=1e-8)
    np.testing.assert_allclose(np.array(tum.poses_se3), poses, atol=1e-6)


def test_a_frame_without_a_pose_is_left_out_of_tum(tmp_path: Path) -> None:
    poses = some_poses()
    poses[3] = np.nan
    io.write_tum(tmp_path / "t.tum", np.arange(12) * 0.1, poses)
    times_s, _ = io.read_tum(tmp_path / "t.tum")
    assert len(times_s) == 11
    assert 0.3 not in times_s


def test_reports_are_strict_json(tmp_path: Path) -> None:
    values = {
        "a": np.float64(np.nan),
        "b": np.array([1, 2]),
        "c": (np.int64(3), None, float("inf")),
        "d": np.True_,
    }
    whole_file.write_json(tmp_path / "report.json", values)
    text = (tmp_path / "report.json").read_text()
    assert "NaN" not in text
    assert json.loads(text) == {"a": None, "b": [1, 2], "c": [3, None, None], "d": True}
    (tmp_path / "report.json").write_text("{")
    with pytest.raises(SourceError):
        whole_file.read_json(tmp_path / "report.json")


def test_rig_files_round_trip_in_degrees(tmp_path: Path) -> None:
    rig = Rig(
        height_m=Measured(1.65, 0.01),
        yaw_rad=Measured(np.deg2rad(-0.3), np.deg2rad(0.02)),
        lever_arm_m=Measured(0.95, 0.1),
    )
    io.write_rig(tmp_path / "rig.yaml", rig)
    assert "value: -0.3\n" in (tmp_path / "rig.yaml").read_text()
    again = io.read_rig(tmp_path / "rig.yaml")
    assert again.roll_rad is None
    assert again.yaw_rad is not None
    assert again.yaw_rad.value == pytest.approx(np.deg2rad(-0.3), abs=1e-9)
    assert again.yaw_rad.sigma == pytest.approx(np.deg2rad(0.02), abs=1e-9)
    assert again.lever_arm_m == Measured(0.95, 0.1)


@pytest.mark.parametrize(
    "text", ["yaw_deg: abc", "yaw: 1", "yaw_deg: {value: 1, sigma: -1}", "yaw_deg: .nan", "7"]
)
def test_bad_rig_files(tmp_path: Path, text: str) -> None:
    (tmp_path / "rig.yaml").write_text(text)
    with pytest.raises(SourceError):
        io.read_rig(tmp_path / "rig.yaml")


def test_writing_is_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "file"
    whole_file.write_atomic(path, "old")
    (tmp_path / "taken").mkdir()
    with pytest.raises(OutputError):
        whole_file.write_atomic(tmp_path / "taken", "new")
    with pytest.raises(OutputError):
        whole_file.write_atomic(tmp_path / "no such folder" / "file", "new")

    def stopped(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("stereocalib_core.system.whole_file.os.replace", stopped)
    with pytest.raises(KeyboardInterrupt):
        whole_file.write_atomic(path, "new")
    assert path.read_text() == "old"
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["file", "taken"]


def test_gaps_are_failed_frames_and_motion_without_a_measurement() -> None:
    table = FrameTable.of([bad(i) if i in (3, 4, 9) else good(i) for i in range(2, 12)])
    measured = np.ones(10, dtype=np.bool_)
    assert table.gaps() == table.gaps(measured) == ((3, 4), (9, 9))
    # into 5 and 10 the motion comes from a failed frame; into 7 nothing was measured though both have a road
    measured[[1, 2, 3, 5, 7, 8]] = False
    assert table.gaps(measured) == ((3, 4), (7, 7), (9, 9))
    measured[9] = False
    assert table.gaps(measured) == ((3, 4), (7, 7), (9, 11))
    assert FrameTable.of([]).gaps() == ()


def test_a_gap_has_no_line_in_the_tum_file(tmp_path: Path) -> None:
    """Frames 12 and 13 of a run that began at 10; the KITTI file keeps its line a frame."""
    results = [FrameResult(10 + i, 0.1 * i, None) for i in range(6)]
    poses = np.tile(np.eye(4), (6, 1, 1))
    poses[:, 2, 3] = np.arange(6)
    path = DrivePath(poses, np.zeros((6, 6, 6)), OdometryErrors(None))
    drive = replace(Drive.of_frames(results, PipelineConfig()), paths={BEST: path}, gaps=((12, 13),))
    write_run(drive, tmp_path)
    times_s, known = io.read_tum(tmp_path / "trajectory.tum")
    np.testing.assert_allclose(times_s, [0.0, 0.1, 0.4, 0.5])
    np.testing.assert_allclose(known[:, 2, 3], [0, 1, 4, 5])
    np.testing.assert_allclose(io.read_kitti(tmp_path / "trajectory.txt"), poses)
