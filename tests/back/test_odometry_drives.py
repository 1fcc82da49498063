"""The odometry on whole drives through the front end: a recording where it is at hand, a rendered one always."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stereocalib_core as sc
from stereocalib_core.back.analyse import Workings, analyse_openly
from stereocalib_core.back.evaluation import evaluate
from stereocalib_core.back.odometry.trajectory import TrajectorySettings, trajectory
from stereocalib_core.config import PipelineConfig
from stereocalib_core.experiments.filter import against
from stereocalib_core.front.pipeline import FrontEnd
from stereocalib_core.results import Drive
from stereocalib_core.sources import open_source

FRAMES = 45
RENDERED = f"synthetic:town?frames={FRAMES}"


def followed(spec: str, config: PipelineConfig | None = None) -> tuple[Drive, Workings, np.ndarray]:
    """A drive, its workings and its true poses."""
    source, config = open_source(spec), config or PipelineConfig()
    front_end = FrontEnd(source.camera, config)
    results = [front_end.step(source[i]) for i in range(min(FRAMES, len(source)))]
    drive, workings = analyse_openly(results, source.camera, config, source.ground_truth)
    assert source.ground_truth is not None and source.ground_truth.poses is not None
    return drive, workings, source.ground_truth.poses[: len(results)]


@pytest.fixture(scope="module")
def rendered() -> tuple[Drive, Workings, np.ndarray]:
    return followed(RENDERED)


def judge(found: tuple[Drive, Workings, np.ndarray], limit_percent: float) -> None:
    """The best path is good, and it is the road's extrinsics that make it so."""
    drive, workings, truth = found
    for suffix, most in (("", limit_percent), ("_planar", 2.0 * limit_percent)):
        error = {
            name: drive.paths[name + suffix].errors.final_translation_percent
            for name in ("autocalibrated", "no_pitch_no_roll")
        }
        assert error["autocalibrated"] is not None and error["no_pitch_no_roll"] is not None
        assert error["autocalibrated"] < most
        assert error["no_pitch_no_roll"] > 3 * error["autocalibrated"]
    best = drive.paths["autocalibrated"].errors.final_translation_percent
    tripled = trajectory(
        workings.tracks,
        workings.extrinsics * [1.0, 3.0, 3.0, 1.0],
        TrajectorySettings(),
        drive.frames.smoothed_sigma,
    )
    worse = evaluate(tripled.poses, truth).final_translation_percent
    assert worse is not None and best is not None and worse > 3 * best


def test_rendered_drive(rendered: tuple[Drive, Workings, np.ndarray]) -> None:
    judge(rendered, 0.6)


def filtered_against_the_truth(drive: Drive) -> dict[str, Any]:
    """The block of `experiments filter` of one method, on the rendered drive."""
    truth = open_source(RENDERED).ground_truth
    assert truth is not None and truth.extrinsics is not None
    return against(drive.frames, drive.frames.filtered, truth.extrinsics[:FRAMES, :3])[0]


def test_the_filter_gains_most_on_rough_looks_and_loses_nothing_on_fine_ones(
    rendered: tuple[Drive, Workings, np.ndarray],
) -> None:
    """As shipped; the whole town is judged by `experiments filter`, and this is its first street."""
    paper = followed(RENDERED, PipelineConfig(method="paper"))[0]
    for drive, limits in ((paper, (0.45, 0.7, 0.7)), (rendered[0], (1.0, 1.0, 1.0))):
        block = filtered_against_the_truth(drive)
        for series in ("filtered", "smoothed"):
            ratio, twice = (list(block[series][key].values()) for key in ("ratio", "within_2_sigma"))
            assert (np.array(ratio) <= limits).all(), (drive.method, series, ratio)
            assert min(twice) > 0.8, (drive.method, series, twice)


def test_kitti_06(kitti_06: Path) -> None:
    judge(followed(str(kitti_06)), 0.6)


def test_rendered_yaw(rendered: tuple[Drive, Workings, np.ndarray]) -> None:
    """The mounting yaw of the rendered car is -0.3 deg; with a straight it is found, without one it is said."""
    drive, *_ = rendered
    if drive.mount.yaw_rad is None:
        assert drive.yaw_reason is not None and "straight" in drive.yaw_reason
    else:
        assert abs(np.rad2deg(drive.mount.yaw_rad.value) + 0.3) < 3 * np.rad2deg(drive.mount.yaw_rad.sigma)


def test_behind_a_truck_there_is_no_road_and_no_figure() -> None:
    """A truck fills the view from the first frame on: the whole way is a gap, and nothing is claimed of it."""
    drive = sc.calibrate("synthetic:town?frames=10&fault=truck@0-9")
    assert drive.frames_ok == 0
    assert drive.gaps == ((0, 9),)
    for name in drive.paths:
        if name != "stereo_only":
            errors = drive.paths[name].errors
            assert errors.path_m is None and errors.final_translation_percent is None, name
