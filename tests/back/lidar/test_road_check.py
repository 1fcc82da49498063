"""The LiDAR's road against the stereo road: planes with known answers, then a real drive."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from simulated_scan import (
    STEREO_COVARIANCE,
    T_CAMERA_LIDAR,
    beams,
    frame_with,
    scan_of_road,
    stereo_result,
    turned,
    with_residual,
)

from stereocalib_core.back.lidar.road_check import check, who_moved
from stereocalib_core.config import RoadCheckConfig
from stereocalib_core.front.scan.lidar_road import fit_lane, scan_residual
from stereocalib_core.geometry import Extrinsics, invert_transform
from stereocalib_core.results import FrameResult, RoadResidual

CONFIG = RoadCheckConfig()
ROAD = Extrinsics.from_degrees(1.66, 0.9, -1.1)
DEGREE = float(np.rad2deg(1.0))
SIGMA = np.array([0.004, *np.deg2rad([0.03, 0.06])])


def residual(
    scan: np.ndarray, T: np.ndarray = T_CAMERA_LIDAR, stereo: Extrinsics = ROAD
) -> RoadResidual | None:
    return scan_residual(frame_with(scan), stereo_result(0, stereo), T, CONFIG)


def assert_within(values: np.ndarray, expected: object, limits: object) -> None:
    assert np.all(np.abs(values - np.asarray(expected)) < np.asarray(limits)), values


# ---- one scan -------------------------------------------------------------------------------------------------


def test_exact_scan_of_a_plane_has_no_residual() -> None:
    found = residual(scan_of_road(ROAD, noise_m=0.0))
    assert found is not None and found.points > 2000
    np.testing.assert_allclose(found.values, 0.0, atol=2e-6)


def test_residual_is_what_the_stereo_road_gets_wrong() -> None:
    stereo = Extrinsics(ROAD.height_m + 0.02, ROAD.pitch_rad - 0.005, ROAD.roll_rad + 0.008)
    found = residual(scan_of_road(ROAD, noise_m=0.0), stereo=stereo)
    assert found is not None
    assert_within(found.values, [-0.02, 0.005, -0.008], [2e-5, 2e-5, 2e-5])


@pytest.mark.parametrize(("pitch", "roll"), [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0), (3.0, -3.0)])
def test_a_turned_lidar_shows_as_much_on_its_axis(pitch: float, roll: float) -> None:
    found = residual(scan_of_road(ROAD), turned(T_CAMERA_LIDAR, pitch, roll))
    assert found is not None
    np.testing.assert_allclose(found.values[1:] * DEGREE, [pitch, roll], atol=0.06)


def test_a_raised_lidar_shows_as_height_alone() -> None:
    higher = T_CAMERA_LIDAR.copy()
    higher[1, 3] -= 0.03
    scan = scan_of_road(ROAD, higher)
    found = residual(scan)
    assert found is not None
    assert_within(found.values, [0.03, 0.0, 0.0], [0.004, 5e-4, 1e-3])


def test_yaw_and_shifts_along_the_road_do_not_show() -> None:
    moved = turned(T_CAMERA_LIDAR, yaw_deg=1.0)
    moved[0, 3] += 0.1
    moved[2, 3] += 0.2
    level = Extrinsics(1.65, 0.0, 0.0)
    found = residual(scan_of_road(level), moved, level)
    assert found is not None
    np.testing.assert_allclose(found.values[1:] * DEGREE, 0.0, atol=0.06)
    assert abs(found.values[0]) < 0.006


def test_sigma_covers_the_errors_of_the_scan() -> None:
    errors, sigmas = [], []
    for seed in range(60):
        found = residual(scan_of_road(ROAD, noise_m=0.05, seed=seed))
        assert found is not None
        errors.append(found.values)
        sigmas.append(np.sqrt(np.diag(found.covariance - STEREO_COVARIANCE)))
    floor = np.array([CONFIG.systematic_height_m, *np.deg2rad([CONFIG.systematic_angle_deg] * 2)])
    stated = np.sqrt(np.mean(np.square(sigmas), axis=0) - floor**2)
    ratio = np.std(errors, axis=0) / stated
    assert np.all((ratio > 0.6) & (ratio < 1.4)), ratio
    together = found.covariance - STEREO_COVARIANCE
    stated_sign = np.sign(together[0, 1])
    assert stated_sign * np.corrcoef(np.transpose(errors))[0, 1] > 0.7


def lane(height: object, step_m: float, near: float = 5.5, far: float = 20.0) -> np.ndarray:
    """(N, 3) points X, Y = height(X, Z), Z of an even grid."""
    x, z = (g.ravel() for g in np.meshgrid(np.arange(-1.74, 1.75, step_m), np.arange(near, far, step_m)))
    return np.stack([x, height(x, z), z], axis=1)  # type: ignore[operator]


def test_crowded_near_rings_do_not_pull_the_plane() -> None:
    """A road that bends away: rays even in angle must give the plane of an evenly sampled surface."""

    def bend(x: np.ndarray, z: np.ndarray) -> np.ndarray:
        return 0.0003 * (z - 5.0) ** 2 + 0.008 * np.abs(x)

    grid = lane(bend, 0.05)
    weights = 1.0 / (1.0 + (grid[:, 2] / CONFIG.even_m) ** 5)
    J = np.column_stack([np.ones(len(grid)), grid[:, 2], grid[:, 0]])
    truth = np.linalg.solve((J * weights[:, None]).T @ J, (J * weights[:, None]).T @ grid[:, 1])
    rays = beams()
    down, ahead, side = -rays[:, 2], rays[:, 0], -rays[:, 1]
    hit = down > 0.06
    reach = 1.7 / down[hit]
    for _ in range(30):
        reach = (1.7 + bend(side[hit] * reach, ahead[hit] * reach)) / down[hit]
    x, z = side[hit] * reach, ahead[hit] * reach
    inside = (np.abs(x) < 1.75) & (z > 5.5) & (z < 20.0)
    points = np.stack([x, bend(x, z), z], axis=1)[inside]
    found = fit_lane(points, dataclasses.replace(CONFIG, tukey=50.0))
    assert found is not None
    assert_within(found.coefficients, truth, [0.002, 0.0002, 0.0002])
    plain = np.linalg.lstsq(
        np.column_stack([np.ones(len(points)), points[:, 2], points[:, 0]]), points[:, 1]
    )[0]
    assert abs(plain[1] - truth[1]) > 3 * abs(found.coefficients[1] - truth[1])


def on_lane(points_road: np.ndarray) -> np.ndarray:
    """(N, 3) X, Y, Z over the road to (N, 4) points of a scan."""
    T = invert_transform(T_CAMERA_LIDAR) @ ROAD.T_camera_road
    points = points_road @ T[:3, :3].T + T[:3, 3]
    return np.column_stack([points, np.zeros(len(points))]).astype(np.float32)


def over_road(scan: np.ndarray) -> np.ndarray:
    """(N, 4) points of a scan to (N, 3) X, Y, Z over the road."""
    T = invert_transform(ROAD.T_camera_road) @ T_CAMERA_LIDAR
    return np.asarray(scan[:, :3].astype(np.float64) @ T[:3, :3].T + T[:3, 3])


def test_a_car_ahead_and_a_kerb_are_left_out() -> None:
    rng = np.random.default_rng(1)
    points = over_road(scan_of_road(ROAD))
    points[points[:, 0] > 1.4, 1] -= 0.12
    hidden = (points[:, 2] > 14.0) & (np.abs(points[:, 0]) < 0.9)
    rear = np.column_stack([rng.uniform(-0.9, 0.9, 2000), rng.uniform(-1.4, -0.2, 2000), np.full(2000, 14.0)])
    found = residual(on_lane(np.concatenate([points[~hidden], rear])))
    assert found is not None
    assert_within(found.values, 0.0, [0.006, np.deg2rad(0.05), np.deg2rad(0.12)])


def test_a_lane_that_shows_no_road_gives_nothing() -> None:
    rng = np.random.default_rng(2)
    heap = np.column_stack(
        [rng.uniform(-1.7, 1.7, 3000), rng.uniform(-0.9, 0.2, 3000), rng.uniform(6, 20, 3000)]
    )
    assert residual(on_lane(heap)) is None
    assert residual(np.zeros((0, 4), np.float32)) is None
    assert residual(scan_of_road(ROAD)[:40]) is None
    wall = np.column_stack([rng.uniform(-1.7, 1.7, 3000), rng.uniform(-0.5, 0.0, 3000), np.full(3000, 8.0)])
    assert residual(on_lane(wall)) is None


def test_without_scan_road_or_calibration_there_is_no_residual() -> None:
    scan = scan_of_road(ROAD)
    assert scan_residual(frame_with(None), stereo_result(0, ROAD), T_CAMERA_LIDAR, CONFIG) is None
    assert scan_residual(frame_with(scan), FrameResult(0, 0.0, None), T_CAMERA_LIDAR, CONFIG) is None
    assert scan_residual(frame_with(scan), stereo_result(0, ROAD), None, CONFIG) is None


def test_sixteen_rings_are_enough() -> None:
    found = residual(scan_of_road(ROAD, rings=16))
    assert found is not None
    assert np.all(np.abs(found.values) < 4 * np.sqrt(np.diag(found.covariance)))


def test_the_same_scan_gives_the_same_bits() -> None:
    scan = scan_of_road(ROAD)
    before = scan.copy()
    first, second = residual(scan), residual(scan)
    assert first is not None and second is not None
    assert first.values.tobytes() == second.values.tobytes()
    assert first.covariance.tobytes() == second.covariance.tobytes()
    assert scan.tobytes() == before.tobytes()


# ---- a drive --------------------------------------------------------------------------------------------------


def drive(count: int, seed: int, change: object = None, spread: np.ndarray = SIGMA) -> list[FrameResult]:
    """Residuals with noise that neighbours share (a first-order process); change(i) is added to each."""
    rng = np.random.default_rng(seed)
    state, results = np.zeros(3), []
    for i in range(count):
        state = 0.6 * state + 0.8 * spread * rng.standard_normal(3)
        results.append(with_residual(i, state + (0.0 if change is None else change(i)), SIGMA))  # type: ignore[operator]
    return results


def step(axis: int, size: float, at: int) -> object:
    return lambda i: np.eye(3)[axis] * (size if i >= at else 0.0)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(
    ("axis", "name", "size"),
    [
        (0, "height", 0.05),
        (1, "pitch", np.deg2rad(0.5)),
        (1, "pitch", -np.deg2rad(0.5)),
        (2, "roll", np.deg2rad(0.5)),
    ],
)
def test_a_step_is_found_soon_and_on_its_axis_alone(axis: int, name: str, size: float, seed: int) -> None:
    found = check(drive(80, seed, step(axis, size, 40)), CONFIG)
    assert found is not None
    (shift,) = found.shifts
    assert (shift.axis, shift.kind) == (name, "step")
    assert abs(shift.frame - 40) <= 2 and shift.detected_at < 60
    assert shift.size == pytest.approx(size, rel=0.25)


def test_a_sound_mounting_raises_no_alarm() -> None:
    for seed in range(40):
        found = check(drive(120, seed), CONFIG)
        assert found is not None and found.shifts == ()


def test_a_passing_disturbance_is_no_step() -> None:
    for seed in range(10):
        found = check(
            drive(80, seed, lambda i: np.array([0, 0, np.deg2rad(0.6 if 40 <= i < 44 else 0.0)])), CONFIG
        )
        assert found is not None and found.shifts == ()


def test_a_wrong_calibration_is_said_from_the_start() -> None:
    found = check(drive(12, 3, step(2, np.deg2rad(1.0), 0)), CONFIG)
    assert found is not None
    (shift,) = found.shifts
    assert (shift.axis, shift.kind, shift.frame) == ("roll", "offset", 0)
    assert shift.size * DEGREE == pytest.approx(1.0, abs=0.1)


def test_an_offset_within_its_own_doubt_is_no_alarm() -> None:
    """0.55 deg of roll is beyond the limit of 0.5, but not by three sigmas."""
    found = check(drive(12, 3, step(2, np.deg2rad(0.55), 0)), CONFIG)
    assert found is not None and found.shifts == ()


@pytest.mark.parametrize(
    ("camera", "moved"),
    [
        ([], "lidar"),
        ([(41, "pitch", -np.deg2rad(0.55))], "camera"),
        ([(41, "pitch", np.deg2rad(0.5))], None),
        ([(41, "roll", -np.deg2rad(0.5)), (5, "pitch", -np.deg2rad(0.5))], "lidar"),
    ],
)
def test_who_moved_is_told_by_the_cameras_own_road(camera: list[object], moved: str | None) -> None:
    found = check(drive(80, 0, step(1, np.deg2rad(0.5), 40)), CONFIG)
    assert found is not None
    (shift,) = who_moved(found, camera, CONFIG).shifts  # type: ignore[arg-type]
    assert shift.moved == moved
    off = check(drive(12, 3, step(2, np.deg2rad(1.0), 0)), CONFIG)
    assert off is not None and who_moved(off, [], CONFIG).shifts[0].moved is None


def test_filter_averages_and_its_sigma_holds() -> None:
    errors, stated = [], []
    for seed in range(30):
        found = check(drive(100, seed), CONFIG)
        assert found is not None
        assert found.series is not None
        errors.append(found.series.filtered[-1])
        stated.append(found.series.filtered_sigma[-1])
    ratio = np.sqrt(np.mean(np.square(errors), axis=0)) / np.mean(stated, axis=0)
    assert np.all((ratio > 0.5) & (ratio < 1.5)), ratio
    assert np.all(np.mean(stated, axis=0) < 0.5 * SIGMA * np.sqrt(CONFIG.correlated_frames))


def test_filter_follows_a_step() -> None:
    found = check(drive(80, 0, step(1, np.deg2rad(0.5), 40)), CONFIG)
    assert found is not None and found.series is not None
    assert found.series.filtered[-1, 1] * DEGREE == pytest.approx(0.5, abs=0.06)
    assert found.series.filtered[38, 1] * DEGREE == pytest.approx(0.0, abs=0.06)


def test_a_check_counts_its_frames_and_says_what_a_road_cannot_show() -> None:
    results = [*drive(20, 1, step(1, np.deg2rad(2.0), 0)), stereo_result(20, ROAD)]
    found = check(results, CONFIG)
    assert found is not None
    assert found.pitch_rad.median * DEGREE == pytest.approx(2.0, abs=0.1)
    assert abs(found.roll_rad.median) < 3 * found.roll_rad.scatter
    assert found.shifts[0].axis == "pitch"
    assert found.frames == 20
    assert all(word in found.unseen for word in ("yaw", "x", "z"))
    assert check([stereo_result(0, ROAD)], CONFIG) is None
    assert check([], CONFIG) is None
