"""The Rerun recording, read back with Rerun's own reader and passed by its own verifier."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
import rerun.chunk

from stereocalib_core.config import DisparityConfig
from stereocalib_core.errors import Failure, FailureReason, OutputError
from stereocalib_core.files.rrd import Recorder, _listening, horizon_line, road_grid
from stereocalib_core.frames import StereoFrame
from stereocalib_core.front.matching import compute
from stereocalib_core.geometry import Extrinsics, StereoCamera, transform
from stereocalib_core.results import (
    Drive,
    DrivePath,
    FilteredExtrinsics,
    FrameResult,
    FrameTable,
    LidarCheck,
    LidarShift,
    OdometryErrors,
    Residual,
    RoadEstimate,
    Shift,
)
from stereocalib_core.run.drive import run_drive

CAMERA = StereoCamera(640, 240, 400.0, 319.5, 119.5, 0.5)
POSE = Extrinsics.from_degrees(1.65, 0.8, -0.4)
COUNT, BAD = 8, 5


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eight frames, the sixth of which failed; the first is number 3 of its drive."""
    path = tmp_path_factory.mktemp("rrd") / "recording.rrd"
    recorder = Recorder(CAMERA, "test", path)
    road = RoadEstimate(POSE, np.diag([1e-4, 1e-7, 1e-7]), 99, 0.5, (5.0, 30.0))
    results = []
    for i in range(COUNT):
        failure = Failure(FailureReason.DARK, "mean grey 3") if i == BAD else None
        result = FrameResult(3 + i, i / 10, None if failure else road, failure)
        picture = np.random.default_rng(i).integers(0, 255, (240, 640)).astype(np.uint8)
        recorder.frame(
            StereoFrame(3 + i, i / 10, picture, picture),
            result,
            compute(picture, picture, CAMERA, DisparityConfig()),
        )
        results.append(result)
    values = np.tile([1.64, np.deg2rad(0.7), np.deg2rad(-0.3)], (COUNT, 1))
    covariance = np.tile(np.diag([0.01**2, 1e-8, 1e-8]), (COUNT, 1, 1))
    states = tuple("none" if i == 0 else "updated" for i in range(COUNT))
    poses = np.array([transform(np.eye(3), [0, 0, 1.5 * i]) for i in range(COUNT)])
    nothing = Residual(0.0, 0.0, 0.0, 0.0)
    knocked = LidarShift(7, "roll", np.deg2rad(0.5), 0.001, "step", 9)
    drive = Drive(
        FrameTable.of(results, FilteredExtrinsics(values, covariance, states)),
        paths={"autocalibrated": DrivePath(poses, np.zeros((COUNT, 6, 6)), OdometryErrors(10.5))},
        gaps=((8, 8),),
        shifts=(Shift(9, "pitch", np.deg2rad(0.3), 0.001, "step", 10),),
        lidar=LidarCheck(nothing, nothing, nothing, (knocked,), COUNT, "yaw"),
    )
    recorder.drive(drive, poses)
    recorder.close(keep=True)
    return path


def chunks(path: Path, entity: str) -> Iterator[object]:
    for chunk in rerun.chunk.RrdReader(str(path)).stream():
        if str(chunk.entity_path) == entity and not chunk.is_static:
            yield chunk.to_record_batch()


def column(path: Path, entity: str, name: str) -> list[object]:
    """One component over time, in the order of the frames."""
    rows: list[tuple[int, object]] = []
    for batch in chunks(path, entity):
        if name in batch.schema.names:  # type: ignore[attr-defined]
            table = batch.to_pydict()  # type: ignore[attr-defined]
            rows += zip(table["frame"], table[name], strict=True)
    return [value for _, value in sorted(rows, key=lambda row: row[0])]


def frames(path: Path, entity: str) -> list[int]:
    return sorted(f for batch in chunks(path, entity) for f in batch.to_pydict()["frame"])  # type: ignore[attr-defined]


