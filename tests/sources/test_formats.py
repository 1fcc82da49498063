"""The same pairs in every format: pixels, camera, times, truth and scans come out as they went in."""

from __future__ import annotations

import csv
import dataclasses
from pathlib import Path

import cv2
import numpy as np
import pytest
from sources.laid_out import LAYOUTS, MORE, Drive, Layout, bag_of, drive_of, unrectified

from stereocalib_core.config import PipelineConfig
from stereocalib_core.frames import FrameSource
from stereocalib_core.front.pipeline import FrontEnd
from stereocalib_core.run.drive import run_drive
from stereocalib_core.sources import open_source
from stereocalib_core.sources.calibrations import write_calibration
from stereocalib_core.sources.lists import from_first

FRAMES = 30
ALL = {**LAYOUTS, **MORE}


@pytest.fixture(scope="module")
def drive_06(short_drive: Path) -> Drive:
    return drive_of(open_source(str(short_drive)), FRAMES)


def check(source: FrameSource, drive: Drive, layout: Layout) -> None:
    """What a format must deliver of the drive that was laid out."""
    assert len(source) == len(drive), source.notices
    camera = source.camera
    assert (camera.width, camera.height) == drive.size
    stated = (camera.focal_px, camera.cx_px, camera.cy_px, camera.baseline_m, camera.disparity_offset_px)
    np.testing.assert_allclose(stated, (*drive.camera, 0.0), rtol=1e-14, atol=1e-12)
    for i in range(len(drive)):
        frame = source[i]
        assert frame.failure is None, frame.failure
        for found, wanted in zip((frame.left, frame.right), drive.grey(i), strict=True):
            assert found is not None
            np.testing.assert_array_equal(found, wanted)
        if layout.lidar:
            assert frame.lidar is not None, source.notices
            np.testing.assert_array_equal(frame.lidar, drive.scans[i])
    ns = np.array(drive.stamps_ns)
    wanted_s = {
        "none": np.arange(len(drive)) / 10.0,
        "first": (ns - ns[0]) / 1e9,
        "absolute": ns / 1e9,
    }[layout.stamps]
    np.testing.assert_allclose(source.epoch_s + source.timestamps_s, wanted_s, rtol=0, atol=1e-6)
    if layout.lidar:
        assert source.T_camera_lidar is not None
        np.testing.assert_allclose(source.T_camera_lidar, drive.T_camera_lidar, atol=1e-9)
    truth = source.ground_truth
    if not layout.truth:
        assert truth is None
        return
    assert truth is not None and truth.poses is not None, source.notices
    assert truth.heading_reliable == (layout.truth == "whole")
    if layout.truth == "length":
        wanted = np.linalg.norm(np.diff(drive.poses[:, 2, 3]))
        found_steps = np.linalg.norm(np.diff(truth.poses[:, :3, 3], axis=0), axis=1)
        np.testing.assert_allclose(np.linalg.norm(found_steps), wanted, rtol=1e-3)
        return
    np.testing.assert_allclose(truth.poses, from_first(drive.poses), atol=1e-6)


@pytest.mark.parametrize("name", list(ALL))
def test_every_format_delivers_the_same(tmp_path: Path, drive_06: Drive, name: str) -> None:
    if "bag" in name or "MCAP" in name:
        pytest.importorskip("rosbags")
    spec = ALL[name].write(tmp_path, drive_06)
    check(open_source(spec), drive_06, ALL[name])


RUN_FRAMES = 12


Run = tuple[list[list[str]], str]


@pytest.fixture(scope="module")
def reference_run(tmp_path_factory: pytest.TempPathFactory, drive_06: Drive) -> Run:
    return _run(tmp_path_factory.mktemp("reference"), drive_06, "KITTI odometry")


@pytest.fixture(scope="module")
def reference_without_times(tmp_path_factory: pytest.TempPathFactory, drive_06: Drive) -> Run:
    """Ten frames a second, as in formats that carry no times: how far the body can have moved depends on them."""
    evenly = dataclasses.replace(drive_06, stamps_ns=[10**8 * i for i in range(len(drive_06))])
    return _run(tmp_path_factory.mktemp("evenly"), evenly, "KITTI odometry")


