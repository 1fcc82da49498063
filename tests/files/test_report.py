"""A drive to its files and back: the same drive; and reports of any other shape are refused in one line."""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stereocalib_core.config import PipelineConfig
from stereocalib_core.errors import Failure, FailureReason, StereoCalibError
from stereocalib_core.files.report import report_of
from stereocalib_core.files.run_folder import load_run, write_run
from stereocalib_core.geometry import Extrinsics, transform
from stereocalib_core.results import (
    Cause,
    Drive,
    DrivePath,
    FilteredExtrinsics,
    FrameResult,
    FrameTable,
    LidarCheck,
    LidarPose,
    LidarShift,
    Measured,
    OdometryErrors,
    Pair,
    Residual,
    Rig,
    RoadEstimate,
    Shift,
    Timing,
    Tolerance,
)
from stereocalib_core.run.compare import compare, describe

COUNT = 12
LIDAR_FOUND = np.vstack([np.arange(12.0).reshape(3, 4), [0, 0, 0, 1]])
AS_WRITTEN = {"rtol": 0.0, "atol": 1e-6}


def some_drive() -> Drive:
    """A drive with something in every field."""
    rng = np.random.default_rng(0)
    results = []
    for i in range(COUNT):
        e = Extrinsics(*(np.array([1.65, 0.01, -0.02]) + 1e-3 * rng.normal(size=3)))
        road = RoadEstimate(e, np.diag(rng.uniform(1e-8, 1e-6, 3)), 1000 + i, 0.5, (5.0, 30.0))
        failed = Failure(FailureReason.DARK, "mean grey 3") if i in (4, 5) else None
        results.append(FrameResult(3 + i, 0.1 * i, None if failed else road, failed))
    values = np.array([1.65, 0.01, -0.02]) + 1e-4 * rng.normal(size=(COUNT, 3))
    values[0] = np.nan
    states = ("none", *("updated",) * (COUNT - 1))
    filtered = FilteredExtrinsics(values, np.tile(np.diag([1e-6, 1e-8, 1e-8]), (COUNT, 1, 1)), states)
    poses = np.array([transform(np.eye(3), [0.01 * i, 0.0, 1.5 * i]) for i in range(COUNT)])
    no_poses, no_covariance = np.full_like(poses, np.nan), np.full((COUNT, 6, 6), np.nan)
    residual = Residual(0.01, 0.002, 0.003, 0.004)
    return Drive(
        frames=FrameTable.of(results, filtered),
        source="synthetic:?frames=12",
        method="paper",
        mount=Rig(
            Measured(1.65, 0.01),
            Measured(0.0123, 0.0004),
            Measured(-0.02, 0.0005),
            Measured(-0.005, 0.0001),
            Measured(0.95, 0.1),
        ),
        yaw_reason="of the rig file",
        limits={"height_m": Tolerance(1.65, 0.02), "roll_rad": Tolerance(0.0, 0.001)},
        pair=Pair("suspect", "rows differ", Measured(0.2, 0.01), Measured(1e-4, 1e-5), Measured(-2e-4, 3e-5)),
        paths={
            "autocalibrated": DrivePath(
                poses, no_covariance, OdometryErrors(16.5, 16.4, 0.1, 0.6, 0.2, 0.012)
            ),
            "no_yaw": DrivePath(no_poses, no_covariance, OdometryErrors(16.5)),
        },
        gaps=((7, 8),),
        shifts=(Shift(9, "pitch", 0.005, 0.0003, "step", 11), Shift(6, "height", 0.03, 0.001, "drift", 12)),
        lidar=LidarCheck(
            residual,
            residual,
            residual,
            (
                LidarShift(8, "roll", 0.01, 0.001, "step", 10, "lidar"),
                LidarShift(9, "x", 0.05, 0.004, "step", 11, "camera"),
                LidarShift(1, "yaw", 0.01, 0.001, "offset", 11, None),
            ),
            COUNT,
            "its z",
            None,
            residual,
            residual,
            None,
            "open road",
            None,
            LidarPose(
                np.eye(4),
                LIDAR_FOUND,
                np.array([*np.arange(5) / 1e3, np.nan]),
                np.array([1e-3] * 5 + [np.nan]),
                3,
                11,
            ),
        ),
        causes=(Cause(7, 8, "DARK", "a tunnel", "wait for its end"),),
        timing=Timing({"disparity": 9.5, "total": 30.25}, 33.25),
        notices=("no truth",),
        config=PipelineConfig(method="paper"),
    )


def check_same(a: Any, b: Any, where: str = "drive") -> None:
    """Equal in every field, numbers as exact as files have them."""
    if dataclasses.is_dataclass(a):
        assert type(a) is type(b), where
        for field in dataclasses.fields(a):
            check_same(getattr(a, field.name), getattr(b, field.name), f"{where}.{field.name}")
    elif isinstance(a, dict):
        assert list(a) == list(b), where
        for key in a:
            check_same(a[key], b[key], f"{where}[{key}]")
    elif isinstance(a, tuple):
        assert len(a) == len(b), where
        for i, (x, y) in enumerate(zip(a, b, strict=True)):
            check_same(x, y, f"{where}[{i}]")
    elif isinstance(a, (float, np.ndarray)):
        np.testing.assert_allclose(a, b, err_msg=where, **AS_WRITTEN)
    else:
        assert a == b, where


