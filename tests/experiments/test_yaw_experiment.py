"""The yaw experiment on a real drive: its files and that they say what they should."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from stereocalib_core.experiments import yaw


def test_a_rendered_drive_gives_the_yaw_that_it_was_made_with(tmp_path: Path) -> None:
    entries = yaw.run(tmp_path, "synthetic:straight?frames=30&mount_yaw_deg=0.5")
    assert json.loads((tmp_path / "yaw.json").read_text()) == entries
    assert entries[0]["true_deg"] == pytest.approx(0.5, abs=1e-6)
    assert 0.0 < entries[0]["sigma_deg"] < 0.05
    assert entries[0]["estimate_deg"] == pytest.approx(0.5, abs=min(3 * entries[0]["sigma_deg"], 0.06))
    assert (tmp_path / "yaw-figure-1c.png").stat().st_size > 50_000
    assert f"{entries[0]['estimate_deg']:.4f}" in (tmp_path / "yaw.md").read_text()


def test_a_real_drive_gives_the_yaw_of_its_car(kitti_06: Path, tmp_path: Path) -> None:
    seen: list[tuple[int, int, str]] = []
    entries = yaw.run(tmp_path, str(kitti_06), lambda *step: seen.append(step))
    assert json.loads((tmp_path / "yaw.json").read_text()) == entries
    assert len(entries) == 1
    assert entries[0]["true_deg"] is None
    assert entries[0]["estimate_deg"] == pytest.approx(-0.28, abs=0.08)
    assert 0.0 < entries[0]["sigma_deg"] < 0.05
    assert (tmp_path / "yaw-figure-1c.png").stat().st_size > 50_000
    assert "-0.3 deg" in (tmp_path / "yaw.md").read_text()
    assert seen[-1][0] == seen[-1][1]
