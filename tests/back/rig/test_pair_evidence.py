"""Evidence for the pair's offset, and results with the pair mended."""

from __future__ import annotations

import numpy as np
import pytest
from test_relative_yaw import CAMERA, simulate

from stereocalib_core.back.rig.pair_evidence import near_and_far, results_mended, rows_over_picture
from stereocalib_core.back.rig.stereo_tracks import stereo_tracks
from stereocalib_core.back.rig.yaw_solution import solve_yaw
from stereocalib_core.config import PairConfig
from stereocalib_core.geometry import Extrinsics
from stereocalib_core.results import (
    FrameResult,
    Measured,
    Pair,
    PairCorrection,
    RoadEstimate,
    RoadResidual,
    Tracks,
)


def test_near_and_far_points_agree_at_the_true_offset_alone() -> None:
    drive = simulate(0.1, noise_px=0.05)
    solution = solve_yaw(drive.tracks, drive.motions, drive.active, (0.0, 0.0), PairConfig())
    assert solution is not None
    true_px = CAMERA.focal_px * np.deg2rad(0.1)
    shown = near_and_far(drive.tracks, solution, (0.0, 0.0), np.linspace(0.0, 2.5, 51), PairConfig())
    gap = shown.near - shown.far
    crossing = float(np.interp(0.0, *(a[np.argsort(gap)] for a in (gap, shown.offset_px))))
    assert crossing == pytest.approx(true_px, abs=0.08)
    assert abs(gap[0]) > 10 * abs(gap[np.argmin(np.abs(gap))])
    assert 5.0 < shown.split_m < 60.0


def test_rows_over_the_picture_are_the_model() -> None:
    pair = Pair(row_offset_px=Measured(-0.3, 0.01), relative_roll_rad=Measured(0.001, 1e-5), keystone_rad=0.0)
    field = rows_over_picture(CAMERA, pair)
    assert field.shape == (8, 24)
    assert field[4, 12] == pytest.approx(-0.3, abs=0.03)
    assert field[4, -1] - field[4, 0] == pytest.approx(0.001 * CAMERA.width * 23 / 24, abs=1e-6)


def test_mended_results_are_those_of_the_straight_pair() -> None:
    yaw = np.deg2rad(0.1)
    bent = simulate(0.1)
    points = (bent.tracks.rays[:6].T * CAMERA.focal_px + [CAMERA.cx_px, CAMERA.cy_px, 0.0] * 2).astype(
        np.float32
    )
    true = Extrinsics.from_degrees(1.65, 0.8, -0.4)
    plane = true.disparity_plane(CAMERA)
    read = type(plane)(plane.a, plane.b, plane.c_px - CAMERA.focal_px * yaw).extrinsics(CAMERA)
    assert np.rad2deg(read.pitch_rad - true.pitch_rad) == pytest.approx(
        -0.1 * 1.65 / CAMERA.baseline_m, abs=0.01
    )
    results = []
    for i in range(len(bent.tracks)):
        part = points[bent.tracks.start[i] : bent.tracks.start[i + 1]]
        tracks = Tracks(part, np.zeros(len(part), bool), i - 1) if len(part) else None
        road = RoadEstimate(read, np.eye(3), 100, 0.5, (4.0, 20.0))
        lidar = RoadResidual(
            np.array(
                [
                    true.height_m - read.height_m,
                    true.pitch_rad - read.pitch_rad,
                    true.roll_rad - read.roll_rad,
                ]
            ),
            np.eye(3),
            100,
        )
        results.append(FrameResult(i, 0.1 * i, road, tracks=tracks, lidar=lidar))
    fixed = results_mended(CAMERA, results, PairCorrection(yaw_rad=yaw))
    solution = solve_yaw(stereo_tracks(CAMERA, fixed), bent.motions, bent.active, (0.0, 0.0), PairConfig())
    assert solution is not None
    assert abs(np.rad2deg(solution.yaw_rad)) < 2e-4
    road = fixed[3].road
    assert road is not None
    assert road.extrinsics.pitch_rad == pytest.approx(true.pitch_rad, abs=1e-9)
    assert road.extrinsics.height_m == pytest.approx(1.65, abs=1e-9)
    # a LiDAR sees the road where it is
    assert fixed[3].lidar is not None and np.abs(fixed[3].lidar.values).max() < 1e-9