@pytest.fixture
def written(tmp_path: Path) -> Path:
    folder = tmp_path / "run"
    folder.mkdir()
    write_run(some_drive(), folder)
    return folder


def test_a_drive_comes_back_the_same(written: Path, tmp_path: Path) -> None:
    drive, again = some_drive(), load_run(written)
    check_same(drive, again)
    assert again.within_tolerance is False
    assert (again.within("height_m"), again.within("roll_rad"), again.within("yaw_rad")) == (
        True,
        False,
        None,
    )
    (tmp_path / "twice").mkdir()
    write_run(again, tmp_path / "twice")
    check_same(again, load_run(tmp_path / "twice"))


def test_a_stopped_drive_comes_back_too(tmp_path: Path) -> None:
    results = [FrameResult(i, 0.1 * i, None, Failure(FailureReason.DARK, "dark")) for i in range(3)]
    drive = Drive.of_frames(results, PipelineConfig())
    write_run(drive, tmp_path)
    assert not (tmp_path / "trajectory.txt").exists() and not (tmp_path / "rig.yaml").exists()
    again = load_run(tmp_path)
    check_same(drive, again)
    assert again.why_not == drive.why_not and "3 DARK" in str(again.why_not)


def places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Every place in a report; of what is listed, the first two and the last."""
    if path:
        yield path
    listed = sorted({0, 1, len(value) - 1} & set(range(len(value)))) if isinstance(value, list) else ()
    for key in value if isinstance(value, dict) else listed:
        yield from places(value[key], (*path, key))


NOT_READ = {"frames", "frames_ok", "trustworthy", "why_not", "height_m", "pitch_deg", "roll_deg", "failures"}
"""Told again from the frames themselves."""


def test_no_report_of_a_wrong_type_gets_through(written: Path) -> None:
    """Every value replaced by one of every other type: refused in one line that names it, or not read at all."""
    path = written / "report.json"
    text = path.read_text()
    refused = 0
    for place in places(json.loads(text)):
        for wrong in ("x", 7.5, True, [], [3], {}, {"a": 1}, None):
            report = json.loads(text)
            holder = report
            for key in place[:-1]:
                holder = holder[key]
            holder[place[-1]] = wrong
            path.write_text(json.dumps(report))
            try:
                drive = load_run(written)
                describe(compare(drive, drive), "a", "b")
                report_of(drive)
            except StereoCalibError as error:
                refused += 1
                assert re.fullmatch(r"[^\n]+: .+report\.json: [^\n]+", str(error))
                assert place[0] not in NOT_READ and str(place[0]) in str(error), (place, wrong)
    assert refused > 300


def test_a_verdict_or_an_axis_of_no_meaning_is_refused(written: Path) -> None:
    path = written / "report.json"
    report = json.loads(path.read_text())
    report["shifts"][0]["axis"] = "sideways"
    path.write_text(json.dumps(report))
    with pytest.raises(StereoCalibError, match=r"shifts\[0\]\.axis is no one of height pitch roll yaw"):
        load_run(written)
    path.write_text(path.read_text().replace("sideways", "roll").replace('"suspect"', '"lovely"'))
    with pytest.raises(StereoCalibError, match=r"rectification\.verdict is no one of"):
        load_run(written)


def test_the_columns_of_a_table_have_names() -> None:
    table = some_drive().frames
    frame = table.to_pandas()
    assert list(frame.columns) == list(table.columns)
    for name in ("height_m", "pitch_sigma_rad", "roll_filtered_rad", "height_smoothed_sigma_m"):
        np.testing.assert_array_equal(getattr(table, name), table[name])
        np.testing.assert_array_equal(frame[name], table[name])
    assert np.isnan(table.height_m[4]) and table.reason[4] == "DARK" and not table.ok[4]
    with pytest.raises(AttributeError):
        _ = table.width_m
    with pytest.raises(AttributeError):
        _ = table.nonsense


def test_numbers_are_as_long_as_they_mean(written: Path, tmp_path: Path) -> None:
    """A drive that differs in the last bits, as by another library of linear algebra, gives the same file."""

    def nudged(value: Any) -> Any:
        if dataclasses.is_dataclass(value) and not isinstance(value, (type, PipelineConfig)):
            fields = {f.name: nudged(getattr(value, f.name)) for f in dataclasses.fields(value)}
            return dataclasses.replace(value, **fields)
        if isinstance(value, dict):
            return {key: nudged(entry) for key, entry in value.items()}
        if isinstance(value, tuple):
            return tuple(map(nudged, value))
        return value * (1 + 1e-12) if isinstance(value, float) else value

    drive = nudged(some_drive())
    assert drive.mount != some_drive().mount
    write_run(drive, tmp_path)
    assert (tmp_path / "report.json").read_bytes() == (written / "report.json").read_bytes()


def test_a_reason_of_another_version_is_refused(written: Path) -> None:
    table = written / "extrinsics.csv"
    table.write_text(table.read_text().replace("DARK", "GLOOMY"))
    with pytest.raises(StereoCalibError, match="unknown reason GLOOMY"):
        load_run(written)
