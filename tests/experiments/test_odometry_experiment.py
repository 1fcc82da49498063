"""Table 1's experiment writes its files and puts the variants in their places."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

from stereocalib_core.experiments import odometry
from stereocalib_core.results import OdometryErrors


def judge(out: Path, spec: str, frames: int) -> None:
    """Files, variants, and that each correction counts; short stretches with little roll."""
    seen: list[tuple[int, int]] = []
    result = odometry.run(out, spec, lambda done, total, what: seen.append((done, total)))
    assert seen[-1] == (frames, frames)
    assert json.loads((out / "odometry.json").read_text()) == result
    assert list(result) == ["planar", "default", "nonholonomic", "stereo_only"]
    assert all(set(result[model]) == set(odometry.LABELS) for model in odometry.MODELS)
    for model, limit_percent in (("planar", 1.2), ("default", 0.6)):
        error = {name: block["final_translation_percent"] for name, block in result[model].items()}
        assert error["autocalibrated"] < limit_percent
        assert error["autocalibrated"] == error["no_yaw"]
        assert error["no_pitch_no_roll"] > 4 * error["autocalibrated"]
    best = result["planar"]["autocalibrated"]
    text = (out / "odometry.md").read_text()
    assert "16.51" in text and f"{best['final_translation_m']:.2f}" in text
    assert (out / "odometry-figure-4.png").stat().st_size > 10_000
    assert (out / "odometry-figure-5.png").stat().st_size > 10_000


def test_table_and_figures_of_a_rendered_drive(tmp_path: Path) -> None:
    judge(tmp_path, "synthetic:town?frames=36", 36)


def test_table_and_figures_of_a_real_drive(kitti_06: Path, tmp_path: Path) -> None:
    judge(tmp_path, str(kitti_06), 51)
    # 60 m of a straight road with little roll: it hardly matters where disparities have their say
    planar = json.loads((tmp_path / "odometry.json").read_text())["planar"]
    error = {name: block["final_translation_percent"] for name, block in planar.items()}
    assert error["autocalibrated"] < error["no_roll"] < error["no_pitch_no_roll"]


def test_what_is_equal_is_no_order_and_beats_nothing() -> None:
    errors = {
        name: OdometryErrors(713.0, t_rel_percent=t_rel, final_rotation_deg=turn)
        for name, t_rel, turn in (
            ("autocalibrated", 0.5321, 0.2),
            ("no_yaw", 0.5319, 0.9),
            ("no_roll", 0.71, 0.2),
            ("no_pitch_no_roll", 1.8, 0.2),
        )
    }
    (said,) = odometry._verdict(errors, "planar")
    assert "no yaw 0.53 % = autocalibrated 0.53 % < no roll 0.71 % < no pitch, no roll 1.80 %" in said
    assert "beat" not in said
    errors["no_roll"] = dataclasses.replace(errors["no_roll"], t_rel_percent=0.4)
    (said,) = odometry._verdict(errors, "nonholonomic")
    assert "no roll beat the autocalibrated path" in said
    assert "heading 0.90 against 0.20 deg" in said
