"""The same pairs in every format: pixels, camera, times, truth and scans come out as they went in."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sources.laid_out import LAYOUTS, MORE, Drive, Layout, drive_of

from stereocalib_core.frames import FrameSource
from stereocalib_core.sources import open_source
from stereocalib_core.sources.lists import from_first

FRAMES = 30
ALL = {**LAYOUTS, **MORE}


@pytest.fixture(scope="module")
def drive_06(kitti_06: Path) -> Drive:
    return drive_of(open_source(str(kitti_06)), FRAMES)


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
    np.testing.assert_allclose(source.timestamps_s, wanted_s, rtol=0, atol=1e-6)
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
