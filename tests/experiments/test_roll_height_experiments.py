"""The experiments roll and height, shortened: files, keys, and figures that can fail."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from stereocalib_core.experiments import height, roll


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
