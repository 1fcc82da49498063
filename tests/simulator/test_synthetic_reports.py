"""What the pipeline reports for each fault: the right reason and an honest estimate frame by frame, and the right
lines in the report of a drive."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stereocalib_core.config import PipelineConfig
from stereocalib_core.front.pipeline import FrontEnd
from stereocalib_core.results import FrameResult
from stereocalib_core.run.drive import run_drive
from stereocalib_core.sources.formats.synthetic import SyntheticSource

SPEC = (
    "synthetic:straight?frames=34&fault=dirt@2-3&fault=glare@5-6&fault=low_texture@8-9&fault=rain@11-12"
    "&fault=night@14-15&fault=truck@17-18&fault=swap@20&fault=freeze@22-23&fault=drop@25"
    "&fault=rectification:pitch=0.3@27-28&fault=knock:pitch=0.5@30"
)


@pytest.fixture(scope="module")
def drive() -> SyntheticSource:
    return SyntheticSource.from_spec(SPEC)


@pytest.fixture(scope="module")
def results(drive: SyntheticSource) -> list[FrameResult]:
    front_end = FrontEnd(drive.camera, PipelineConfig())
    return [front_end.step(drive[i]) for i in range(len(drive))]


@pytest.mark.parametrize(
    ("frame", "reasons"),
    [
        (8, {"FLAT_TEXTURE", "NOT_PLANAR", "NO_DISPARITY", "NO_ROAD", "TOO_UNCERTAIN"}),
        (17, {"OUT_OF_RANGE", "NO_ROAD", "NOT_PLANAR", "TOO_UNCERTAIN"}),
        (20, {"SWAPPED"}),
        (22, {"FROZEN"}),
        (25, {"MISSING_PAIR"}),
        (27, {"MISALIGNED"}),
    ],
)
def test_a_fault_that_hides_the_road_is_named(
    results: list[FrameResult], frame: int, reasons: set[str]
) -> None:
    assert results[frame].reason in reasons


@pytest.mark.parametrize("frame", [2, 5, 11, 14])
def test_a_spoilt_view_gives_the_truth_or_a_failure(
    drive: SyntheticSource, results: list[FrameResult], frame: int
) -> None:
    result = results[frame]
    if result.road is not None:
        error = result.road.extrinsics.pitch_rad - drive.ground_truth.extrinsics[frame, 1]
        assert abs(np.rad2deg(error)) < 0.3


@pytest.mark.parametrize("frame", [0, 4, 7, 10, 13, 16, 19, 21, 24, 26, 29, 31, 33])
def test_between_the_faults_the_truth_is_found(
    drive: SyntheticSource, results: list[FrameResult], frame: int
) -> None:
    road = results[frame].road
    assert road is not None
    true = drive.ground_truth.extrinsics[frame]
    assert abs(road.extrinsics.height_m - true[0]) < 0.02
    assert abs(np.rad2deg(road.extrinsics.pitch_rad - true[1])) < 0.06
    assert abs(np.rad2deg(road.extrinsics.roll_rad - true[2])) < 0.25


HALF = "width=613&height=185&focal_px=353.5&cx_px=300.5&cy_px=91.5"
THIRD = "width=408&height=124&focal_px=235.7&cx_px=200.5&cy_px=61.2"


def report_of(spec: str, out: Path) -> tuple[dict[str, Any], dict[int, str]]:
    """report.json of a drive, and the reason of every frame that failed, as written."""
    run_drive(spec, out)
    report = json.loads((out / "report.json").read_text())
    rows = [row.split(",") for row in (out / "extrinsics.csv").read_text().splitlines()[1:]]
    return report, {int(row[0]): row[3] for row in rows if row[2] == "failed"}


def test_a_knock_is_reported_as_a_step(tmp_path: Path) -> None:
    report, _ = report_of(f"synthetic:straight?{HALF}&frames=60&fault=knock:roll=1@30", tmp_path)
    assert [(s["axis"], s["kind"], s["unit"]) for s in report["shifts"]] == [("roll", "step", "deg")]
    assert abs(report["shifts"][0]["frame"] - 30) <= 1
    assert report["shifts"][0]["size"] == pytest.approx(1.0, abs=0.1)


def test_a_drift_is_reported_as_a_drift(tmp_path: Path) -> None:
    spec = f"synthetic:straight?{THIRD}&frames=220&traffic=0&fault=drift:pitch=2@50-170"
    report, _ = report_of(spec, tmp_path)
    assert [(s["axis"], s["kind"]) for s in report["shifts"]] == [("pitch", "drift")]
    # a ramp through levels of twenty frames: its ends are not sharp
    assert report["shifts"][0]["frame"] <= 80
    assert report["shifts"][0]["size"] == pytest.approx(2.0, abs=0.3)


def test_a_knocked_lidar_is_reported_and_not_the_camera(tmp_path: Path) -> None:
    spec = f"synthetic:straight?{HALF}&frames=40&lidar=1&fault=lidar_knock:roll=1@20"
    report, _ = report_of(spec, tmp_path)
    assert report["shifts"] == []
    (shift,) = report["lidar_check"]["shifts"]
    assert (shift["axis"], shift["moved"], shift["kind"]) == ("roll", "lidar", "step")
    assert abs(shift["frame"] - 20) <= 1
    assert shift["size"] == pytest.approx(1.0, abs=0.1)


def test_a_ramp_ahead_is_no_plane(tmp_path: Path) -> None:
    report, failed = report_of(f"synthetic:straight?{HALF}&frames=20&fault=ramp@10", tmp_path)
    assert set(failed.values()) <= {"NOT_PLANAR", "INCONSISTENT", "TOO_UNCERTAIN"} and min(failed) > 10
    assert sum(report["failures"].values()) == len(failed)


def test_a_pair_out_of_rectification_is_not_called_good(tmp_path: Path) -> None:
    report, failed = report_of(
        f"synthetic:straight?{HALF}&frames=12&fault=rectification:pitch=0.3@6", tmp_path
    )
    assert report["rectification"]["verdict"] in ("suspect", "bad")
    assert failed == dict.fromkeys(range(6, 12), "MISALIGNED")
