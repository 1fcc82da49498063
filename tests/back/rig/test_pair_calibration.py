"""The pair over a drive: verdict, knocks, what a bend does."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from test_relative_yaw import CAMERA, simulate

from stereocalib_core.back.odometry.packing import pack
from stereocalib_core.back.rig.pair import summarise
from stereocalib_core.back.rig.pair_calibration import bend_effects, calibrate_pair, yaw_mends
from stereocalib_core.config import PipelineConfig
from stereocalib_core.results import (
    DepthScale,
    FrameResult,
    Measured,
    Pair,
    PairCorrection,
    RectificationSample,
    Tracks,
)

CONFIG = PipelineConfig()


def _results(*yaws_deg: float, pairs: int = 30, noise_px: float = 0.1) -> list[FrameResult]:
    """A drive whose pair is bent by one yaw after another, its rows without fault."""
    straight = RectificationSample(np.zeros(3), np.diag([0.02, 3e-5, 5e-5]) ** 2, 80)
    found: list[FrameResult] = []
    for yaw in yaws_deg:
        part = simulate(yaw, pairs=pairs, noise_px=noise_px).tracks
        points = part.rays[:6].T * CAMERA.focal_px + [CAMERA.cx_px, CAMERA.cy_px, 0.0] * 2
        for i in range(len(part)):
            index, rows = len(found), points[part.start[i] : part.start[i + 1]].astype(np.float32)
            tracks = Tracks(rows, np.zeros(len(rows), bool), index - 1) if len(rows) else None
            found.append(FrameResult(index, 0.1 * index, None, None, rectification=straight, tracks=tracks))
    return found


def _pair(results: list[FrameResult]) -> Pair:
    rows = summarise(CAMERA, results, CONFIG.rectification)
    return calibrate_pair(CAMERA, results, pack(CAMERA, results), rows, None, 1.65, CONFIG)


@pytest.mark.parametrize(
    ("yaw_deg", "verdict"),
    [
        (0.0, "good"),
        (0.012, "good"),
        (0.0201, "suspect"),
        (0.03, "suspect"),
        (-0.05, "suspect"),
        (0.1, "bad"),
        (-0.2, "bad"),
    ],
)
def test_the_verdict_follows_the_yaw(yaw_deg: float, verdict: str) -> None:
    pair = _pair(_results(yaw_deg))
    assert pair.verdict == verdict
    assert pair.relative_yaw_rad is not None
    assert np.rad2deg(pair.relative_yaw_rad.value) == pytest.approx(yaw_deg, abs=0.003)
    assert pair.rows_verdict == "good"


def test_a_pair_that_could_not_be_measured_is_never_good() -> None:
    standing = [dataclasses.replace(r, tracks=None) for r in _results(0.1)]
    pair = _pair(standing)
    assert pair.verdict == "not measured"
    assert pair.relative_yaw_rad is None
    assert "moves" in pair.why
    assert pair.correction is None


def test_a_knock_of_one_camera_is_found_with_its_frame_and_size() -> None:
    pair = _pair(_results(0.0, 0.1))
    assert [(change.frame, change.axis) for change in pair.changes] == [(31, "yaw")]
    assert np.rad2deg(pair.changes[0].size_rad) == pytest.approx(0.1, abs=0.004)
    assert pair.relative_yaw_rad is not None
    assert np.rad2deg(pair.relative_yaw_rad.value) == pytest.approx(0.1, abs=0.004)
    assert pair.verdict == "bad"


def _judged(yaw_deg: float, scale: DepthScale | None = None, sigma_deg: float = 0.002) -> Pair:
    yaw = Measured(np.deg2rad(yaw_deg), np.deg2rad(sigma_deg))
    zero = Measured(0.0, 1e-5)
    pair = Pair("suspect", "", zero, Measured(1e-4, 1e-5), zero, yaw, depth_scale=scale, rows_verdict="good")
    return dataclasses.replace(pair, yaw_mends=yaw_mends(CAMERA, pair, CONFIG))


def test_a_yaw_that_a_scale_of_depth_may_undo_is_told_and_not_mended() -> None:
    # 1 % of depth at 15 m, twice: 0.04 deg with the baseline of 0.54 m
    assert CAMERA.baseline_m == pytest.approx(0.54, abs=0.01)
    assert _judged(0.025).correction == PairCorrection()
    large = _judged(-0.06).correction
    assert large is not None and large.yaw_rad == np.deg2rad(-0.06) and large.pitch_rad == 1e-4
    by_truth = _judged(0.025, DepthScale(1.01, 0.001, "truth")).correction
    assert by_truth == PairCorrection()
    by_lidar = _judged(0.025, DepthScale(1.01, 0.003, "lidar")).correction
    assert by_lidar is not None and by_lidar.yaw_rad == np.deg2rad(0.025) and by_lidar.depth_scale == 1.01
    unsure = _judged(0.003, DepthScale(1.004, 0.003, "lidar")).correction
    assert unsure == PairCorrection()
    # a shorter baseline shows less yaw by the same share of depth
    short = dataclasses.replace(CAMERA, baseline_m=0.2)
    assert yaw_mends(short, _judged(0.025), CONFIG)
    rows = dataclasses.replace(_judged(0.0), rows_verdict="bad").correction
    assert rows is not None and rows.pitch_rad == 1e-4 and rows.yaw_rad == 0.0


def test_a_small_yaw_is_said_to_be_left_as_it_is() -> None:
    told = _pair(_results(0.03))
    assert told.verdict == "suspect" and not told.yaw_mends and "told, not mended" in told.why
    assert "told, not mended" not in _pair(_results(0.1)).why


def test_what_a_bend_does_is_what_the_equations_say() -> None:
    yaw = np.deg2rad(0.1)
    effects = bend_effects(CAMERA, Pair(relative_yaw_rad=Measured(yaw, 0.0)), 1.65)
    assert effects is not None
    fb = CAMERA.focal_px * CAMERA.baseline_m
    read = fb / (fb / 30.0 - CAMERA.focal_px * yaw)
    assert effects.depth_share == pytest.approx(read / 30.0 - 1.0)
    assert effects.pitch_rad == pytest.approx(-yaw * 1.65 / CAMERA.baseline_m)
    assert effects.height_share == 0.0
