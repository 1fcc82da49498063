"""The command line: exit codes, one-line errors, and an output folder that is clean or complete."""

from __future__ import annotations

import json
import re
import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from drive_writer import odometry_drive
from stereocalib_app.cli.commands import COMMANDS
from stereocalib_app.cli.main import main

from stereocalib_core.errors import Failure, FailureReason
from stereocalib_core.frames import StereoFrame
from stereocalib_core.front import pipeline
from stereocalib_core.geometry import Extrinsics
from stereocalib_core.results import Drive, FrameResult, FrontEndMemory, RoadEstimate

ONE_LINE = re.compile(r"stereocalib: error: [^:\n]+: .+: .+\n")


class FakeFrontEnd:
    """Answers at once: the same road for every readable pair."""

    fail_from = 10**9
    interrupt_at = 10**9
    memory = FrontEndMemory(None, None)
    pasts = (None, None)

    def __init__(self, *_: object) -> None:
        pass

    def prepare(self, *_: object) -> None:
        pass

    def look(self, frame: StereoFrame, *_: object) -> pipeline.Look:
        return pipeline.Look(self.step(frame))

    def step(self, frame: StereoFrame) -> FrameResult:
        if frame.index == self.interrupt_at:
            raise KeyboardInterrupt
        failure = frame.failure
        if frame.index >= self.fail_from:
            failure = Failure(FailureReason.DARK, "test")
        if failure is not None:
            return FrameResult(frame.index, frame.timestamp_s, None, failure)
        covariance = np.diag([1e-4, 1e-7, 1e-7])
        road = RoadEstimate(Extrinsics.from_degrees(1.65, 0.8, -0.4), covariance, 500, 0.5, (5.0, 25.0))
        return FrameResult(frame.index, frame.timestamp_s, road, timing_ms={"disparity": 1.0})


@pytest.fixture
def front_end(monkeypatch: pytest.MonkeyPatch) -> type[FakeFrontEnd]:
    """Replaces the estimation, and the back end, by something instant."""
    chosen = type("Chosen", (FakeFrontEnd,), {})
    monkeypatch.setattr(pipeline, "FrontEnd", chosen)
    monkeypatch.setattr(
        "stereocalib_core.run.drive._analyse", lambda results, job, _: Drive.of_frames(results, job.config)
    )
    return chosen


def failed_line(capsys: pytest.CaptureFixture[str], *argv: str) -> str:
    """Runs a command that must fail, and gives its one line."""
    assert main(argv) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert ONE_LINE.fullmatch(output.err), output.err
    return output.err


