"""Many drives: names, skipping what is done, and a worker that dies."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from drive_writer import odometry_drive
from stereocalib_app.cli.main import main

from stereocalib_core.benches.batch import different_files
from stereocalib_core.config import PipelineConfig
from stereocalib_core.errors import ConfigError, OutputError, SourceError
from stereocalib_core.geometry import Extrinsics
from stereocalib_core.results import (
    Drive,
    DrivePath,
    FrameResult,
    FrameTable,
    Measured,
    OdometryErrors,
    Rig,
    RoadEstimate,
    Shift,
)
from stereocalib_core.run.batch import (
    SEAL,
    drive_names,
    full_spec,
    run_batch,
    run_one,
    sealed_drive,
)
from stereocalib_core.run.batch_summary import DriveOutcome, row_of, write_summary
from stereocalib_core.run.cluster import Scheduler, cluster
from stereocalib_core.run.drive import CHECKPOINT

pytest.importorskip("distributed")


def test_every_drive_gets_a_name_of_its_own(tmp_path: Path) -> None:
    folders = []
    for town in ("aa", "bb"):
        for number in ("00", "01"):
            folders.append(tmp_path / town / "sequences" / number)
            folders[-1].mkdir(parents=True)
    specs = [
        *map(str, folders),
        "synthetic:town?seed=3",
        "synthetic:town?seed=3",
        "video:a/b.mp4?camera=c.yaml",
    ]
    names = drive_names(specs)
    assert names[:2] == ["aa-sequences-00", "aa-sequences-01"]
    assert len(set(names)) == len(specs)
    assert not any("/" in name or name.startswith(".") for name in names)
    assert drive_names(specs[:2]) == ["00", "01"]
    long = "synthetic:plane?" + "&".join(f"fault=dirt@{i}" for i in range(40))
    assert full_spec(long) == long
    assert len(drive_names([long])[0]) <= 80


def test_a_drive_is_sealed_and_a_damaged_or_changed_one_is_not_trusted(tmp_path: Path) -> None:
    drive, folder, config = str(odometry_drive(tmp_path / "d")), tmp_path / "out", PipelineConfig()
    assert run_one(drive, str(folder), config, False) is None
    assert not (folder / ".lock").exists()
    assert sealed_drive(folder, drive, config) is not None
    assert sealed_drive(folder, drive, PipelineConfig(method="paper")) is None
    before = (folder / "extrinsics.csv").read_text()
    (folder / "extrinsics.csv").write_text(before.replace("0", "1", 1))
    assert sealed_drive(folder, drive, config) is None
    assert run_one(drive, str(folder), config, False) is None
    assert (folder / "extrinsics.csv").read_text() == before
    (Path(drive) / "image_0" / "000002.png").write_bytes(b"")
    assert sealed_drive(folder, drive, config) is None


def test_what_is_wrong_with_a_drive_is_a_value(tmp_path: Path) -> None:
    drive = odometry_drive(tmp_path / "d")
    (drive / "calib.txt").write_text("P0: nan\n")
    wrong = run_one(str(drive), str(tmp_path / "out"), PipelineConfig(), False)
    assert wrong is not None and "calib.txt" in wrong


def test_a_checkpoint_of_other_settings_is_started_afresh(tmp_path: Path) -> None:
    drive, folder = str(odometry_drive(tmp_path / "d")), tmp_path / "out"
    folder.mkdir()
    (folder / CHECKPOINT).write_bytes(b"of an older version")
    assert run_one(drive, str(folder), PipelineConfig(), False) is None
    assert sealed_drive(folder, drive, PipelineConfig()) is not None


def test_the_summary_lists_every_drive_and_escapes_what_it_quotes(tmp_path: Path) -> None:
    road = RoadEstimate(Extrinsics(1.65, 0.0, 0.0), np.eye(3) * 1e-6, 9, 0.5, (5.0, 30.0))
    results = [FrameResult(i, 0.1 * i, road if i < 4 else None) for i in range(10)]
    unknown = np.full((10, 4, 4), np.nan)
    shift = Shift(3, "height", 0.1, 0.01, "step", 5)
    drive = Drive(
        FrameTable.of(results),
        mount=Rig(height_m=Measured(1.65, 0.01)),
        paths={"autocalibrated": DrivePath(unknown, unknown, OdometryErrors(12.0))},
        shifts=(shift, shift),
    )
    outcomes = [
        DriveOutcome("one", "/data/one", "done", drive=drive),
        DriveOutcome("two", "/data/two", "failed", "no drive: <img src=x> | here: leave"),
    ]
    write_summary(tmp_path, outcomes)
    rows = list(csv.DictReader((tmp_path / "summary.csv").open()))
    assert [row["status"] for row in rows] == ["done", "failed"]
    assert float(rows[0]["height_m"]) == 1.65
    assert rows[0]["yaw_deg"] == ""
    assert row_of(outcomes[0])["shifts"] == 2
    text = (tmp_path / "summary.md").read_text()
    assert "1 of 2 drives" in text
    assert "<img" not in text
    assert "only 4 of 10" in text
    assert (tmp_path / "summary.png").read_bytes().startswith(b"\x89PNG")


def test_only_bad_sources_leave_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("stereocalib_core.run.cluster.CONNECT_TIMEOUT_S", 1)
    out = tmp_path / "out"
    with pytest.raises(SourceError):
        run_batch([str(tmp_path / "none")], out)
    assert not out.exists()
    out.mkdir()
    (out / "mine").write_text("")
    with pytest.raises(OutputError):
        run_batch([str(odometry_drive(tmp_path / "d"))], out)
    assert main(["batch", str(tmp_path / "none"), "--out", str(tmp_path / "new")]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    drive = str(odometry_drive(tmp_path / "e"))
    assert main(["batch", drive, "--out", str(tmp_path / "new"), "--scheduler", "tcp://127.0.0.1:9"]) == 2
    assert "no Dask scheduler" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


def part_of(sequence: Path, folder: Path, frames: int) -> Path:
    """The first frames of a real drive, by links."""
    for name in ("image_0", "image_1"):
        (folder / name).mkdir(parents=True)
        for i in range(frames):
            (folder / name / f"{i:06d}.png").symlink_to(sequence / name / f"{i:06d}.png")
    for name in ("calib.txt", "times.txt"):
        (folder / name).symlink_to(sequence / name)
    return folder


@pytest.mark.wall_clock
def test_a_killed_worker_loses_nothing_and_a_second_call_does_nothing(tmp_path: Path, street: Path) -> None:
    """Two workers, two drives and one that is none; one worker is killed in the middle."""
    out = tmp_path / "out"
    drives = [
        part_of(street, tmp_path / "long", 20),
        part_of(street, tmp_path / "short", 5),
    ]
    (tmp_path / "none").mkdir()
    command = [
        sys.executable,
        "-m",
        "stereocalib_app.cli.main",
        "batch",
        *map(str, drives),
        str(tmp_path / "none"),
    ]
    command += ["--out", str(out), "--workers", "2"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 200
    checkpoint = out / "long" / CHECKPOINT
    while not checkpoint.is_file() or checkpoint.stat().st_size < 20_000:
        assert time.monotonic() < deadline
        assert process.poll() is None
        time.sleep(0.02)
    worker = _writer_of(checkpoint, process.pid)
    assert _fewest_cores(worker) == 1
    os.kill(worker, signal.SIGKILL)
    _, errors = process.communicate(timeout=240)
    assert process.returncode == 3, errors
    assert "1 of 3 drives failed" in errors
    assert errors.count("\n") == 1
    for name, count in (("long", 20), ("short", 5)):
        assert json.loads((out / name / "report.json").read_text())["frames"] == count
        assert (out / name / SEAL).is_file()
    undisturbed = tmp_path / "undisturbed"
    run_one(str(drives[0]), str(undisturbed), PipelineConfig(), False)
    for name in ("extrinsics.csv", "trajectory.txt"):
        assert (undisturbed / name).read_bytes() == (out / "long" / name).read_bytes()
    before = {path: path.stat().st_mtime_ns for path in out.glob("*/report.json")}
    summary = run_batch([*map(str, drives), str(tmp_path / "none")], out)  # needs no cluster any more
    assert (summary.done, summary.total) == (2, 3)
    assert {path: path.stat().st_mtime_ns for path in out.glob("*/report.json")} == before


def _writer_of(path: Path, ancestor: int) -> int:
    """The process under `ancestor` that has `path` open."""
    for entry in Path("/proc").iterdir():
        if not entry.name.isdecimal() or int(entry.name) == ancestor:
            continue
        try:
            if any(link.resolve() == path.resolve() for link in (entry / "fd").iterdir()):
                return int(entry.name)
        except OSError:
            continue
    raise AssertionError("nobody writes the checkpoint")


def _fewest_cores(process: int) -> int:
    """Of the threads of a process, how many cores the most bound one may use."""
    return min(len(os.sched_getaffinity(int(task.name))) for task in Path(f"/proc/{process}/task").iterdir())


def test_a_scheduler_at_another_address(tmp_path: Path, street: Path) -> None:
    """A scheduler that was there before, with a worker that runs two drives at once in one process."""
    drives = [str(part_of(street, tmp_path / name, 3)) for name in ("a", "b")]
    known = tmp_path / "scheduler.json"
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    dask = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.2", "--port", "0"]
    dask += ["--no-dashboard", "--scheduler-file", str(known)]
    scheduler = subprocess.Popen(dask, **quiet)  # type: ignore[call-overload]
    worker = [sys.executable, "-m", "distributed.cli.dask_worker", "--scheduler-file", str(known)]
    worker += ["--nthreads", "2", "--no-nanny", "--no-dashboard", "--local-directory", str(tmp_path)]
    processes = [scheduler]
    try:
        _wait_for(known)
        processes.append(subprocess.Popen(worker, **quiet))  # type: ignore[call-overload]
        address = json.loads(known.read_text())["address"]
        assert address.startswith("tcp://127.0.0.2:")
        summary = run_batch(drives, tmp_path / "out", scheduler=Scheduler(address))
    finally:
        for process in reversed(processes):
            process.kill()
            process.wait()
    assert (summary.done, summary.total) == (2, 2)
    assert run_one(drives[0], str(tmp_path / "alone"), PipelineConfig(), False) is None
    for name in ("a", "b"):
        csv_file = tmp_path / "out" / name / "extrinsics.csv"
        assert csv_file.read_bytes() == (tmp_path / "alone" / "extrinsics.csv").read_bytes()


def test_a_local_cluster_lets_no_other_process_in() -> None:
    """Without the certificates of this very cluster nobody is heard, with or without TLS of their own."""
    import distributed

    with cluster(1, None, 1) as client:
        address = client.scheduler.address
        assert address.startswith("tls://127.0.0.1:")
        assert client.submit(int, "7").result(timeout=60) == 7
        trimmed = client.submit(os.environ.get, "MALLOC_TRIM_THRESHOLD_").result(timeout=60)
        assert trimmed == os.environ.get(
            "MALLOC_TRIM_THRESHOLD_"
        )  # freed memory is kept as in any other process
        for spec, security in (
            (address.replace("tls://", "tcp://"), None),
            (address, distributed.Security.temporary()),
        ):
            with pytest.raises((OSError, TypeError)):
                distributed.Client(spec, security=security, timeout=2)


def test_certificates_belong_to_a_tls_address(tmp_path: Path) -> None:
    files = [tmp_path / name for name in ("ca.pem", "cert.pem", "key.pem")]
    for path in files:
        path.write_text("")
    assert Scheduler("tls://far:8786", *files).note is None
    for wrong in (("tls://far:8786",), ("tls://far:8786", *files[:2]), ("tcp://far:8786", *files)):
        with pytest.raises(ConfigError, match="--tls-ca"):
            Scheduler(*wrong)  # type: ignore[arg-type]
    files[2].unlink()
    with pytest.raises(ConfigError, match="key.pem"):
        Scheduler("tls://far:8786", *files)


@pytest.mark.parametrize(
    ("address", "warned"),
    [
        ("tcp://127.0.0.2:8786", False),
        ("tcp://[::1]:1", False),
        ("tcp://localhost:1", False),
        ("tcp://10.0.0.5:8786", True),
    ],
)
def test_an_open_scheduler_on_another_machine_is_warned_of(address: str, warned: bool) -> None:
    note = Scheduler(address).note
    assert (note is not None) == warned
    assert note is None or "not encrypted" in note


def _wait_for(path: Path) -> None:
    deadline = time.monotonic() + 60
    while not path.is_file() or not path.read_text().rstrip().endswith("}"):
        assert time.monotonic() < deadline
        time.sleep(0.05)


def test_the_bench_compares_bytes(tmp_path: Path) -> None:
    for name in ("one", "two"):
        (tmp_path / name / "drive").mkdir(parents=True)
        (tmp_path / name / "drive" / "rig.yaml").write_text("yaw_deg: 1\n")
        (tmp_path / name / "drive" / "report.json").write_text(json.dumps({"source": name, "frames": 5}))
    assert different_files(tmp_path / "one", tmp_path / "two") == []
    (tmp_path / "two" / "drive" / "rig.yaml").write_text("yaw_deg: 2\n")
    assert different_files(tmp_path / "one", tmp_path / "two") == ["drive/rig.yaml"]
    (tmp_path / "two" / "drive" / "report.json").write_text(json.dumps({"source": "two", "frames": 6}))
    assert different_files(tmp_path / "one", tmp_path / "two") == ["drive/report.json", "drive/rig.yaml"]
