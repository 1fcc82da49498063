"""The experiments roll and height, shortened: files, keys, and figures that can fail."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from stereocalib_core.config import PipelineConfig
from stereocalib_core.experiments import height, roll
from stereocalib_core.front.road import variants
from stereocalib_core.front.road.estimate import estimate_road
from stereocalib_core.geometry import Extrinsics
from stereocalib_core.simulator.plane import render_plane


def test_roll(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(roll, "FRAMES", 9)
    report = roll.run(tmp_path)
    assert json.loads((tmp_path / "roll.json").read_text()) == report
    for method in ("eq12", "labayrade", "direct", "eq12_corridor", "labayrade_corridor"):
        assert report[method]["n"] == report["pitch"][method]["n"] == report["height"][method]["n"] == 9
        assert report[method]["median_abs_deg"] < 0.03
        assert report[method]["std_deg"] < 0.1
    assert abs(report["pitch"]["direct"]["bias_deg"]) < 0.005
    assert abs(report["height"]["direct"]["bias_m"]) < 0.001
    assert "0.0276" in (tmp_path / "roll.md").read_text()
    assert (tmp_path / "roll-figure-2.png").stat().st_size > 10_000


def test_height(tmp_path: Path) -> None:
    report = height.run(tmp_path, "synthetic:straight?frames=8")
    for method in ("whole_map", "free_map", "free_map_filtered", "direct", "direct_filtered"):
        assert report[method]["median"] == pytest.approx(1.65, abs=0.05)
        assert np.isfinite(report[method]["std"])
    assert "0.0875" in (tmp_path / "height.md").read_text()
    assert (tmp_path / "height-figure-3.png").stat().st_size > 10_000


def test_the_methods_compared_are_not_one_another(monkeypatch: pytest.MonkeyPatch) -> None:
    """Labayrade knows no vote of eq. 12, and eq. 12 no projection; both find the roll of the same cells."""
    pose = Extrinsics.from_degrees(1.65, 0.8, 3.0)
    left, right = render_plane(roll.CAMERA, pose, seed=1, noise=1.5, exposure_difference=0.05)[:2]
    config = PipelineConfig()
    road = estimate_road(left, right, roll.CAMERA, config)
    assert road.drawable
    cells = road.disparity, road.free, roll.CAMERA, config

    def not_this(*_: object) -> None:
        raise AssertionError("the other method was asked")

    with monkeypatch.context() as without_vote:
        without_vote.setattr(variants, "fit_paper", not_this)
        projected = variants.fit_labayrade(*cells)
    with monkeypatch.context() as without_projections:
        without_projections.setattr(variants, "_spread", not_this)
        voted = variants.fit_cells(*cells)
    letter = variants.fit_to_the_letter(*cells)
    assert projected is not None and voted is not None and letter is not None
    assert projected.roll_deg == pytest.approx(3.0, abs=0.02)
    assert voted.extrinsics.roll_deg == pytest.approx(3.0, abs=0.02)
    assert letter.roll_deg == pytest.approx(3.0, abs=0.5)
