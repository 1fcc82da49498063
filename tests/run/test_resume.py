"""A killed run goes on where it was and ends with the same bytes as one that nobody disturbed."""

from __future__ import annotations

import dataclasses
import gc
import json
import os
import signal
import struct
import subprocess
import sys
import time
import tracemalloc
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
from drive_writer import odometry_drive

from stereocalib_core.config import DisparityConfig, PipelineConfig
from stereocalib_core.errors import Failure, FailureReason, OutputError
from stereocalib_core.files.frame_record import Done
from stereocalib_core.files.frames_bin import (
    MAGIC,
    Checkpoint,
    RunKey,
    read_checkpoint,
    read_frames,
    read_outline,
)
from stereocalib_core.frames import Recording, StereoFrame
from stereocalib_core.front import pipeline
from stereocalib_core.geometry import Extrinsics, StereoCamera
from stereocalib_core.results import (
    Check,
    Drive,
    FrameResult,
    FrontEndMemory,
    Measured,
    OwnCarMemory,
    RectificationSample,
    Rig,
    RoadEstimate,
    RoadResidual,
    ScanSample,
    Tolerance,
    Tracks,
)
from stereocalib_core.run.drive import CHECKPOINT, Interrupted, run_drive
from stereocalib_core.sources import open_source

CAMERA = StereoCamera(64, 48, 50.0, 32.0, 24.0, 0.5)
SMALL_PLANE = "synthetic:plane?frames=3&width=320&height=120&focal_px=185&cx_px=157&cy_px=55"
SAME_BYTES = ("extrinsics.csv", "trajectory.txt", "trajectory.tum", "config.json", "rig.yaml")


class Killed(Exception):
    """Stands for SIGKILL: nothing in the run may handle it."""


def finished(index: int) -> Done:
    rng = np.random.default_rng(index)
    covariance = rng.normal(size=(3, 3))
    result = FrameResult(
        index,
        index / 3,
        RoadEstimate(
            Extrinsics(*rng.normal(size=4)),
            covariance,
            17,
            1 / 3,
            (4.5, 31.25),
            (0.1, -1 / 7),
            0.3,
            (1 / 9, 0.7),
            (1 / 11, 0.2),
        ),
        None,
        1 / 7,
        17,
        RectificationSample(rng.normal(size=3), covariance, 5, 0.1),
        Tracks(
            *(rng.normal(size=(9, 6)).astype(np.float32), rng.random(9) > 0.5, index - 1),
            rng.normal(size=(9, 2)).astype(np.float32),
        ),
        (Check("road", "slope", 0.1, None, 3.0, "px"),),
        MappingProxyType({"disparity": 12.5}),
        RoadResidual(rng.normal(size=3), covariance, 4321),
        ScanSample(
            rng.normal(size=(4, 4)), *(rng.integers(-9, 9, (n, 4)).astype(np.int16) for n in range(4)), 0.5
        ),
        rng.normal(size=(7, 2)).astype(np.float32),
    )
    own_car = OwnCarMemory(
        rng.integers(0, 46, 77).astype(np.int16),
        *(12.5, 1 / 3, rng.normal(size=(4, 4)), ((index - 2, 11.5), (index - 9, 1 / 9))),
        rng.integers(-99, 99, (2, 23, 77)).astype(np.int16),
    )
    return Done(result, FrontEndMemory(index, rng.normal(size=6), own_car), 50.0)


