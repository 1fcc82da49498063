"""The filter's experiment: its files, its figures against their definition, and what the U is for."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from stereocalib_core.experiments import filter as experiment
from stereocalib_core.geometry import Extrinsics
from stereocalib_core.results import FilteredExtrinsics, FrameResult, FrameTable, RoadEstimate

SMALL = "synthetic:plane?frames=8&width=320&height=120&focal_px=185&cx_px=157&cy_px=55"


def test_files_of_a_rendered_drive(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(experiment, "ROUGH_FRAMES", 60)
    monkeypatch.setattr(experiment, "SEEDS", 2)
    monkeypatch.setattr(experiment, "ROUGH_HEIGHTS", (0.004, 0.12))
    seen: list[tuple[int, int, str]] = []
    report = experiment.run(tmp_path, SMALL, lambda *step: seen.append(step))
    assert json.loads((tmp_path / "filter.json").read_text()) == report
    assert seen[-1][:2] == (16, 16)
    for method in experiment.METHODS:
        block = report[method]
        assert 7 <= block["n"] <= 8
        assert set(block) == {"n", "raw", "filtered", "smoothed", "linear"}
        assert block["filtered"]["ratio"]["pitch_deg"] == pytest.approx(
            block["filtered"]["rmse"]["pitch_deg"] / block["raw"]["rmse"]["pitch_deg"]
        )
    assert len(report["planes_of_known_noise"]) == 2
    text = (tmp_path / "filter.md").read_text()
    assert "smoothed" in text and f"{1e3 * report['direct']['raw']['rmse']['height_m']:.2f}" in text
    assert (tmp_path / "filter-figure.png").stat().st_size > 10_000


def test_a_drive_without_known_extrinsics_is_not_judged() -> None:
    text = experiment.markdown("somewhere", 5, {"paper": {"n": 0}, "direct": {"n": 0}})
    assert "not known" in text


def test_a_drive_without_a_road_is_not_judged() -> None:
    results = [FrameResult(i, 0.1 * i, None) for i in range(4)]
    nan = FilteredExtrinsics(np.full((4, 3), np.nan), np.full((4, 3, 3), np.nan), ("none",) * 4)
    block, scores = experiment.against(FrameTable.of(results, nan, nan), nan.values, np.ones((4, 3)))
    assert (block, scores) == ({"n": 0}, {})
    text = experiment.markdown("somewhere", 4, {"paper": block, "direct": block, "planes_of_known_noise": []})
    assert text.count("No frame showed its road") == 2


def test_the_verdict_names_every_axis_that_is_worse() -> None:
    sure = {"within_2_sigma": dict.fromkeys(experiment.AXES, 0.93)}
    for height, pitch, said in ((1.01, 1.02, "height and pitch worse"), (0.9, 0.9, "nothing worse")):
        ratio = dict(zip(experiment.AXES, (height, pitch, 0.8), strict=True))
        block = {"filtered": {"ratio": ratio, **sure}, "smoothed": sure}
        text = experiment.verdict("direct", block)
        assert said in text and f"{max(height, pitch):.2f}" in text and "93%" in text


def test_figures_are_their_definition() -> None:
    """Errors of one and of three sigma in turn; a frame without a measurement is nobody's."""
    truth = np.tile([1.65, 0.01, -0.01], (40, 1))
    sigma = np.array([0.01, 0.001, 0.002])
    off = np.where(np.arange(40)[:, None] % 4 == 0, 3.0, 0.5) * sigma
    covariance = np.diag(sigma**2)
    road = [RoadEstimate(Extrinsics(*row), covariance, 9, 0.5, (4.0, 20.0)) for row in truth + 2.0 * off]
    results = [FrameResult(i, 0.1 * i, None if i == 7 else r) for i, r in enumerate(road)]
    state = tuple("predicted" if i == 7 else "updated" for i in range(40))
    series = FilteredExtrinsics(truth + off, np.tile(covariance, (40, 1, 1)), state)
    block, scores = experiment.against(FrameTable.of(results, series, series), truth + 3.0 * off, truth)
    assert block["n"] == 39
    for axis in experiment.AXES:
        assert block["filtered"]["ratio"][axis] == pytest.approx(0.5)
        assert block["filtered"]["within_1_sigma"][axis] == pytest.approx(29 / 39)
        assert block["raw"]["within_2_sigma"][axis] == pytest.approx(29 / 39)
        assert block["linear"]["rmse"][axis] == pytest.approx(3.0 * block["filtered"]["rmse"][axis])
    assert block["linear"]["most_apart"]["height_m"] == pytest.approx(0.06)
    assert block["linear"]["frames_apart"] == 39
    np.testing.assert_allclose(np.abs(scores["smoothed"]).max(axis=0), 3.0)


def test_a_linear_filter_is_worse_where_planes_are_noisy_and_the_same_where_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from stereocalib_core.sources import open_source

    monkeypatch.setattr(experiment, "ROUGH_HEIGHTS", (0.004, 0.12))
    fine, rough = experiment.rough_planes(open_source("synthetic:town?frames=100"))
    assert fine["linear_over_ukf"] == pytest.approx(1.0, abs=0.02)
    assert rough["linear_over_ukf"] - 2.0 * rough["linear_over_ukf_sigma"] > 1.5
