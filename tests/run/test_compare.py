"""What differs between two runs, said once for machines and once for people."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from stereocalib_app.cli.main import main

from stereocalib_core.files import io
from stereocalib_core.geometry import Extrinsics, rotation_y, transform
from stereocalib_core.results import FrameResult, RoadEstimate
from stereocalib_core.run.compare import compare_runs, describe


def write_run(
    folder: Path, pitch_deg: float, heading_deg: float = 0.0, rate_hz: float = 10.0, bad: int = 0
) -> Path:
    folder.mkdir()
    covariance = np.diag([0.01**2, np.deg2rad(0.02) ** 2, np.deg2rad(0.02) ** 2])
    road = RoadEstimate(Extrinsics.from_degrees(1.65, pitch_deg, -0.4), covariance, 99, 0.5, (5.0, 30.0))
    results = [FrameResult(i, i / rate_hz, None if i < bad else road) for i in range(20)]
    io.write_extrinsics_csv(folder / "extrinsics.csv", results, None)
    poses = np.array([transform(rotation_y(np.deg2rad(heading_deg) * i / 19), [0, 0, i]) for i in range(20)])
    io.write_kitti(folder / "trajectory.txt", poses)
    mount = {axis: {"value": 1.0, "sigma": 0.01} for axis in ("height_m", "roll_deg")}
    mount |= {"pitch_deg": {"value": pitch_deg, "sigma": 0.03}, "yaw_deg": None}
    io.write_json(folder / "report.json", {"frames": 20, "frames_ok": 20 - bad, "mount": mount, "shifts": []})
    return folder


def test_a_turned_camera_shows_on_its_axis_only(tmp_path: Path) -> None:
    a = write_run(tmp_path / "a", 0.8)
    b = write_run(tmp_path / "b", 1.1, heading_deg=2.0, bad=3)
    difference = compare_runs(a, b)
    pitch = difference["mount"]["pitch_deg"]
    assert pitch["difference"] == pytest.approx(0.3)
    assert pitch["sigma"] == pytest.approx(0.03 * np.sqrt(2))
    assert pitch["significant"]
    assert not difference["mount"]["height_m"]["significant"]
    assert difference["mount"]["yaw_deg"] is None
    frames = difference["frames"]
    assert (frames["ok_in_both"], frames["ok_only_in_a"]) == (17, 3)
    assert frames["pitch_deg"]["median"] == pytest.approx(0.3, abs=1e-6)
    assert frames["pitch_deg"]["rms_in_sigmas"] == pytest.approx(0.3 / (0.02 * np.sqrt(2)), rel=1e-3)
    assert frames["height_m"]["largest"] == 0
    assert difference["path"]["final_heading_difference_deg"] == pytest.approx(2.0, abs=1e-6)
    assert difference["path"]["final_difference_m"] == pytest.approx(0, abs=1e-9)
    text = describe(difference)
    assert text.count("differs") == 1


def test_other_drives_are_not_compared_frame_by_frame(tmp_path: Path) -> None:
    difference = compare_runs(write_run(tmp_path / "a", 0.8), write_run(tmp_path / "b", 0.8, rate_hz=5.0))
    assert difference["frames"] is None
    assert difference["path"] is None
    assert "different drives" in describe(difference)


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    a, b = write_run(tmp_path / "a", 0.8), write_run(tmp_path / "b", 1.1)
    assert main(["compare", str(a), str(b)]) == 0
    assert "pitch_deg" in capsys.readouterr().out
    assert main(["compare", "--json", str(a), str(b)]) == 0
    assert json.loads(capsys.readouterr().out)["mount"]["pitch_deg"]["significant"]
    assert main(["compare", str(a), str(tmp_path)]) == 2
    assert "no run there" in capsys.readouterr().err
