"""Real recordings: how many frames show their road, and how steady the height is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stereocalib_core.back.analyse import analyse
from stereocalib_core.config import PipelineConfig
from stereocalib_core.front.pipeline import FrontEnd
from stereocalib_core.front.road.estimate import RoadResult, estimate_road
from stereocalib_core.front.road.variants import fit_whole_map
from stereocalib_core.results import FrameTable
from stereocalib_core.results.own_car import OWN_CAR
from stereocalib_core.sources import open_source


def _heights(results: list[RoadResult]) -> np.ndarray:
    return np.array([r.estimate.extrinsics.height_m for r in results if r.estimate is not None])


def _run(folder: Path, method: str, every: int = 1) -> tuple[list[RoadResult], np.ndarray]:
    source = open_source(str(folder))
    config = PipelineConfig(method=method)  # type: ignore[arg-type]
    results, whole = [], []
    for i in range(0, len(source), every):
        frame = source[i]
        assert frame.left is not None and frame.right is not None
        road = estimate_road(frame.left, frame.right, source.camera, config)
        results.append(road)
        if method == "paper" and road.matched is not None:
            fit = fit_whole_map(road.disparity, source.camera, config)
            whole.append(np.nan if fit is None else fit.height_m)
    return results, np.array(whole)


def test_06_paper(kitti_06: Path) -> None:
    results, whole = _run(kitti_06, "paper")
    heights = _heights(results)
    assert len(heights) >= 50
    assert 1.58 <= np.median(heights) <= 1.72
    assert heights.std() <= 0.05
    assert np.nanstd(whole) > 1.2 * heights.std(), "the free map is what makes the height steady"


def test_06_direct(kitti_06: Path) -> None:
    heights = _heights(_run(kitti_06, "direct")[0])
    assert len(heights) >= 50
    assert heights.std() <= 0.022


def test_raw_0009(kitti_raw_0009: Path) -> None:
    results, whole = _run(kitti_raw_0009, "paper")
    assert np.nanstd(whole) > 1.5 * _heights(results).std()
    assert _heights(_run(kitti_raw_0009, "direct")[0]).std() <= 0.035


def _drive(folder: Path, method: str) -> FrameTable:
    """The drive's frames as they are told: each with what those before and around it say of it."""
    source = open_source(str(folder))
    config = PipelineConfig(method=method)  # type: ignore[arg-type]
    front_end = FrontEnd(source.camera, config, T_camera_lidar=source.T_camera_lidar)
    results = [front_end.step(source[i]) for i in range(len(source))]
    own = [check for result in results for check in result.checks if (check.stage, check.name) == OWN_CAR]
    assert not own, "these cars' bonnets are below their pictures"
    frames = analyse(results, source.camera, config).frames
    off = np.abs(frames.values - frames.smoothed)
    far = (off > [0.15, *np.deg2rad([1.5, 1.5])]) & (off > 4.0 * frames.sigma)
    assert not far[frames.ok].any(), "no frame is sure of a rig that the drive does not have"
    return frames


@pytest.mark.parametrize("method", ["paper", "direct"])
def test_03_where_grass_and_walls_look_like_road(kitti_03: Path, method: str) -> None:
    frames = _drive(kitti_03, method)
    heights = frames.height_m[frames.ok]
    assert len(heights) >= (0.97 if method == "direct" else 0.85) * len(frames.ok)
    assert np.abs(heights - np.median(heights)).max() <= 0.12


def test_a_narrow_snowy_street_with_a_yawed_camera(karlsruhe: Path) -> None:
    frames = _drive(karlsruhe, "direct")
    heights = frames.height_m[frames.ok]
    assert len(heights) >= 48
    assert np.abs(heights - np.median(heights)).max() <= 0.12


def test_a_corner_past_kerbs_behind_a_cyclist(kitti_raw_0005: Path) -> None:
    assert np.count_nonzero(_drive(kitti_raw_0005, "direct").ok) >= 17
