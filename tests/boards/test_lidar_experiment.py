"""The paper's simulation in small: fewer repeats, the same bounds with room for chance."""

from __future__ import annotations

import importlib
import inspect
import json
from pathlib import Path

import numpy as np
import pytest
from stereocalib_app.cli.arguments import EXPERIMENTS

from stereocalib_core.errors import ConfigError
from stereocalib_core.experiments import lidar_camera
from stereocalib_core.experiments.lidar_camera_report import PAPER

COUNTS = (5, 8, 11)


def test_reduced_simulation_against_the_paper(tmp_path: Path) -> None:
    stages: list[tuple[int, int, str]] = []
    # The first three as the command gives them.
    result = lidar_camera.run(tmp_path, None, lambda *a: stages.append(a), 50, workers=1, counts=COUNTS)
    assert stages[-1][0] == stages[-1][1]
    paper = np.array([PAPER["dual_space"]["mean"][c - 5] for c in COUNTS])
    mean = {s: np.array(result[s]["mean"]) for s in lidar_camera.SOLVERS}
    assert 0.6 < mean["dual_space"].sum() / paper.sum() < 1.3
    assert np.all(mean["weighted"] < mean["dual_space"])
    assert np.all(mean["weighted"] < paper)
    assert np.all(mean["refined"] < 0.55 * paper)
    assert np.all(mean["points_on_plane"][:2] > 2 * mean["dual_space"][:2])
    np.testing.assert_allclose(mean["unnikrishnan_hebert"], mean["dual_space"], rtol=0.12)
    for block in result["sigma_at_11"].values():
        ratio = np.array(block["predicted"]) / np.array(block["observed"])
        assert 0.65 < ratio.min() <= ratio.max() < 1.5
    written = json.loads((tmp_path / "lidar-camera.json").read_text())
    assert written["counts"] == list(COUNTS)
    assert set(written["at_11"]["refined"]) == {"translation_m", "rotation", "matrix"}
    assert {p.name for p in tmp_path.glob("*.png")} == {f"lidar-camera-figure-{n}.png" for n in (3, 4, 5, 6)}
    assert "Table 2" in (tmp_path / "lidar-camera.md").read_text()


def test_a_source_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="takes no source"):
        lidar_camera.run(tmp_path, "synthetic:town")


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_every_experiment_can_be_called_by_the_command(name: str) -> None:
    module = importlib.import_module(f"stereocalib_core.experiments.{name.replace('-', '_')}")
    parameters = list(inspect.signature(module.run).parameters.values())
    assert [p.name for p in parameters[:3]] == ["out", "source", "progress"]
    assert all(p.default is not inspect.Parameter.empty for p in parameters[1:])


def test_the_same_trial_gives_the_same_numbers() -> None:
    first, again = lidar_camera.trials((6, 3, 2)), lidar_camera.trials((6, 3, 2))
    for name in first:
        np.testing.assert_array_equal(first[name], again[name])
