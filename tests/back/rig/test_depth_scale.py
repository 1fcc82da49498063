"""Offset and scale of the pair's disparities by LiDAR, and the scale by a known path."""

from __future__ import annotations

import numpy as np
import pytest
from test_relative_yaw import CAMERA, simulate

from stereocalib_core.back.rig.depth_scale import lidar_disparity, path_scale
from stereocalib_core.back.rig.yaw_solution import solve_yaw
from stereocalib_core.config.pair import PairConfig
from stereocalib_core.results import Measured, RectificationSample

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
        nothing = np.zeros(400)
        table = [x, y, by_scan, measured, nothing, slope_v, nothing, nothing]
        found.append(np.column_stack(table).astype(np.float32))
    return found


def ahead(scans: int, turn_rad: float = 0.0) -> np.ndarray:
    """(S, 6) motions of a car that drives a metre a frame, and turns."""
    return np.tile([0.0, turn_rad, 0.0, 0.0, 0.0, -1.0], (scans, 1))


@pytest.mark.parametrize(("offset_px", "scale"), [(0.0, 1.0), (0.3, 1.01), (-0.9, 0.98)])
def test_offset_and_scale_are_told_apart(offset_px: float, scale: float) -> None:
    found = lidar_disparity(CAMERA, samples(offset_px, scale), ahead(12), (0.0, 0.0), PairConfig())
    assert found is not None
    assert found.offset_px == pytest.approx(offset_px, abs=0.03)
    assert found.scale == pytest.approx(scale, abs=0.002)
    assert np.abs(np.diff(found.halves[:, 0])) < 0.05
    assert np.abs(np.diff(found.halves[:, 1])) < 0.002


def test_sigma_pays_for_a_lidar_that_stands_two_centimetres_higher() -> None:
    found = lidar_disparity(CAMERA, samples(0.3, 1.01, height_m=0.02), ahead(12), (0.0, 0.0), PairConfig())
    assert found is not None
    assert abs(found.offset_px - 0.3) < 2.0 * found.offset.sigma
    assert abs(found.scale - 1.01) < 2.0 * np.sqrt(found.covariance[1, 1])
    assert found.offset.sigma > 0.05


def test_an_offset_measured_elsewhere_sharpens_the_scale() -> None:
    found = lidar_disparity(CAMERA, samples(0.3, 1.01, height_m=0.02), ahead(12), (0.0, 0.0), PairConfig())
    assert found is not None
    alone, together = found.scale_given(None), found.scale_given(Measured(0.3, 0.01))
    assert together.sigma < 0.5 * alone.sigma
    assert abs(together.value - 1.01) < abs(alone.value - 1.01)


def test_what_single_frames_misread_of_their_rows_moves_nothing() -> None:
    scans, rng = samples(0.3, 1.01), np.random.default_rng(3)
    true = RectificationSample(np.array([-0.2, 0.0, 0.0002]), np.eye(3), 100, 0.002)
    shown = []
    for i, scan in enumerate(scans):
        # odd frames take their rows for too low, even ones for too high, and slanted things are read where they are not
        x, y, measured, slope_v = scan[:, 0], scan[:, 1], scan[:, 3], scan[:, 5]
        right = x - measured / F
        sign = 2.0 * (i % 2) - 1.0
        taken = RectificationSample(
            np.array([-0.2 + 0.1 * sign, 0.0, 0.0002]), np.eye(3), 100, 0.002 + 0.01 * sign
        )
        lean = slope_v + rng.normal(0.3, 0.2, len(scan))
        down = taken.down_px(F, right, y)
        measured = measured - lean * (true.down_px(F, right, y) - down)
        shown.append(np.column_stack([scan[:, :3], measured, scan[:, 4:6], lean, down]).astype(np.float32))
    plain, blind, told = (
        lidar_disparity(CAMERA, given, ahead(12), (0.0, 0.0), PairConfig(), rows)
        for given, rows in ((scans, None), (shown, None), (shown, true))
    )
    assert plain is not None and blind is not None and told is not None
    assert told.offset_px == pytest.approx(plain.offset_px, abs=0.005)
    assert told.scale == pytest.approx(plain.scale, abs=0.0005)
    apart = [float(np.abs(np.diff(way.halves[:, 0]))[0]) for way in (blind, told)]
    assert apart[1] < 0.03 and apart[0] > 0.05


@pytest.mark.parametrize("sweep", [-1.0, 1.0])
def test_a_scan_swept_in_a_turn_is_put_right(sweep: float) -> None:
    turn, scans = 0.02, samples(0.0, 1.0)
    for scan in scans:
        # d of a wall square to the axis of the camera: what comes nearer while it is swept
        x, d = scan[:, 0].astype(float), scan[:, 2].astype(float)
        wall, z = scan[:, 5] == 0.0, FB / d
        # the motion of a point ahead of a car that turns by `turn` about y and drives a metre: dz = - turn x z - 1
        moved = sweep * np.arctan(x) / (2.0 * np.pi) * (turn * x * z + 1.0)
        scan[:, 3] += np.where(wall, FB / (z + moved) - d, 0.0)
    scans = [scan[scan[:, 5] == 0.0] for scan in scans]
    told, blind = (
        lidar_disparity(CAMERA, scans, motions, (0.0, 0.0), PairConfig())
        for motions in (ahead(12, turn), 0.0 * ahead(12))
    )
    assert told is not None and blind is not None
    assert told.noise_px < 0.98 * blind.noise_px


def test_scans_of_earlier_versions_are_read_without_their_lean() -> None:
    new, old = (
        lidar_disparity(CAMERA, given, ahead(12), (0.0, 0.0), PairConfig())
        for given in (samples(0.3, 1.01), [scan[:, :6] for scan in samples(0.3, 1.01)])
    )
    assert new is not None and old is not None and new.offset_px == old.offset_px


def test_many_scans_are_thinned_and_say_the_same() -> None:
    scans, few = samples(0.3, 1.01, scans=24), PairConfig(lidar_samples=3200)
    thin = lidar_disparity(CAMERA, scans, ahead(24), (0.0, 0.0), few)
    by_hand = lidar_disparity(CAMERA, [scan[::3] for scan in scans], ahead(24), (0.0, 0.0), PairConfig())
    assert thin is not None and by_hand is not None
    assert (thin.offset_px, thin.scale) == (by_hand.offset_px, by_hand.scale)
    assert thin.offset_px == pytest.approx(0.3, abs=0.03)


def test_few_scans_give_nothing() -> None:
    assert lidar_disparity(CAMERA, samples(0.3, 1.0, scans=3), ahead(3), (0.0, 0.0), PairConfig()) is None


def test_things_at_one_distance_tell_offset_and_scale_apart_less_well() -> None:
    ordinary, flat = samples(0.3, 1.0), samples(0.3, 1.0)
    for scan in flat:
        scan[:, 3] += 20.0 - scan[:, 2]
        scan[:, 2], scan[:, 5] = 20.0, 0.0
    ways = [lidar_disparity(CAMERA, scans, ahead(12), (0.0, 0.0), PairConfig()) for scans in (ordinary, flat)]
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