def leaves(value: object, path: str = "") -> dict[str, object]:
    """Everything that a result holds, by its place; arrays as type, shape and bytes."""
    if dataclasses.is_dataclass(value):
        parts = {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
    elif isinstance(value, Mapping):
        parts = {str(key): part for key, part in value.items()}
    elif isinstance(value, Sequence) and not isinstance(value, str):
        parts = {str(i): part for i, part in enumerate(value)}
    elif isinstance(value, np.ndarray):
        return {path: (value.dtype.str, value.shape, value.tobytes())}
    else:
        return {path: value}
    return {
        place: leaf for name, part in parts.items() for place, leaf in leaves(part, f"{path}.{name}").items()
    }


def same(a: Done, b: Done) -> bool:
    return leaves(a) == leaves(b)


def test_nothing_of_a_frame_is_forgotten() -> None:
    """Fails when a result gets a new field that `finished` above, and so the checkpoint, does not know."""
    known = finished(0)
    parts = (
        known,
        known.memory,
        known.memory.own_car,
        known.result,
        known.result.road,
        known.result.rectification,
        known.result.tracks,
    )
    for part in (*parts, known.result.lidar, known.result.scan):
        assert part is not None
        for field in dataclasses.fields(part):
            value = getattr(part, field.name)
            if field.name != "failure":
                assert value is not None, field.name
                assert leaves(value) != leaves(field.default), field.name


KEY = RunKey("a", CAMERA, PipelineConfig())


def test_frames_come_back_bit_for_bit(tmp_path: Path) -> None:
    path, header = tmp_path / CHECKPOINT, KEY
    checkpoint = Checkpoint(path, header)
    wrote = [checkpoint.append(finished(i)) for i in range(3)]
    failed = Done(
        FrameResult(3, 1.0, None, Failure(FailureReason.DARK, "mean grey 3")), FrontEndMemory(2, None), 1.0
    )
    checkpoint.append(failed)
    checkpoint.close()
    read, whole = read_checkpoint(path, header)
    assert whole == path.stat().st_size
    assert all(
        same(a, finished(i)) and same(a, b) for i, (a, b) in enumerate(zip(read[:3], wrote, strict=True))
    )
    assert read[3] == failed
    assert read_outline(path) == (CAMERA, 4)
    with path.open("rb+") as file:
        file.truncate(whole - 1)
    assert read_outline(path) == (CAMERA, 3), "what a kill cut off is no frame"


def test_a_record_cut_off_by_a_kill_is_dropped_at_any_byte(tmp_path: Path) -> None:
    path, header = tmp_path / CHECKPOINT, KEY
    checkpoint = Checkpoint(path, header)
    checkpoint.append(finished(0))
    one = path.stat().st_size
    checkpoint.append(finished(1))
    checkpoint.close()
    data = path.read_bytes()
    for cut in range(one, len(data), 97):
        path.write_bytes(data[:cut])
        done, whole = read_checkpoint(path, header)
        assert (len(done), whole) == (1, one)
    flipped = bytearray(data)
    flipped[one + 50] ^= 1
    path.write_bytes(bytes(flipped))
    assert len(read_checkpoint(path, header)[0]) == 1
    again = Checkpoint(path, header, one)
    again.append(finished(1))
    again.close()
    assert path.read_bytes() == data


def test_other_settings_and_strange_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / CHECKPOINT
    Checkpoint(path, KEY).close()
    with pytest.raises(OutputError, match="settings changed"):
        read_checkpoint(path, dataclasses.replace(KEY, settings=PipelineConfig(method="paper")))
    for content, what in (
        (b"\x80\x04pickled", "no checkpoint"),
        (MAGIC, "without a header"),
        (MAGIC + record(b"no JSON"), "without a header"),
        (MAGIC + record(b'{"source": "a"}') + record(b"{}", b'{"source": "a"}'), "damaged checkpoint"),
    ):
        path.write_bytes(content)
        with pytest.raises(OutputError, match=what):
            read_checkpoint(path, KEY)


def record(payload: bytes, before: bytes = b"") -> bytes:
    """A whole record with a right checksum, whatever is in it. before: all payloads before it."""
    return struct.pack("<II", len(payload), zlib.crc32(before + payload)) + payload


def payloads(data: bytes) -> list[bytes]:
    """Those of a checkpoint, the header first."""
    found, at = [], len(MAGIC)
    while at < len(data):
        (length,) = struct.unpack_from("<I", data, at)
        found.append(data[at + 8 : at + 8 + length])
        at += 8 + length
    return found


def test_records_lost_doubled_or_moved_are_never_taken_for_the_run(tmp_path: Path) -> None:
    path, header = tmp_path / CHECKPOINT, KEY
    checkpoint = Checkpoint(path, header)
    for i in range(5):
        checkpoint.append(finished(i))
    checkpoint.close()
    head, *frames = payloads(path.read_bytes())
    for order, whole in (([0, 2, 3, 4], 1), ([0, 1, 1, 2, 3, 4], 2), ([0, 2, 1, 3, 4], 1), ([1, 2, 3, 4], 0)):
        chosen = [frames[i] for i in order]
        # each with the checksum that it was written with: the chain breaks where the order does
        chain = [b"".join([head, *frames[:i]]) for i in order]
        data = MAGIC + record(head) + b"".join(map(record, chosen, chain))
        path.write_bytes(data)
        done = read_checkpoint(path, header)[0]
        assert [d.result.frame for d in done] == list(range(whole))
        # with checksums that fit, as only somebody who means it can make them
        chain = [b"".join([head, *chosen[:i]]) for i in range(len(chosen))]
        path.write_bytes(MAGIC + record(head) + b"".join(map(record, chosen, chain)))
        with pytest.raises(OutputError, match="without all of its frames"):
            read_checkpoint(path, header)


def test_zeros_after_a_power_cut_are_the_end(tmp_path: Path) -> None:
    path, header = tmp_path / CHECKPOINT, KEY
    checkpoint = Checkpoint(path, header)
    checkpoint.append(finished(0))
    checkpoint.close()
    data = path.read_bytes()
    path.write_bytes(data + bytes(4096))
    done, whole = read_checkpoint(path, header)
    assert (len(done), whole) == (1, len(data))
    again = Checkpoint(path, header, whole)
    again.append(finished(1))
    again.close()
    assert len(read_checkpoint(path, header)[0]) == 2


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory, street: Path) -> Path:
    """Thirteen frames of a street in one go; 0-based 20...32."""
    out = tmp_path_factory.mktemp("whole") / "out"
    run_drive(str(street), out, (20, 33))
    assert not (out / CHECKPOINT).exists()
    return out


