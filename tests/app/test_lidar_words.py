"""What people read of a LiDAR against the camera: lines, table, and the picture before and after."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from stereocalib_app.drive.panels.lidar import AFTER, BEFORE, check_html, overlay
from stereocalib_app.words.lidar import lidar_lines

from stereocalib_core.geometry import StereoCamera
from stereocalib_core.results import LidarCheck, LidarPose, LidarShift, Residual, ScanSample

CAMERA = StereoCamera(200, 100, 100.0, 99.5, 49.5, 0.5)
T = np.array([[0.0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]])
FOUND = T.copy()
FOUND[0, 3] = 0.5
RESIDUAL = Residual(0.0, 0.1, 0.1, 0.1)


def some_check() -> LidarCheck:
    six = np.array([0.001, 0.0, 0.0, np.deg2rad(-0.5), 0.5, np.nan])
    sigma = np.array([0.004, 1e-3, 1e-3, np.deg2rad(0.04), 0.01, np.nan])
    return LidarCheck(
        RESIDUAL, RESIDUAL, RESIDUAL,
        (
            LidarShift(12, "x", 0.05, 0.008, "step", 20, "camera"),
            LidarShift(0, "yaw", np.deg2rad(-0.5), np.deg2rad(0.04), "offset", 29),
        ),
        30, "", None, RESIDUAL, RESIDUAL, None, "40 edges of 12 things leave z +-9.1 cm", None,
        LidarPose(T, FOUND, six, sigma, 0, 29),
    )  # fmt: skip


def test_lines_say_what_differs_what_slipped_and_what_is_lacking() -> None:
    lines = lidar_lines(some_check())
    assert lines[0] == "height  +0.1 +- 0.4 cm  as calibrated"
    assert lines[3] == "yaw     -0.500 +- 0.040 deg  looks further right"
    assert lines[4] == "x       +50.0 +- 1.0 cm  further right"
    assert lines[5] == "z       not measured"
    assert lines[6] == "the camera slipped by +5.0 +- 0.8 cm of x at frame 12, certain by 20"
    assert lines[7] == "calibration off by -0.500 +- 0.040 deg of yaw from the start"
    assert lines[8] == "not measured: z: 40 edges of 12 things leave z +-9.1 cm"


def test_the_table_says_the_same_and_nothing_in_it_is_markup() -> None:
    shown = check_html(some_check())
    assert "50.0 ± 1.0 cm" in shown and "not measured" in shown
    assert "<img" not in check_html(replace(some_check(), why="<img src=x>"))
    assert "no LiDAR" not in shown and "as soon as" in check_html(None)


def test_the_picture_has_every_edge_before_and_after() -> None:
    beams = np.array([[10.0, 1.0, 0.0, 1.0], [10.0, -3.0, 1.0, -1.0], [10.0, 40.0, 0.0, 1.0]])
    none = np.zeros((0, 5))
    sample = ScanSample.pack(T, beams, none, none[:, :3], none)
    pose = some_check().pose
    assert pose is not None
    picture = overlay(np.full((100, 200), 60, np.uint8), sample, pose, CAMERA)
    # 10 m ahead and 1 m left is at u = 99.5 - 10; half a metre to the right is 5 px
    for u, v, color in ((90, 50, BEFORE), (94, 50, AFTER), (130, 40, BEFORE), (134, 40, AFTER)):
        assert tuple(picture[v, u]) == color
    assert tuple(picture[5, 5]) == (30, 30, 30)
