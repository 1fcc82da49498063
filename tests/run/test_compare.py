"""What differs between two runs, said once for machines and once for people."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from stereocalib_app.cli.main import main

from stereocalib_core.files import io
from stereocalib_core.files.extrinsics import write_extrinsics_csv
from stereocalib_core.files.run_folder import load_run
from stereocalib_core.geometry import Extrinsics, rotation_y, transform
from stereocalib_core.results import FrameResult, FrameTable, RoadEstimate
from stereocalib_core.run.compare import compare, describe
from stereocalib_core.system import whole_file


def write_run(
    folder: Path, pitch_deg: float, heading_deg: float = 0.0, rate_hz: float = 10.0, bad: int = 0
) -> Path:
    folder.mkdir()
    covariance = np.diag([0.01**2, np.deg2rad(0.02) ** 2, np.deg2rad(0.02) ** 2])
    road = RoadEstimate(Extrinsics.from_degrees(1.65, pitch_deg, -0.4), covariance, 99, 0.5, (5.0, 30.0))
    results = [FrameResult(i, i / rate_hz, None if i < bad else road) for i in range(20)]
    write_extrinsics_csv(folder / "extrinsics.csv", FrameTable.of(results))
    poses = np.array([transform(rotation_y(np.deg2rad(heading_deg) * i / 19), [0, 0, i]) for i in range(20)])
    io.write_kitti(folder / "trajectory.txt", poses)
    mount: dict[str, object] = {axis: {"value": 1.0, "sigma": 0.01} for axis in ("height_m", "roll_deg")}
    mount |= {"pitch_deg": {"value": pitch_deg, "sigma": 0.03}, "yaw_deg": None}
    whole_file.write_json(
        folder / "report.json", {"frames": 20, "frames_ok": 20 - bad, "mount": mount, "shifts": []}
    )
    return folder


def test_a_turned_camera_shows_on_its_axis_only(tmp_path: Path) -> None:
    a = write_run(tmp_path / "a", 0.8)
    b = write_run(tmp_path / "b", 1.1, heading_deg=2.0, bad=3)
    difference = compare(load_run(a), load_run(b))
    pitch, height = difference.mount["pitch_rad"], difference.mount["height_m"]
    assert pitch is not None and height is not None
    assert np.rad2deg(pitch.difference) == pytest.approx(0.3)
    assert np.rad2deg(pitch.sigma) == pytest.approx(0.03 * np.sqrt(2))
    assert pitch.significant and not height.significant
    assert difference.mount["yaw_rad"] is None
    frames, path = difference.frames, difference.path
    assert frames is not None and path is not None
    assert (frames.ok_in_both, frames.ok_only_in_a) == (17, 3)
    over = frames.axes["pitch_rad"]
    assert over is not None
    assert np.rad2deg(over.median) == pytest.approx(0.3, abs=1e-6)
    assert over.rms_in_sigmas == pytest.approx(0.3 / (0.02 * np.sqrt(2)), rel=1e-3)
    assert frames.axes["height_m"] is not None and frames.axes["height_m"].largest == 0
    assert np.rad2deg(path.final_heading_difference_rad) == pytest.approx(2.0, abs=1e-6)
    assert path.final_difference_m == pytest.approx(0, abs=1e-9)
    text = describe(difference, "a", "b")
    assert text.count("differs") == 1


def test_other_drives_are_not_compared_frame_by_frame(tmp_path: Path) -> None:
    runs = write_run(tmp_path / "a", 0.8), write_run(tmp_path / "b", 0.8, rate_hz=5.0)
    difference = compare(*map(load_run, runs))
    assert difference.frames is None
    assert difference.path is None
    assert "different drives" in describe(difference, "a", "b")


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    a, b = write_run(tmp_path / "a", 0.8), write_run(tmp_path / "b", 1.1)
    assert main(["compare", str(a), str(b)]) == 0
    assert "pitch_deg" in capsys.readouterr().out
    assert main(["compare", "--json", str(a), str(b)]) == 0
    assert json.loads(capsys.readouterr().out)["mount"]["pitch_deg"]["significant"]
    assert main(["compare", str(a), str(tmp_path)]) == 2
    assert "no run there" in capsys.readouterr().err