def check_same(out: Path, undisturbed: Path) -> None:
    for name in SAME_BYTES:
        assert (out / name).read_bytes() == (undisturbed / name).read_bytes(), name
    reports = [json.loads((folder / "report.json").read_text()) for folder in (out, undisturbed)]
    for report in reports:
        for key in ("source", "timing_ms", "frames_per_second"):
            report.pop(key)
    assert reports[0] == reports[1]
    assert sorted(p.name for p in out.iterdir()) == sorted(p.name for p in undisturbed.iterdir())


@pytest.mark.wall_clock
def test_killed_twice_and_resumed(tmp_path: Path, street: Path, undisturbed: Path) -> None:
    out = tmp_path / "out"
    for stop_after in (5, 9):

        def kill(done: int, total: int, what: str, at: int = stop_after) -> None:
            if done == at:
                raise Killed

        with pytest.raises(Killed):
            run_drive(str(street), out, (20, 33), resume=True, progress=kill)
        assert (out / CHECKPOINT).is_file()
    run_drive(str(street), out, (20, 33), resume=True)
    check_same(out, undisturbed)
    before = (out / "report.json").read_bytes()
    run_drive(str(street), out, (20, 33), resume=True)  # already finished: nothing to do
    assert (out / "report.json").read_bytes() == before
    with pytest.raises(OutputError, match="finished run of other frames"):
        run_drive(str(street), out, (20, 30), resume=True)


def test_resume_with_other_settings_touches_nothing(tmp_path: Path, street: Path) -> None:
    out = tmp_path / "out"

    def kill(done: int, *_: object) -> None:
        if done == 2:
            raise Killed

    with pytest.raises(Killed):
        run_drive(str(street), out, (20, 33), progress=kill)
    before = (out / CHECKPOINT).read_bytes()
    with pytest.raises(OutputError, match="settings changed"):
        run_drive(str(street), out, (20, 33), PipelineConfig(disparity=DisparityConfig(scale=1)), resume=True)
    with pytest.raises(OutputError, match="first frame changed"):
        run_drive(str(street), out, (21, 33), resume=True)
    with pytest.raises(OutputError, match="stopped run of more frames"):
        run_drive(str(street), out, (20, 21), resume=True)
    assert (out / CHECKPOINT).read_bytes() == before


