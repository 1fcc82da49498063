"""A bent pair's far points are not taken for points that move by themselves, and a straight pair is left alone."""

from __future__ import annotations

import numpy as np
import pytest

from stereocalib_core.config import OdometryConfig, TracksConfig
from stereocalib_core.front.tracks.bent_pair import judge_by
from stereocalib_core.front.tracks.pair_motion import robust_motion
from stereocalib_core.geometry import StereoCamera
from stereocalib_core.numeric.small_algebra import rotation_from_vector

CAMERA = StereoCamera(1226, 370, 707.0, 602.0, 183.0, 0.537)
F, B = CAMERA.focal_px, CAMERA.baseline_m
CONFIG = TracksConfig()
MOTION = np.array([0.002, 0.01, -0.001, 0.02, -0.01, -1.2])
POINTS = 400


def seen(yaw_deg: float, wrong: int = 0, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """(5, N) rays of a road and of things beside it as a pair bent by that much measures them, and (N,) the inverse
    depths that it measures a frame later; the first `wrong` points move by themselves."""
    rng = np.random.default_rng(seed)
    z = 1.0 / rng.uniform(1 / 60.0, 1 / 6.0, POINTS)
    x = rng.uniform(-0.6, 0.6, POINTS)
    y = np.where(rng.random(POINTS) < 0.6, 1.65 / z, rng.uniform(-0.15, 0.05, POINTS))
    turn = np.tan(np.deg2rad(yaw_deg))

    def measured(x: np.ndarray, z: np.ndarray) -> np.ndarray:
        right = x - B / z
        return np.asarray((x - (right + turn) / (1.0 - right * turn)) / B)

    q = rotation_from_vector(MOTION[:3]) @ np.stack([x * z, y * z, z]) + MOTION[3:, None]
    now = q[:2] / q[2] + rng.normal(0.0, 0.15 / F, (2, POINTS))
    now[:, :wrong] += rng.uniform(-12.0, 12.0, (2, wrong)) / F
    return np.stack([x, y, measured(x, z), *now]), measured(q[0] / q[2], q[2])


def motion_of(rays: np.ndarray) -> np.ndarray:
    """The pair's own, by the depths as measured."""
    votes, rounds = np.ones(rays.shape[1]), OdometryConfig().solver.iterations
    rays = np.ascontiguousarray(rays)
    return np.asarray(robust_motion(rays, votes, MOTION, F, CONFIG.tolerance_px, CONFIG.samples, rounds)[0])


def off_px(expected: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """(N,) [px] how far points are from where they are expected."""
    return np.asarray(np.hypot(expected[0] - rays[3], expected[1] - rays[4]) * F)


@pytest.mark.parametrize("yaw_deg", [-0.3, 0.15, 0.3])
@pytest.mark.parametrize("wrong", [0, 60])
def test_points_of_a_bent_pair_are_where_they_are_expected(yaw_deg: float, wrong: int) -> None:
    rays, later = seen(yaw_deg, wrong)
    rays, later = rays[:, rays[2] > 0.0], later[rays[2] > 0.0]
    judge = judge_by(CAMERA, rays, motion_of(rays), CONFIG.tolerance_px, CONFIG.bent)
    assert np.rad2deg(judge.yaw_rad) == pytest.approx(yaw_deg, abs=0.01)
    sound = slice(wrong, None)
    expected = judge.expected(rays)
    assert (off_px(expected, rays)[sound] < 1.0).all()
    assert (np.abs(expected[2] - later)[sound] * F * B < 0.3).all()


def test_the_motion_alone_would_drop_what_shows_the_bend() -> None:
    rays, _ = seen(-0.3)
    plain = CONFIG.bent.__class__(least_move_px=1e9)
    judge = judge_by(CAMERA, rays, motion_of(rays), CONFIG.tolerance_px, plain)
    assert judge.yaw_rad == 0.0
    far = 1.0 / rays[2] > 30.0
    assert (off_px(judge.expected(rays), rays)[far] > CONFIG.tolerance_px).mean() > 0.05


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("yaw_deg", [0.0, 0.02])
def test_a_pair_that_is_straight_or_nearly_so_is_left_alone(yaw_deg: float, seed: int) -> None:
    rays, _ = seen(yaw_deg, 60, seed)
    motion = motion_of(rays)
    judge = judge_by(CAMERA, rays, motion, CONFIG.tolerance_px, CONFIG.bent)
    assert judge.yaw_rad == 0.0
    np.testing.assert_array_equal(judge.motion, motion)


def test_a_car_that_stands_shows_no_bend() -> None:
    rays, _ = seen(0.3)
    rays[3:] = rays[:2] + np.random.default_rng(1).normal(0.0, 0.15 / F, (2, POINTS))
    judge = judge_by(CAMERA, rays, np.zeros(6), CONFIG.tolerance_px, CONFIG.bent)
    assert judge.yaw_rad == 0.0
