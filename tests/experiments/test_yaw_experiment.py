"""The yaw experiment on a real drive: its files and that they say what they should."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from stereocalib_core.experiments import yaw


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
