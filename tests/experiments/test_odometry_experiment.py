"""Table 1's experiment writes its files and puts the variants in their places."""

from __future__ import annotations

import json
from pathlib import Path

from stereocalib_core.experiments import odometry


def test_table_and_figures_of_a_real_drive(kitti_06: Path, tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []
    result = odometry.run(tmp_path, str(kitti_06), lambda done, total, what: seen.append((done, total)))
    assert seen[-1] == (51, 51)
    assert json.loads((tmp_path / "odometry.json").read_text()) == result
    assert set(result) == {name + suffix for name in odometry.LABELS for suffix in odometry.MODELS}
    best, worst = result["autocalibrated"], result["no_pitch_no_roll"]
    assert best["final_translation_percent"] < 1.06
    assert worst["final_translation_percent"] > 4 * best["final_translation_percent"]
    text = (tmp_path / "odometry.md").read_text()
    assert "16.51" in text and f"{best['final_translation_m']:.2f}" in text
    assert (tmp_path / "odometry-figure-4.png").stat().st_size > 10_000
    assert (tmp_path / "odometry-figure-5.png").stat().st_size > 10_000