def verify(path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "rerun", "rrd", "verify", str(path)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "verified without error" in done.stdout + done.stderr


def test_it_verifies_and_opens_arranged(recorded: Path) -> None:
    verify(recorded)
    reader = rerun.chunk.RrdReader(str(recorded))
    assert len(reader.recordings()) == 1
    assert len(reader.blueprints()) == 1
    assert [path.name for path in recorded.parent.iterdir()] == [recorded.name]


def test_every_view_of_the_blueprint_has_something_to_show(recorded: Path) -> None:
    reader = rerun.chunk.RrdReader(str(recorded))
    entities = {str(chunk.entity_path).strip("/") for chunk in reader.stream()}
    origins, timelines = [], []
    for chunk in reader.stream(store=reader.blueprints()[0]):
        table = chunk.to_record_batch().to_pydict()
        origins += [origin for (origin,) in table.get("ViewBlueprint:space_origin", [])]
        timelines += [name for (name,) in table.get("TimePanelBlueprint:timeline", [])]
    assert len(origins) == 7
    assert timelines == ["frame"]
    for origin in origins:
        path = origin.strip("/")
        assert any(entity == path or entity.startswith(f"{path}/") for entity in entities), origin


def test_every_frame_is_there_and_failed_ones_show_no_road(recorded: Path) -> None:
    every = list(range(3, 3 + COUNT))
    assert frames(recorded, "/world/camera/image") == every
    assert frames(recorded, "/disparity") == every
    good = [frame for frame in every if frame != 3 + BAD]
    assert frames(recorded, "/extrinsics/pitch_deg/raw") == good
    assert frames(recorded, "/extrinsics/pitch_deg/filtered") == every[1:]
    blob = column(recorded, "/world/camera/image", "EncodedImage:blob")[2]
    picture = cv2.imdecode(np.frombuffer(bytes(blob[0]), np.uint8), cv2.IMREAD_GRAYSCALE)  # type: ignore[index]
    truth = np.random.default_rng(2).integers(0, 255, (240, 640))
    assert np.corrcoef(picture.ravel(), truth.ravel())[0, 1] > 0.8


def test_numbers_come_back(recorded: Path) -> None:
    for axis, raw, filtered in (("height_m", 1.65, 1.64), ("pitch_deg", 0.8, 0.7), ("roll_deg", -0.4, -0.3)):
        np.testing.assert_allclose(column(recorded, f"/extrinsics/{axis}/raw", "Scalars:scalars"), raw)
        np.testing.assert_allclose(
            column(recorded, f"/extrinsics/{axis}/filtered", "Scalars:scalars"), filtered
        )
    np.testing.assert_allclose(column(recorded, "/extrinsics/height_m/high", "Scalars:scalars"), 1.65)
    positions = np.array(column(recorded, "/world/camera", "Transform3D:translation"))
    np.testing.assert_allclose(positions.reshape(-1, 3)[:, 2], 1.5 * np.arange(COUNT), rtol=1e-6)
    events = " ".join(str(text) for text in column(recorded, "/events", "TextLog:text"))
    assert "DARK, mean grey 3" in events
    assert "step of pitch by +0.300 deg" in events
    assert "LiDAR: step of roll by +0.500 deg" in events


def test_road_and_horizon_agree_with_the_geometry() -> None:
    for line in road_grid(POSE):
        assert np.abs(POSE.plane().signed_distance(line)).max() < 1e-9
    far = CAMERA.project(POSE.R_camera_road @ [0.0, 0.0, 1e6] + POSE.T_camera_road[:3, 3])
    (u0, v0), (u1, v1) = horizon_line(CAMERA, POSE)
    assert v0 + (v1 - v0) * (far[0] - u0) / (u1 - u0) == pytest.approx(far[1], abs=1e-3)


def test_a_failed_run_leaves_no_recording(tmp_path: Path) -> None:
    recorder = Recorder(CAMERA, "test", tmp_path / "recording.rrd")
    recorder.close(keep=False)
    assert list(tmp_path.iterdir()) == []


def test_a_run_writes_it_small_enough(tmp_path: Path, street: Path) -> None:
    run_drive(str(street), tmp_path / "out", (20, 26), rrd=True)
    path = tmp_path / "out" / "recording.rrd"
    verify(path)
    assert frames(path, "/world/camera/image") == list(range(20, 26))
    per_frame = path.stat().st_size / 6
    assert per_frame * 1100 < 170e6  # six frames carry the whole blueprint and every path


def test_a_viewer_that_cannot_start_is_one_clear_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("stereocalib_core.files.rrd._listening", lambda: False)
    monkeypatch.setattr("stereocalib_core.files.rrd.sys.executable", "/bin/false")
    with pytest.raises(OutputError, match="use --rrd instead"):
        Recorder(CAMERA, "test", None)


@pytest.mark.wall_clock
def test_a_viewer_that_listens_is_sent_the_whole_run(
    tmp_path: Path, street: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In place of a window, Rerun's own server that saves what it is sent."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    path = tmp_path / "shown.rrd"
    command = [sys.executable, "-m", "rerun", "--bind", "127.0.0.1", "--port", str(port), "--save", str(path)]
    viewer = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )
    monkeypatch.setattr("stereocalib_core.files.rrd.VIEWER_PORT", port)
    monkeypatch.setattr("stereocalib_core.files.rrd.VIEWER_URL", f"rerun+http://127.0.0.1:{port}/proxy")
    try:
        deadline = time.monotonic() + 60
        while not _listening() and time.monotonic() < deadline:
            time.sleep(0.1)
        run_drive(str(street), tmp_path / "out", (20, 23), rerun=True)
        time.sleep(1.0)
    finally:
        os.killpg(viewer.pid, signal.SIGINT)
        try:
            viewer.wait(30)
        except subprocess.TimeoutExpired:
            # It may miss the signal; what it was sent is in its file all the same.
            os.killpg(viewer.pid, signal.SIGKILL)
            viewer.wait()
    assert not (tmp_path / "out" / "recording.rrd").exists()
    assert frames(path, "/world/camera/image") == [20, 21, 22]
    assert frames(path, "/world/camera") == [20, 21, 22]
