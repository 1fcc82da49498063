"""Figures against truth: analytic cases, a plain re-implementation of KITTI's, and evo."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stereocalib_core.back import evaluation
from stereocalib_core.back.evaluation import absolute_error, evaluate, kitti_relative_errors, relative_error
from stereocalib_core.errors import ConfigError
from stereocalib_core.geometry import planar_motion, rotation_x, rotation_y, transform


def straight(count: int, step_m: float = 1.0) -> np.ndarray:
    return np.array([planar_motion(0.0, step_m * i, 0.0) for i in range(count)])


def curved(count: int, seed: int = 0, scale: float = 1.0, bend: float = 0.0) -> np.ndarray:
    """A path in 3-D with bends, hills and a little of everything."""
    rng = np.random.default_rng(seed)
    poses = [np.eye(4)]
    for i in range(count - 1):
        heading = 0.01 * np.sin(i / 40) + bend
        R = rotation_y(heading) @ rotation_x(0.001 * np.cos(i / 25))
        poses.append(poses[-1] @ transform(R, scale * np.array([*rng.normal(0, 0.01, 2), 1.0])))
    return np.array(poses)


def kitti_by_hand(est: np.ndarray, gt: np.ndarray) -> tuple[float, float]:
    """The benchmark's definition, written out: one loop, no shared code."""
    dist = [0.0]
    for a, b in zip(gt[:-1], gt[1:], strict=True):
        dist.append(dist[-1] + float(np.sqrt(((b[:3, 3] - a[:3, 3]) ** 2).sum())))
    t_errors, r_errors = [], []
    for first in range(0, len(gt), 10):
        for length in (100, 200, 300, 400, 500, 600, 700, 800):
            last = next((j for j in range(first, len(gt)) if dist[j] > dist[first] + length), None)
            if last is None:
                continue
            delta_gt = np.linalg.inv(gt[first]) @ gt[last]
            delta = np.linalg.inv(est[first]) @ est[last]
            error = np.linalg.inv(delta) @ delta_gt
            cosine = min(max(0.5 * (np.trace(error[:3, :3]) - 1.0), -1.0), 1.0)
            r_errors.append(np.arccos(cosine) / length)
            t_errors.append(np.linalg.norm(error[:3, 3]) / length)
    return 100.0 * float(np.mean(t_errors)), float(np.mean(r_errors))


def test_the_truth_itself_has_no_error() -> None:
    gt = curved(300)
    e = evaluate(gt, gt)
    assert e.path_m == pytest.approx(e.path_gt_m)
    assert e.final_translation_m == pytest.approx(0, abs=1e-9)
    assert e.final_rotation_deg == pytest.approx(0, abs=1e-9)
    assert e.t_rel_percent == pytest.approx(0, abs=1e-9)
    assert e.r_rel_deg_per_m == pytest.approx(0, abs=1e-7)


def test_two_percent_too_long_is_two_percent() -> None:
    e = evaluate(straight(301, 1.02), straight(301))
    assert e.path_m == pytest.approx(306)
    assert e.path_gt_m == pytest.approx(300)
    assert e.final_translation_m == pytest.approx(6)
    assert e.final_translation_percent == pytest.approx(2)
    # a segment runs to the first frame beyond its length, 101 m for 100 m, and is divided by the nominal length
    assert e.t_rel_percent == pytest.approx(2.0, rel=0.011)


def test_final_translation_ignores_height_and_final_rotation_is_heading() -> None:
    gt = straight(201)
    est = gt.copy()
    est[-1, 1, 3] += 5.0
    est[-1] = est[-1] @ transform(rotation_y(np.deg2rad(3.0)) @ rotation_x(np.deg2rad(20.0)), [0, 0, 0])
    e = evaluate(est, gt)
    assert e.final_translation_m == pytest.approx(0, abs=1e-9)
    assert e.final_rotation_deg == pytest.approx(3.0, abs=0.02)
    assert e.final_rotation_deg_per_m == pytest.approx(3.0 / 200, abs=2e-4)


def test_both_paths_start_from_their_own_first_camera() -> None:
    gt = curved(250)
    elsewhere = transform(rotation_y(1.0), [10.0, -3.0, 40.0])
    e = evaluate(elsewhere @ gt, gt)
    assert e.final_translation_m == pytest.approx(0, abs=1e-9)


