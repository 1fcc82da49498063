"""Offset and scale of the pair's disparities by LiDAR, and the scale by a known path."""

from __future__ import annotations

import numpy as np
import pytest
from test_relative_yaw import CAMERA, simulate

from stereocalib_core.back.rig.depth_scale import lidar_disparity, path_scale
from stereocalib_core.back.rig.relative_yaw import solve_yaw
from stereocalib_core.config.pair import PairConfig
from stereocalib_core.results import Measured

F, FB = CAMERA.focal_px, CAMERA.focal_px * CAMERA.baseline_m


def samples(
    offset_px: float,
    scale: float,
    scans: int = 12,
    noise_px: float = 0.2,
    height_m: float = 0.0,
    seed: int = 0,
) -> list[np.ndarray]:
    """Scans of a road and of walls; height_m: how much higher the LiDAR truly stands than it says."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(scans):
        x = rng.uniform(-0.6, 0.6, 400)
        road = np.arange(400) < 200
        y = np.where(road, rng.uniform(0.06, 0.25, 400), rng.uniform(-0.1, 0.1, 400))
        true = np.where(road, FB * y / 1.65, FB / rng.uniform(6.0, 60.0, 400))
        slope_v = np.where(road, CAMERA.baseline_m / 1.65, 0.0)
        by_scan = np.where(road, FB * y / (1.65 + height_m), true)
        right = x - true / F
        measured = scale * true - offset_px * (1.0 + right**2) + rng.normal(0.0, noise_px, 400)
        wrong = rng.random(400) < 0.1
        measured[wrong] += rng.uniform(-3.0, 3.0, int(wrong.sum()))
        found.append(np.column_stack([x, y, by_scan, measured, np.zeros(400), slope_v]).astype(np.float32))
    return found


@pytest.mark.parametrize(("offset_px", "scale"), [(0.0, 1.0), (0.3, 1.01), (-0.9, 0.98)])
def test_offset_and_scale_are_told_apart(offset_px: float, scale: float) -> None:
    found = lidar_disparity(CAMERA, samples(offset_px, scale), np.full(12, 1.0), (0.0, 0.0), PairConfig())
    assert found is not None
    assert found.offset_px == pytest.approx(offset_px, abs=0.03)
    assert found.scale == pytest.approx(scale, abs=0.002)
    assert np.abs(np.diff(found.halves[:, 0])) < 0.05
    assert np.abs(np.diff(found.halves[:, 1])) < 0.002


def test_sigma_pays_for_a_lidar_that_stands_two_centimetres_higher() -> None:
    found = lidar_disparity(
        CAMERA, samples(0.3, 1.01, height_m=0.02), np.full(12, 1.0), (0.0, 0.0), PairConfig()
    )
    assert found is not None
    assert abs(found.offset_px - 0.3) < 2.0 * found.offset.sigma
    assert abs(found.scale - 1.01) < 2.0 * np.sqrt(found.covariance[1, 1])
    assert found.offset.sigma > 0.05


def test_an_offset_measured_elsewhere_sharpens_the_scale() -> None:
    found = lidar_disparity(
        CAMERA, samples(0.3, 1.01, height_m=0.02), np.full(12, 1.0), (0.0, 0.0), PairConfig()
    )
    assert found is not None
    alone, together = found.scale_given(None), found.scale_given(Measured(0.3, 0.01))
    assert together.sigma < 0.5 * alone.sigma
    assert abs(together.value - 1.01) < abs(alone.value - 1.01)


def test_few_scans_give_nothing() -> None:
    assert lidar_disparity(CAMERA, samples(0.3, 1.0, scans=3), np.ones(3), (0.0, 0.0), PairConfig()) is None


def test_things_at_one_distance_tell_offset_and_scale_apart_less_well() -> None:
    ordinary, flat = samples(0.3, 1.0), samples(0.3, 1.0)
    for scan in flat:
        scan[:, 3] += 20.0 - scan[:, 2]
        scan[:, 2], scan[:, 5] = 20.0, 0.0
    ways = [
        lidar_disparity(CAMERA, scans, np.ones(12), (0.0, 0.0), PairConfig()) for scans in (ordinary, flat)
    ]
    spread = [abs(way.halves[0, 0] - way.halves[1, 0]) for way in ways if way is not None]
    assert len(spread) < 2 or spread[1] > 3 * spread[0]


def test_a_known_path_gives_the_scale() -> None:
    drive = simulate(0.0, pairs=40)
    solution = solve_yaw(drive.tracks, drive.motions, drive.active, (0.0, 0.0), PairConfig())
    assert solution is not None
    truth = np.tile(np.eye(4), (41, 1, 1))
    truth[:, 2, 3] = 1.02 * np.arange(41)
    truth[20:, 0, 3] += 50.0
    found = path_scale(solution, CAMERA.baseline_m, truth, PairConfig())
    assert found is not None
    assert found.value == pytest.approx(1.02, abs=0.002)
