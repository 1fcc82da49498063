"""The pair's relative yaw by motion, against simulated points whose bend is known."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from stereocalib_core.back.rig.relative_yaw import (
    RelativeYaw,
    as_it_may_be,
    relative_yaw,
)
from stereocalib_core.back.rig.stereo_tracks import StereoTracks, stereo_tracks
from stereocalib_core.config.pair import PairConfig
from stereocalib_core.errors import Failure, FailureReason
from stereocalib_core.geometry import StereoCamera, road_rotation, rotation_y
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.results import FrameResult, Measured, Tracks

CAMERA = StereoCamera(1242, 375, 720.0, 620.0, 187.0, 0.54)
NONE = Measured(0.0, 0.0)


@dataclasses.dataclass(frozen=True)
class Simulated:
    tracks: StereoTracks
    motions: Array
    active: np.ndarray

    def measured(self, roll: Measured = NONE, pitch: Measured = NONE) -> RelativeYaw:
        return relative_yaw(self.tracks, self.motions, self.active, (roll, pitch), PairConfig())


def _seen(points: Array, turn: Array) -> Array:
    """(N, 3) u, v, disparity of points in a pair whose right camera is turned."""
    f, b = CAMERA.focal_px, CAMERA.baseline_m
    left = points[:, :2] / points[:, 2:]
    right = (points - [b, 0.0, 0.0]) @ turn.T
    u, v = left[:, 0] * f + CAMERA.cx_px, left[:, 1] * f + CAMERA.cy_px
    return np.column_stack([u, v, f * (left[:, 0] - right[:, 0] / right[:, 2])])


def simulate(
    yaw_deg: float = 0.0,
    roll_deg: float = 0.0,
    pitch_deg: float = 0.0,
    pairs: int = 30,
    noise_px: float = 0.0,
    wrong: float = 0.0,
    step_m: float = 1.0,
    depths_m: tuple[float, float] = (5.0, 60.0),
    seed: int = 0,
) -> Simulated:
    """A drive past random points. wrong: share of tracks that end anywhere within 5 px."""
    rng = np.random.default_rng(seed)
    roll, pitch, yaw = np.deg2rad([roll_deg, pitch_deg, yaw_deg])
    turn = road_rotation(pitch, roll) @ rotation_y(yaw)
    results, motions = [_result(0, None)], [np.zeros(7)]
    for i in range(1, pairs + 1):
        z = 1.0 / rng.uniform(1 / depths_m[1], 1 / depths_m[0], 150)
        x, y = rng.uniform(-0.7, 0.7, 150), rng.uniform(-0.1, 0.22, 150)
        before = np.column_stack([x * z, y * z, z])
        R = rotation_y(rng.normal(0, 0.01)) @ road_rotation(rng.normal(0, 0.003), 0.0)
        t = np.array([rng.normal(0, 0.01), 0.0, -step_m])
        now = before @ R.T + t
        rows = np.column_stack([_seen(before, turn), _seen(now, turn)])
        rows[:, 2:] += noise_px * rng.standard_normal((150, 4))
        strays = rng.random(150) < wrong
        rows[strays, 3:5] += rng.uniform(-5, 5, (int(strays.sum()), 2))
        results.append(_result(i, Tracks(rows.astype(np.float32), np.zeros(150, bool), i - 1)))
        motions.append(np.array([0.0, 0.0, 0.0, 0.0, 0.0, -0.9 * step_m, 1.0]))
    active = np.arange(pairs + 1) > 0
    return Simulated(stereo_tracks(CAMERA, results), np.array(motions), active)


def _result(index: int, tracks: Tracks | None) -> FrameResult:
    return FrameResult(index, 0.1 * index, None, Failure(FailureReason.NO_ROAD, ""), tracks=tracks)


@pytest.mark.parametrize("yaw_deg", [0.0, 0.1, -0.05, 0.3])
def test_a_bend_without_noise_is_found_exactly(yaw_deg: float) -> None:
    found = simulate(yaw_deg).measured()
    assert np.rad2deg(found.yaw_rad) == pytest.approx(yaw_deg, abs=2e-5 + 2e-3 * yaw_deg**2)


def test_a_plain_offset_is_not_what_a_turn_does() -> None:
    """The disparity of a turned camera changes by 1 + x^2; simulated exactly, so a plain offset would miss by 25 %."""
    wide = simulate(0.1)
    assert np.rad2deg(wide.measured().yaw_rad) == pytest.approx(0.1, rel=1e-3)


def test_the_roll_and_pitch_of_the_rows_are_taken_out() -> None:
    bent = simulate(0.05, roll_deg=0.1, pitch_deg=-0.08)
    rows = Measured(np.deg2rad(0.1), 0.0), Measured(np.deg2rad(-0.08), 0.0)
    assert np.rad2deg(bent.measured(*rows).yaw_rad) == pytest.approx(0.05, abs=2e-4)
    assert abs(np.rad2deg(bent.measured().yaw_rad) - 0.05) > 2e-3


def test_unsure_rows_make_an_unsure_yaw() -> None:
    drive = simulate(0.05, noise_px=0.1)
    sure = drive.measured().sigma_rad
    unsure = drive.measured(Measured(0.0, np.deg2rad(0.05)), NONE).sigma_rad
    assert unsure > sure


@pytest.mark.parametrize("wrong", [0.0, 0.2])
def test_noise_and_wrong_tracks_stay_within_sigma(wrong: float) -> None:
    errors = []
    for seed in range(12):
        found = simulate(0.1, noise_px=0.1, wrong=wrong, seed=seed).measured()
        errors.append((np.rad2deg(found.yaw_rad) - 0.1) / np.rad2deg(found.sigma_rad))
    assert np.max(np.abs(errors)) < 3.5
    assert abs(np.mean(errors)) < 0.6


def test_the_noise_of_disparities_does_not_pass_for_a_bend() -> None:
    """A depth that is wrong flattens the slope of flow over depth; taken for true it would look like an offset."""
    found = [simulate(noise_px=0.4, pairs=60, seed=seed).measured().yaw_rad for seed in range(6)]
    assert abs(np.rad2deg(np.mean(found))) < 1.5e-3


def test_a_standing_car_shows_nothing() -> None:
    drive = simulate(0.1, noise_px=0.1)
    standing = dataclasses.replace(drive, active=np.zeros_like(drive.active))
    found = standing.measured()
    assert not found.measured
    assert "moves" in str(found.reason)
    assert np.isnan(found.yaw_rad)


def test_a_scene_at_one_depth_shows_less() -> None:
    """What is left is how the offset grows to the sides."""
    # of a small yaw, whose own share in sigma is next to nothing
    ordinary = simulate(0.01, noise_px=0.1).measured()
    flat = simulate(0.01, noise_px=0.1, depths_m=(20.0, 20.2)).measured()
    assert flat.sigma_rad > 2 * ordinary.sigma_rad


def test_halves_and_thirds_are_those_of_their_pairs() -> None:
    drive = simulate(0.1, noise_px=0.1, pairs=60)
    found = drive.measured()
    odd = dataclasses.replace(drive, active=drive.active & (np.arange(61) % 2 == 1)).measured()
    assert odd.yaw_rad == pytest.approx(found.halves[0], abs=np.deg2rad(2e-4))
    assert np.mean(found.thirds) == pytest.approx(found.yaw_rad, abs=np.deg2rad(5e-4))


def test_sigma_knows_of_an_offset_that_is_no_turn() -> None:
    drive, config = simulate(0.1), PairConfig()
    yaw, rng = drive.measured(), np.random.default_rng(0)
    noise = np.deg2rad(rng.normal(0.0, 0.01, 30))

    def sigma_deg(keystones: Array) -> float:
        return float(np.rad2deg(as_it_may_be(yaw, drive.tracks, keystones, config).sigma_rad))

    plain = np.rad2deg(yaw.sigma_rad)
    assert sigma_deg(noise + np.deg2rad(0.1)) == plain
    assert sigma_deg(noise[:4]) == plain
    # a shift of the principal point by the same pixels in the middle reads as less yaw, by 1 + x^2
    mean_square = float(np.mean((drive.tracks.rays[0] - drive.tracks.rays[2]) ** 2))
    for other in (0.0, 0.5, -0.1):
        shown = sigma_deg(noise + np.deg2rad(other))
        assert shown == pytest.approx(np.hypot(plain, 0.1 * mean_square), rel=0.01)
    assert 0.05 < mean_square < 0.3


def test_what_a_match_along_untrue_rows_leans_by_is_no_yaw() -> None:
    bent = simulate(0.3, noise_px=0.02)
    x, y = bent.tracks.rays[0] - bent.tracks.rays[2], bent.tracks.rays[1]
    x_now, y_now = bent.tracks.rays[3] - bent.tracks.rays[5], bent.tracks.rays[4]
    rays = bent.tracks.rays.copy()
    # every edge runs to the vanishing point, so that it leans by -x / y where rows part by yaw x y
    for k, (a, b) in enumerate(((x, y), (x_now, y_now))):
        rays[6 + k] = np.clip(a / np.where(np.abs(b) > 0.02, b, 0.02), -1.0, 1.0)
        rays[2 + 3 * k] -= rays[6 + k] * np.deg2rad(0.3) * a * b
    known = dataclasses.replace(bent, tracks=dataclasses.replace(bent.tracks, rays=rays)).measured()
    rays = rays.copy()
    rays[6:] = 0.0
    unknown = dataclasses.replace(bent, tracks=dataclasses.replace(bent.tracks, rays=rays)).measured()
    right = bent.measured().yaw_rad
    assert abs(known.yaw_rad - right) < np.deg2rad(0.002)
    assert abs(unknown.yaw_rad - right) > np.deg2rad(0.005)