def test_short_paths_have_no_relative_error_and_a_longer_truth_is_cut() -> None:
    e = evaluate(straight(51), straight(1000))
    assert e.t_rel_percent is None and e.r_rel_deg_per_m is None
    assert e.path_gt_m == pytest.approx(50)


def test_without_truth_and_without_reliable_heading() -> None:
    assert evaluate(straight(11), None).path_m == pytest.approx(10)
    assert evaluate(straight(11), None).path_gt_m is None
    e = evaluate(straight(201), straight(201), heading_reliable=False)
    assert e.path_gt_m == pytest.approx(200) and e.final_translation_m is None and e.t_rel_percent is None


def test_unknown_true_poses_are_left_out() -> None:
    gt = straight(151)
    gt[:5] = np.nan
    gt[140:] = np.nan
    e = evaluate(straight(151), gt)
    assert e.path_gt_m == pytest.approx(134)
    with pytest.raises(ConfigError):
        evaluate(straight(151), np.full_like(gt, np.nan))


@pytest.mark.parametrize("seed", [0, 1])
def test_kitti_figures_match_the_definition_written_out(seed: int) -> None:
    gt, est = curved(950, seed), curved(950, seed + 10, scale=1.01, bend=2e-5)
    ours = kitti_relative_errors(est, gt)
    assert ours is not None
    assert ours == pytest.approx(kitti_by_hand(est, gt), rel=1e-6)


def test_kitti_figures_of_a_real_path(data_dir: Path) -> None:
    rows = np.loadtxt(data_dir / "kitti_odometry" / "poses" / "07.txt").reshape(-1, 3, 4)
    gt = np.tile(np.eye(4), (len(rows), 1, 1))
    gt[:, :3] = rows
    drift = np.array([transform(rotation_y(1e-5 * i), [0.0, 0.0, 0.0]) for i in range(len(gt))])
    est = gt @ drift
    ours = kitti_relative_errors(est, gt)
    assert ours is not None
    # the written KITTI poses are rounded to seven digits, which is all an arc cosine can see of a tiny rotation
    assert ours == pytest.approx(kitti_by_hand(est, gt), rel=1e-3)


def test_ape_and_rpe_agree_with_evo() -> None:
    metrics = pytest.importorskip("evo.core.metrics")
    trajectory = pytest.importorskip("evo.core.trajectory")
    gt, est = curved(200), curved(200, 5, scale=1.03, bend=1e-4)

    def evo_ape(correct_scale: bool) -> float:
        a = trajectory.PosePath3D(poses_se3=list(est.copy()))
        a.align(trajectory.PosePath3D(poses_se3=list(gt)), correct_scale=correct_scale)
        ape = metrics.APE(metrics.PoseRelation.translation_part)
        ape.process_data((trajectory.PosePath3D(poses_se3=list(gt)), a))
        return float(ape.get_statistic(metrics.StatisticsType.rmse))

    assert absolute_error(est, gt, "se3").rmse == pytest.approx(evo_ape(False), rel=1e-9)
    assert absolute_error(est, gt, "sim3").rmse == pytest.approx(evo_ape(True), rel=1e-9)
    assert absolute_error(est, gt, "se3").alignment == "se3"
    for relation, ours in zip(
        (metrics.PoseRelation.translation_part, metrics.PoseRelation.rotation_angle_deg),
        relative_error(est, gt, 5),
        strict=True,
    ):
        rpe = metrics.RPE(relation, delta=5, delta_unit=metrics.Unit.frames, all_pairs=True)
        rpe.process_data(
            (trajectory.PosePath3D(poses_se3=list(gt)), trajectory.PosePath3D(poses_se3=list(est)))
        )
        assert ours.rmse == pytest.approx(float(rpe.get_statistic(metrics.StatisticsType.rmse)), rel=1e-6)


def test_bad_requests_say_what_to_do() -> None:
    gt = straight(20)
    with pytest.raises(ConfigError, match="alignment"):
        evaluation.align(gt, gt, "upside down")  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="step"):
        relative_error(gt, gt, 20)


def test_errors_along_the_path_grow_with_a_scale_error() -> None:
    distance, miss, heading = evaluation.errors_along(straight(101, 1.01), straight(101))
    assert distance[-1] == pytest.approx(100)
    assert miss == pytest.approx(0.01 * distance, abs=1e-9)
    assert np.abs(heading).max() < 1e-12
