"""A drive that finds its own pair bent, and mends it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stereocalib_core.files.run_folder import load_run
from stereocalib_core.geometry import StereoCamera
from stereocalib_core.results import Drive, FrameTable, Measured, Mending, Pair, PairCorrection
from stereocalib_core.run.calibrate import calibrate
from stereocalib_core.run.drive import Interrupted, run_drive
from stereocalib_core.run.self_calibrate import next_mending
from stereocalib_core.run.synth import synth
from stereocalib_core.sources import open_source, with_calibration
from stereocalib_core.sources.mended import maps_of, mended

BENT = "synthetic:town?frames=24&fault=rectification:yaw=0.1"
RESULTS = ("extrinsics.csv", "trajectory.txt", "calibration_mended.yaml")


def _report(out: Path) -> dict[str, Any]:
    return json.loads((out / "report.json").read_text())  # type: ignore[no-any-return]


@pytest.fixture(scope="module")
def corrected(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("self") / "run"
    run_drive(BENT, out, self_calibrate=True)
    return out


def test_the_drive_is_run_again_with_its_pair_mended(corrected: Path) -> None:
    report = _report(corrected)
    before, after = report["self_calibration"]["before"], report["pair"]
    assert before["verdict"] == "bad"
    assert before["relative_yaw_deg"]["value"] == pytest.approx(0.1, abs=0.003)
    assert report["self_calibration"]["applied"]["relative_yaw_deg"] == before["relative_yaw_deg"]["value"]
    assert abs(after["relative_yaw_deg"]["value"]) < 0.003
    assert report["trustworthy"]
    truth = open_source(BENT).ground_truth
    assert truth is not None
    assert truth.extrinsics is not None
    pitch = load_run(corrected).frames.pitch_rad - truth.extrinsics[:24, 1]
    assert abs(np.rad2deg(np.nanmedian(pitch))) < 0.02
    # unmended, the path would be 4 % too long
    path = report["odometry"]["autocalibrated"]
    assert path["path_m"] == pytest.approx(path["path_gt_m"], rel=0.002)


def test_a_large_bend_is_read_in_full() -> None:
    """Far points, which it puts furthest off, are not dropped as strays: without them it reads 0.292."""
    yaw = calibrate("synthetic:town?frames=24&fault=rectification:yaw=-0.3").pair.relative_yaw_rad
    assert yaw is not None
    assert np.rad2deg(yaw.value) == pytest.approx(-0.3, rel=0.015)


def test_what_was_written_is_read_back(corrected: Path) -> None:
    drive = load_run(corrected)
    assert drive.mended is not None
    assert drive.mended.before.verdict == "bad"
    assert np.rad2deg(drive.mended.correction.yaw_rad) == pytest.approx(0.1, abs=0.003)
    assert drive.why_not is None


def test_a_run_stopped_while_mended_goes_on_to_the_same_bytes(corrected: Path, tmp_path: Path) -> None:
    def stop(done: int, total: int, doing: str) -> None:
        if "mended" in doing and done == 9:
            raise KeyboardInterrupt

    with pytest.raises(Interrupted):
        run_drive(BENT, tmp_path / "o", self_calibrate=True, progress=stop)
    run_drive(BENT, tmp_path / "o", self_calibrate=True, resume=True)
    for name in RESULTS:
        assert (tmp_path / "o" / name).read_bytes() == (corrected / name).read_bytes(), name
    assert _report(tmp_path / "o")["pair"] == _report(corrected)["pair"]


def test_the_calibration_written_mends_the_drive(tmp_path: Path) -> None:
    """Read back in place of the drive's own calibration, it leaves no bend."""
    synth(tmp_path / "s", "town", {"frames": "24"}, ["rectification:yaw=0.1"])
    sequence = str(tmp_path / "s" / "sequences" / "00")
    first = run_drive(sequence, tmp_path / "a")
    assert first.pair.verdict == "bad"
    assert first.why_not is not None
    again = run_drive(with_calibration(sequence, tmp_path / "a" / "calibration_mended.yaml"), tmp_path / "b")
    assert again.pair.relative_yaw_rad is not None
    assert abs(np.rad2deg(again.pair.relative_yaw_rad.value)) < 0.004
    assert again.pair.verdict == "good"


def test_a_picture_turned_back_is_the_one_that_was_not_turned() -> None:
    bent, straight = (open_source(f"synthetic:plane?frames=1&noise=0{fault}") for fault in (
        "&fault=rectification:yaw=0.2&fault=rectification:roll=0.1", ""
    ))  # fmt: skip
    correction = PairCorrection(roll_rad=np.deg2rad(0.1), yaw_rad=np.deg2rad(0.2))
    right, wanted, turned = mended(bent, correction)[0].right, straight[0].right, bent[0].right
    assert right is not None and wanted is not None and turned is not None  # noqa: PT018
    inner = (slice(60, -20), slice(20, -20))
    off, was = (np.abs(one[inner].astype(float) - wanted[inner]).mean() for one in (right, turned))
    assert off < 0.3 * was


def test_nothing_to_mend_changes_no_pixel() -> None:
    camera = StereoCamera(64, 48, 50.0, 31.0, 23.0, 0.5)
    u, v = maps_of(camera, PairCorrection())
    assert np.abs(u - np.arange(64)).max() < 1e-5
    assert np.abs(v - np.arange(48)[:, None]).max() < 1e-5


def test_corrections_follow_each_other_as_rotations_do() -> None:
    first, second = PairCorrection(0.001, -0.002, 0.003, 1.01), PairCorrection(-0.002, 0.001, 0.002, 0.99)
    both = first.then(second)
    assert np.abs(both.R_turned_assumed - first.R_turned_assumed @ second.R_turned_assumed).max() < 1e-12
    assert both.depth_scale == pytest.approx(0.9999)


def _drive(yaw: Measured | None, pitch_deg: float) -> Drive:
    pitch = Measured(np.deg2rad(pitch_deg), 1e-5)
    pair = Pair("bad", "", None, pitch, Measured(0.0, 1e-5), yaw)
    return Drive(FrameTable.of([]), pair=pair)


def test_rows_that_hide_the_yaw_are_mended_first() -> None:
    hidden = next_mending(_drive(None, 0.3), None)
    assert hidden is not None
    assert hidden.correction.yaw_rad == 0.0
    seen = next_mending(_drive(Measured(0.001, 1e-5), 0.001), hidden)
    assert seen is not None
    assert seen.correction.yaw_rad == pytest.approx(0.001, rel=1e-3)
    assert np.rad2deg(seen.correction.pitch_rad) == pytest.approx(0.301, rel=1e-3)
    found_at_once = Mending(PairCorrection(yaw_rad=0.001), 0, _drive(Measured(0.001, 1e-5), 0.0).pair)
    assert next_mending(_drive(Measured(1e-5, 1e-5), 0.0), found_at_once) is None