def _run(place: Path, drive: Drive, name: str) -> Run:
    """Rows of extrinsics.csv without their times, and the trajectory."""
    short = dataclasses.replace(
        drive,
        **{key: getattr(drive, key)[:RUN_FRAMES] for key in ("left", "right", "stamps_ns", "poses", "scans")},
    )
    spec = ALL[name].write(place / "drive", short)
    run_drive(spec, place / "out")
    with (place / "out" / "extrinsics.csv").open(newline="") as file:
        rows = list(csv.reader(file))
    times = rows[0].index("timestamp_s")
    return [row[:times] + row[times + 1 :] for row in rows], (place / "out" / "trajectory.txt").read_text()


@pytest.mark.parametrize("name", list(ALL))
def test_every_number_of_a_run_is_the_same(
    tmp_path: Path, drive_06: Drive, reference_run: Run, reference_without_times: Run, name: str
) -> None:
    """To the byte, whatever clock the recording has."""
    rows, trajectory = _run(tmp_path, drive_06, name)
    assert len(rows) == RUN_FRAMES + 1
    reference = reference_without_times if ALL[name].stamps == "none" else reference_run
    assert rows == reference[0]
    assert trajectory == reference[1]


def _measured(source: FrameSource) -> np.ndarray:
    """(N, 3) height [m], pitch, roll [deg]."""
    front_end = FrontEnd(source.camera, PipelineConfig())
    rows = []
    for i in range(len(source)):
        road = front_end.step(source[i]).road
        assert road is not None
        rows.append(
            (
                road.extrinsics.height_m,
                np.rad2deg(road.extrinsics.pitch_rad),
                np.rad2deg(road.extrinsics.roll_rad),
            )
        )
    return np.array(rows)


def test_unrectified_pairs_measure_as_rectified_ones(tmp_path: Path, drive_06: Drive) -> None:
    """A lens with k1, k2, p1, p2 and a right camera that is turned by 1.1 deg, in every dialect."""
    left, right, calibration = unrectified(drive_06)
    specs = {}
    for dialect, name in (
        ("yaml", "camera.yaml"),
        ("opencv", "stereo.xml"),
        ("ros", "calib"),
        ("kalibr", "chain.yaml"),
    ):
        place = tmp_path / dialect
        for side, pictures in (("left", left), ("right", right)):
            (place / side).mkdir(parents=True)
            for i, image in enumerate(pictures):
                assert cv2.imwrite(str(place / side / f"{i:04d}.png"), image)
        write_calibration(calibration, dialect, place / name)
        specs[dialect] = str(place)
    sources = {dialect: open_source(spec) for dialect, spec in specs.items()}
    for source in sources.values():
        assert any("rectified while reading" in note for note in source.notices)
        np.testing.assert_allclose(source.camera.focal_px, sources["yaml"].camera.focal_px, rtol=1e-9)
        for a, b in zip(
            (source[7].left, source[7].right),
            (sources["yaml"][7].left, sources["yaml"][7].right),
            strict=True,
        ):
            assert a is not None and b is not None
            assert np.abs(a.astype(int) - b).max() <= 1
    rectified = _measured(open_source(LAYOUTS["Plain folder"].write(tmp_path / "rectified", drive_06)))
    difference = np.abs(np.median(_measured(sources["ros"]) - rectified, axis=0))
    assert difference[0] < 0.005
    assert difference[1] < 0.03
    assert difference[2] < 0.03


def test_rectified_pictures_are_told_from_raw_ones(tmp_path: Path, drive_06: Drive) -> None:
    """The same camera_info in a bag: topics called image_rect are left as they are, image_raw are rectified."""
    pytest.importorskip("rosbags")
    short = dataclasses.replace(
        drive_06,
        **{key: getattr(drive_06, key)[:3] for key in ("left", "right", "stamps_ns", "poses", "scans")},
    )
    left, right, calibration = unrectified(short)
    for name, raw in (("raw", True), ("rect", False)):
        spec = bag_of(
            tmp_path / name, short, calibration, list(zip(left, right, strict=True)) if raw else None
        )
        source = open_source(spec)
        assert any("rectified while reading" in note for note in source.notices) is raw
        frame = source[1]
        assert frame.left is not None
        assert np.array_equal(frame.left, short.grey(1)[0]) is not raw
