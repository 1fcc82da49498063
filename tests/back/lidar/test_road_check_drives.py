"""The LiDAR's road against the stereo road on a real drive and on the synthetic one."""

from __future__ import annotations

import dataclasses
import time
from pathlib import Path

import numpy as np
import pytest
from simulated_scan import turned

from stereocalib_core.back.lidar.road_check import check
from stereocalib_core.config import PipelineConfig, RoadCheckConfig
from stereocalib_core.front.scan.lidar_road import scan_residual

CONFIG = RoadCheckConfig()
DEGREE = float(np.rad2deg(1.0))


# ---- a real drive ---------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def real_drive(kitti_raw_0009: Path):  # type: ignore[no-untyped-def]
    """Frames with scans, their results and road surfaces, and the calibration."""
    from stereocalib_core.front.pipeline import FrontEnd
    from stereocalib_core.front.scan.road_surface import RoadSurface
    from stereocalib_core.sources import open_source

    source, config = open_source(str(kitti_raw_0009)), PipelineConfig()
    front_end = FrontEnd(source.camera, config, T_camera_lidar=source.T_camera_lidar)
    frames = [source[i] for i in range(12)]
    looks = [front_end.look(frame) for frame in frames]
    surfaces = [RoadSurface.of(look.road, source.camera, config.direct) for look in looks]
    return frames, [look.result for look in looks], source.T_camera_lidar, surfaces


def again(real, T):  # type: ignore[no-untyped-def]
    """The drive's check with another calibration."""
    frames, results, _, surfaces = real
    seen = [
        dataclasses.replace(r, lidar=scan_residual(f, r, T, CONFIG, surface))
        for f, r, surface in zip(frames, results, surfaces, strict=True)
    ]
    return check(seen, CONFIG)


def medians(found) -> np.ndarray:  # type: ignore[no-untyped-def]
    return np.array([axis.median for axis in (found.height_m, found.pitch_rad, found.roll_rad)])


def test_real_drive_agrees_with_its_calibration(real_drive) -> None:  # type: ignore[no-untyped-def]
    found = check(real_drive[1], CONFIG)
    assert found is not None and found.frames == 12 and found.shifts == ()
    scatter = [axis.scatter for axis in (found.height_m, found.pitch_rad, found.roll_rad)]
    assert np.all(np.abs(medians(found)) < [0.04, np.deg2rad(0.25), np.deg2rad(0.5)])
    assert np.all(np.array(scatter) < [0.012, np.deg2rad(0.08), np.deg2rad(0.2)])


@pytest.mark.parametrize(("axis", "name"), [(1, "pitch"), (2, "roll")])
@pytest.mark.parametrize("degrees", [1.0, -1.0])
def test_real_lidar_turned_in_software(real_drive, axis: int, name: str, degrees: float) -> None:  # type: ignore[no-untyped-def]
    before = check(real_drive[1], CONFIG)
    after = again(real_drive, turned(real_drive[2], **{f"{name}_deg": degrees}))
    moved = (medians(after) - medians(before)) * DEGREE
    assert moved[axis] == pytest.approx(degrees, abs=0.1)
    assert abs(moved[3 - axis]) < 0.1
    assert [(s.axis, s.kind) for s in after.shifts] == [(name, "offset")]


def test_report_of_a_drive_and_a_resumed_run_carry_the_check(
    real_drive, kitti_raw_0009: Path, tmp_path: Path
) -> None:  # type: ignore[no-untyped-def]
    from stereocalib_core.back.analyse import analyse
    from stereocalib_core.files.frame_record import Done
    from stereocalib_core.files.frames_bin import Checkpoint, RunKey, read_checkpoint
    from stereocalib_core.results import FrontEndMemory
    from stereocalib_core.sources import open_source

    source, results = open_source(str(kitti_raw_0009)), real_drive[1]
    key = RunKey(source.content_key, source.camera, PipelineConfig())
    checkpoint = Checkpoint(tmp_path / "checkpoint.bin", key)
    for result in results:
        checkpoint.append(Done(result, FrontEndMemory(None, None), 1.0))
    checkpoint.close()
    again_read = [done.result for done in read_checkpoint(tmp_path / "checkpoint.bin", key)[0]]
    for before, after in zip(results, again_read, strict=True):
        assert before.lidar is not None and after.lidar is not None
        assert before.lidar.values.tobytes() == after.lidar.values.tobytes()
        assert before.lidar.covariance.tobytes() == after.lidar.covariance.tobytes()
    told = analyse(again_read, open_source(str(kitti_raw_0009)).camera, PipelineConfig()).lidar
    found = check(results, CONFIG)
    assert found is not None and told is not None
    for axis in ("height_m", "pitch_rad", "roll_rad", "frames"):
        assert getattr(told, axis) == getattr(found, axis)
    assert told.yaw_rad is not None and told.pose is not None and told.why is None
    by_edges = [dataclasses.replace(result, lidar=None) for result in results]
    alone = analyse(by_edges, open_source(str(kitti_raw_0009)).camera, PipelineConfig()).lidar
    assert alone is not None and alone.height_m is None and alone.yaw_rad is not None
    without = [dataclasses.replace(result, lidar=None, scan=None) for result in results]
    assert analyse(without, open_source(str(kitti_raw_0009)).camera, PipelineConfig()).lidar is None


def test_a_scan_takes_little_time(real_drive) -> None:  # type: ignore[no-untyped-def]
    frames, results, T, surfaces = real_drive
    times = []
    for _ in range(20):
        began = time.thread_time()
        scan_residual(frames[0], results[0], T, CONFIG, surfaces[0])
        times.append(time.thread_time() - began)
    # 1.7 ms on the reference machine; five times that, since others may be at work on it
    assert min(times) < 0.0085


# ---- the synthetic drive --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("fault", "pitch", "roll"), [("", 0.0, 0.0), ("&fault=lidar_knock:roll=0.5@0", 0.0, 0.5)]
)
def test_synthetic_lidar_agrees_until_it_is_knocked(fault: str, pitch: float, roll: float) -> None:
    from stereocalib_core.front.pipeline import FrontEnd
    from stereocalib_core.sources import open_source

    source = open_source(f"synthetic:straight?lidar=1&frames=3{fault}")
    front_end = FrontEnd(source.camera, PipelineConfig(), T_camera_lidar=source.T_camera_lidar)
    residuals = [front_end.step(source[i]).lidar for i in range(3)]
    values = np.median([r.values for r in residuals if r is not None], axis=0)
    np.testing.assert_allclose(np.abs(values[1:]) * DEGREE, [pitch, roll], atol=0.05)
    assert abs(values[0]) < 0.01