@pytest.mark.wall_clock
def test_sigkill_and_resume_by_the_command(tmp_path: Path, street: Path, undisturbed: Path) -> None:
    out = tmp_path / "out"
    command = [
        sys.executable,
        "-m",
        "stereocalib_app.cli.main",
        "run",
        str(street),
        "--out",
        str(out),
        "--frames",
        "20:33",
        "--resume",
    ]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    _wait_for(out / CHECKPOINT, 60_000)
    process.send_signal(signal.SIGKILL)
    process.wait()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    check_same(out, undisturbed)


@pytest.mark.wall_clock
def test_ctrl_c_stops_within_a_second_and_leaves_valid_files(tmp_path: Path, street: Path) -> None:
    out = tmp_path / "out"
    process = subprocess.Popen(
        [sys.executable, "-m", "stereocalib_app.cli.main", "run", str(street), "--out", str(out)],
        stderr=subprocess.PIPE,
        text=True,
    )
    _wait_for(out / CHECKPOINT, 60_000)
    started = time.perf_counter()
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=20)
    assert time.perf_counter() - started < (1.0 if _machine_is_idle() else 3.0)
    assert process.returncode == 130
    assert errors.startswith("stereocalib: stopped: after ")
    assert errors.count("\n") == 1
    rows = (out / "extrinsics.csv").read_text().splitlines()
    assert len(rows) == 1 + json.loads((out / "report.json").read_text())["frames"]