def _cpu_of_children_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def test_help_is_complete_and_fast() -> None:
    """Within 0.3 s of work: a machine that others use makes the clock run on, not that."""
    took = []
    for argv in ([], ["run"], ["synth"], ["lidar-camera"]):
        before = _cpu_of_children_s()
        done = subprocess.run(
            [sys.executable, "-m", "stereocalib_app.cli.main", *argv, "--help"],
            capture_output=True,
            text=True,
            check=False,
        )
        took.append(_cpu_of_children_s() - before)
        assert done.returncode == 0
        assert done.stderr == ""
    assert max(took) < 0.3
    top = subprocess.run(
        [sys.executable, "-m", "stereocalib_app.cli.main", "--help"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    for command in COMMANDS:
        assert re.search(rf"^    {command} +\S", top, re.MULTILINE), command
    assert max(map(len, top.splitlines())) <= 100


@pytest.mark.parametrize(
    "argv",
    [
        [],
        ["fly"],
        ["run"],
        ["run", "x"],
        ["run", "x", "--out", "y", "--frames", "5"],
        ["run", "x", "--out", "y", "--frames", "-1:5"],
        ["run", "x", "--out", "y", "--method", "magic"],
        ["view", "x", "--port", "99999"],
        ["view", "x", "--port", "http"],
        ["experiments", "cooking", "--out", "y"],
        ["batch", "a", "--out", "y", "--workers", "0"],
        ["batch", "a", "--out", "y", "--workers", "2", "--scheduler", "tcp://h:1"],
    ],
)
def test_bad_usage(argv: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert "bad usage" in failed_line(capsys, *argv)


def test_a_run_writes_its_files_and_says_so(
    tmp_path: Path, front_end: type[FakeFrontEnd], capsys: pytest.CaptureFixture[str]
) -> None:
    drive, out = odometry_drive(tmp_path), tmp_path / "new" / "out"
    assert main(["run", str(drive), "--out", str(out)]) == 0
    output = capsys.readouterr()
    assert output.err == ""
    assert "6 of 6 frames ok" in output.out
    report = json.loads((out / "report.json").read_text())
    assert (report["frames"], report["frames_ok"], report["method"]) == (6, 6, "direct")
    assert report["height_m"]["median"] == pytest.approx(1.65)
    assert report["timing_ms"]["disparity"] == 1.0
    assert json.loads((out / "config.json").read_text())["method"] == "direct"
    assert len((out / "extrinsics.csv").read_text().splitlines()) == 7
    assert not [path for path in out.iterdir() if path.name.startswith(".")]


def test_frames_method_and_notices_reach_the_report(
    tmp_path: Path, front_end: type[FakeFrontEnd], capsys: pytest.CaptureFixture[str]
) -> None:
    drive, out = odometry_drive(tmp_path), tmp_path / "out"
    (drive / "times.txt").unlink()
    assert main(["run", str(drive), "--out", str(out), "--frames", "2:5", "--method", "paper"]) == 0
    rows = (out / "extrinsics.csv").read_text().splitlines()[1:]
    assert [row.split(",")[0] for row in rows] == ["2", "3", "4"]
    report = json.loads((out / "report.json").read_text())
    assert report["method"] == "paper"
    assert any("times.txt" in text for text in report["notices"])
    assert "times.txt" in capsys.readouterr().out


def test_the_output_folder_must_be_new_or_empty(
    tmp_path: Path, front_end: type[FakeFrontEnd], capsys: pytest.CaptureFixture[str]
) -> None:
    drive, out = str(odometry_drive(tmp_path)), tmp_path / "out"
    out.mkdir()
    assert main(["run", drive, "--out", str(out)]) == 0
    capsys.readouterr()
    assert "not empty" in failed_line(capsys, "run", drive, "--out", str(out))
    (out / "mine.txt").write_text("keep")
    (out / "recording.rrd").write_text("of the earlier run")
    assert main(["run", drive, "--out", str(out), "--overwrite"]) == 0
    assert (out / "mine.txt").read_text() == "keep"
    assert not (out / "recording.rrd").exists()
    capsys.readouterr()
    (tmp_path / "file").write_text("")
    assert "is a file" in failed_line(capsys, "run", drive, "--out", str(tmp_path / "file"))


def test_bad_input_leaves_nothing_behind(
    tmp_path: Path, front_end: type[FakeFrontEnd], capsys: pytest.CaptureFixture[str]
) -> None:
    drive = odometry_drive(tmp_path)
    files = {
        "bad.yaml": "disparity: {scale: 3}",
        "zero.yaml": "free_map: {bin_px: 0}",
        "nan.yaml": "lane: {far_m: .nan}",
        "steep.yaml": "profile: {max_pitch_rad: 2}",
        "unknown.yaml": "speed: 3",
        "broken.yaml": "a: [",
        "tolerance.yaml": "height_m: {nominal: 1.65}",
        "axis.yaml": "hight: {nominal: 1.65, tolerance: 0.1}",
        "rig.yaml": "yaw_deg: left",
    }
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    out = tmp_path / "deep" / "out"
    cases = [
        [str(tmp_path / "nowhere")],
        [str(tmp_path)],
        [str(drive), "--frames", "6:9"],
        [str(drive), "--frames", "3:3"],
        [str(drive), "--config", str(tmp_path / "bad.yaml")],
        [str(drive), "--config", str(tmp_path / "zero.yaml")],
        [str(drive), "--config", str(tmp_path / "nan.yaml")],
        [str(drive), "--config", str(tmp_path / "steep.yaml")],
        [str(drive), "--config", str(tmp_path / "unknown.yaml")],
        [str(drive), "--config", str(tmp_path / "broken.yaml")],
        [str(drive), "--config", str(tmp_path / "missing.yaml")],
        [str(drive), "--tolerance", str(tmp_path / "tolerance.yaml")],
        [str(drive), "--tolerance", str(tmp_path / "axis.yaml")],
        [str(drive), "--rig", str(tmp_path / "rig.yaml")],
    ]
    for case in cases:
        failed_line(capsys, "run", *case, "--out", str(out))
        assert not out.parent.exists(), case
    (drive / "calib.txt").write_text("P0: nan\n")
    failed_line(capsys, "run", str(drive), "--out", str(out))
    assert not out.parent.exists()


def test_an_output_folder_that_cannot_be_made(
    tmp_path: Path, front_end: type[FakeFrontEnd], capsys: pytest.CaptureFixture[str]
) -> None:
    drive = odometry_drive(tmp_path)
    (tmp_path / "file").write_text("")
    failed_line(capsys, "run", str(drive), "--out", str(tmp_path / "file" / "out"))


def test_mostly_failed_frames_exit_3_with_the_reason(
    tmp_path: Path, front_end: type[FakeFrontEnd], capsys: pytest.CaptureFixture[str]
) -> None:
    front_end.fail_from = 2
    out = tmp_path / "out"
    assert main(["run", str(odometry_drive(tmp_path)), "--out", str(out)]) == 3
    assert capsys.readouterr().err == ("stereocalib: not to be trusted: only 2 of 6 frames are ok (4 DARK)\n")
    report = json.loads((out / "report.json").read_text())
    assert report["gaps"] == [[2, 5]]
    assert report["failures"] == {"DARK": 4}
    assert report["trustworthy"] is False


def test_a_stopped_run_leaves_valid_files(
    tmp_path: Path, front_end: type[FakeFrontEnd], capsys: pytest.CaptureFixture[str]
) -> None:
    drive, out = odometry_drive(tmp_path), tmp_path / "out"
    front_end.interrupt_at = 4
    assert main(["run", str(drive), "--out", str(out)]) == 130
    assert "after 4 of 6 frames" in capsys.readouterr().err
    assert len((out / "extrinsics.csv").read_text().splitlines()) == 5
    assert json.loads((out / "report.json").read_text())["frames"] == 4


def test_a_run_stopped_before_its_first_frame_leaves_nothing(
    tmp_path: Path, front_end: type[FakeFrontEnd]
) -> None:
    front_end.interrupt_at = 0
    out = tmp_path / "out"
    assert main(["run", str(odometry_drive(tmp_path)), "--out", str(out)]) == 130
    assert not out.exists()


def test_folders_of_boards_that_do_not_exist(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    failed_line(capsys, "lidar-camera", str(tmp_path / "none"), "--out", str(tmp_path / "out"))
    failed_line(capsys, "view-lidar", str(tmp_path / "none"))
    assert not (tmp_path / "out").exists()
