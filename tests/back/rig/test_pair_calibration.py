"""The pair over a drive: verdict, knocks, what a bend does."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from test_relative_yaw import CAMERA, simulate

from stereocalib_core.back.odometry.packing import pack
from stereocalib_core.back.rig.pair import summarise
from stereocalib_core.back.rig.pair_calibration import bend_effects, calibrate_pair
from stereocalib_core.config import PipelineConfig
from stereocalib_core.results import FrameResult, Measured, Pair, RectificationSample, Tracks

CONFIG = PipelineConfig()


def _results(*yaws_deg: float, pairs: int = 30, noise_px: float = 0.1) -> list[FrameResult]:
    """A drive whose pair is bent by one yaw after another, its rows without fault."""
    straight = RectificationSample(np.zeros(3), np.diag([0.02, 3e-5, 5e-5]) ** 2, 80)
    found: list[FrameResult] = []
    for yaw in yaws_deg:
        part = simulate(yaw, pairs=pairs, noise_px=noise_px).tracks
        points = part.rays.T * CAMERA.focal_px + [CAMERA.cx_px, CAMERA.cy_px, 0.0] * 2
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
    [(0.0, "good"), (0.012, "good"), (0.03, "suspect"), (-0.05, "suspect"), (0.1, "bad"), (-0.2, "bad")],
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


def test_what_a_bend_does_is_what_the_equations_say() -> None:
    yaw = np.deg2rad(0.1)
    effects = bend_effects(CAMERA, Pair(relative_yaw_rad=Measured(yaw, 0.0)), 1.65)
    assert effects is not None
    fb = CAMERA.focal_px * CAMERA.baseline_m
    read = fb / (fb / 30.0 - CAMERA.focal_px * yaw)
    assert effects.depth_share == pytest.approx(read / 30.0 - 1.0)
    assert effects.pitch_rad == pytest.approx(-yaw * 1.65 / CAMERA.baseline_m)
    assert effects.height_share == 0.0