def test_ctrl_c_while_the_results_are_written_loses_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source, whole, out = SMALL_PLANE, tmp_path / "whole", tmp_path / "out"
    run_drive(source, whole)

    def stopped(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("stereocalib_core.files.run_folder.io.write_rig", stopped)
        with pytest.raises(Interrupted, match="after 3 of 3 frames"):
            run_drive(source, out)
    assert (out / CHECKPOINT).is_file()
    run_drive(source, out, resume=True)
    check_same(out, whole)


def test_ctrl_c_before_the_first_frame_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("stereocalib_core.front.pipeline.FrontEnd.look", stopped)
    with pytest.raises(KeyboardInterrupt):
        run_drive(SMALL_PLANE, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def _machine_is_idle() -> bool:
    return os.getloadavg()[0] < (os.cpu_count() or 1)


def _wait_for(path: Path, size: int) -> None:
    deadline = time.monotonic() + 60
    while not path.is_file() or path.stat().st_size < size:
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_a_drive_of_failures_resumes_too(tmp_path: Path) -> None:
    drive = odometry_drive(tmp_path / "d", frames=8)
    (drive / "image_0" / "000003.png").write_bytes(b"")

    def kill(done: int, *_: object) -> None:
        if done == 4:
            raise Killed

    whole, out = tmp_path / "whole", tmp_path / "out"
    run_drive(str(drive), whole)
    with pytest.raises(Killed):
        run_drive(str(drive), out, progress=kill)
    run_drive(str(drive), out, resume=True)
    assert (out / "extrinsics.csv").read_bytes() == (whole / "extrinsics.csv").read_bytes()


@pytest.mark.parametrize("count", [1, 2, 3])
def test_drives_of_a_few_frames(tmp_path: Path, street: Path, count: int) -> None:
    drive = run_drive(str(street), tmp_path, (20, 20 + count))
    assert len(drive.frames) == count
    assert len((tmp_path / "trajectory.txt").read_text().splitlines()) == count


def test_gaps_are_named_by_the_frames_of_the_drive(tmp_path: Path) -> None:
    drive = odometry_drive(tmp_path / "d", frames=8)
    result = run_drive(str(drive), tmp_path / "out", (3, 7))
    assert result.frames_ok == 0
    assert [result.gaps[0][0] >= 3, result.gaps[-1][1]] == [True, 6]


def test_a_finished_run_keeps_its_frames(tmp_path: Path) -> None:
    out = tmp_path / "run"
    run_drive("synthetic:plane?frames=6", out)
    camera, done = read_frames(out / "frames.bin")
    assert [d.result.frame for d in done] == list(range(6))
    assert camera == open_source("synthetic:plane?frames=6").camera
    assert done[-1].result.tracks is not None
    assert done[-1].result.checks


def test_resume_of_a_finished_run_is_of_that_run_only(tmp_path: Path) -> None:
    spec, out = SMALL_PLANE, tmp_path / "run"
    run_drive(spec, out)
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    for changed, options in (
        ("source", {"spec": spec + "&seed=3"}),
        ("settings", {"config": PipelineConfig(method="paper")}),
        ("rig", {"rig": Rig(yaw_rad=Measured(0.01, 0.001))}),
        ("tolerances", {"tolerances": {"height_m": Tolerance(1.65, 0.1)}}),
    ):
        with pytest.raises(OutputError, match=f"{changed} changed"):
            run_drive(**{"spec": spec, "out": out, "resume": True, **options})
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before
    run_drive(spec, out, resume=True, rrd=True)
    after = {path.name: path.read_bytes() for path in out.iterdir()}
    assert sorted(after) == sorted([*before, "recording.rrd"])
    assert all(after[name] == before[name] for name in SAME_BYTES)


def test_two_runs_in_one_folder_are_one_too_many(tmp_path: Path) -> None:
    out, said = tmp_path / "out", []

    def meanwhile(done: int, *_: object) -> None:
        if done != 1:
            return
        for options in ({"resume": True}, {"overwrite": True}):
            with pytest.raises(OutputError, match="another run works there") as caught:
                run_drive(SMALL_PLANE, out, **options)
            said.append(str(caught.value))

    drive = run_drive(SMALL_PLANE, out, progress=meanwhile)
    assert drive.frames_ok == 3 and len(said) == 2
    assert all(f"process {os.getpid()} on " in line and "\n" not in line for line in said)
    assert not (out / ".running").exists()
    run_drive(SMALL_PLANE, out, resume=True)  # finished: nothing to do, and nobody in the way


def test_what_a_killed_run_leaves_keeps_nobody_out(tmp_path: Path) -> None:
    (tmp_path / ".running").write_text("process 1 on nowhere\n")
    assert run_drive(SMALL_PLANE, tmp_path, resume=True).frames_ok == 3
    assert not (tmp_path / ".running").exists()


def test_a_long_drive_waits_on_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What the front end keeps of a frame is needed at the end only: memory does not grow with the frames."""
    frames, tracked = 1500, finished(1)
    big = dataclasses.replace(tracked.result.tracks, points=np.zeros((400, 6), np.float32))  # type: ignore[type-var]
    seen: dict[int, int] = {}

    class Quick:
        memory = FrontEndMemory(None, None)
        pasts = (None, None)

        def __init__(self, *_: object) -> None:
            pass

        def prepare(self, *_: object) -> None:
            pass

        def look(self, frame: StereoFrame, *_: object) -> pipeline.Look:
            result = dataclasses.replace(tracked.result, frame=frame.index, tracks=big)
            return pipeline.Look(result)

    def measured(done: int, total: int, _: str) -> None:
        if done in (300, total):
            gc.collect()
            seen[done] = tracemalloc.get_traced_memory()[0]

    recording = Recording(
        "long", CAMERA, 0.1 * np.arange(frames), lambda i: StereoFrame(i, 0.1 * i, None, None)
    )
    monkeypatch.setattr("stereocalib_core.run.drive.open_source", lambda _: recording)
    monkeypatch.setattr(pipeline, "FrontEnd", Quick)
    monkeypatch.setattr(
        "stereocalib_core.run.drive._analyse", lambda found, job, _: Drive.of_frames(found, job.config)
    )
    tracemalloc.start()
    try:
        drive = run_drive("long", tmp_path / "out", progress=measured)
    finally:
        tracemalloc.stop()
    assert len(drive.frames) == frames
    grown = (seen[frames] - seen[300]) / (frames - 300)
    assert grown < 100, f"{grown:.0f} bytes a frame, of {big.points.nbytes} that each has"
