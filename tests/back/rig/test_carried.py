"""The road of the frame before, carried along by the camera's own motion, and what the filter makes of it."""

from __future__ import annotations

import numpy as np
import pytest
from body_on_springs import CAMERA, PAPER, as_results, measure, ride
from simulated_tracks import CAMERA as TRACKED_BY
from simulated_tracks import simulate

from stereocalib_core.back.odometry.packing import pack
from stereocalib_core.back.rig.body_filter import RigFilter
from stereocalib_core.back.rig.carried import Moved, carry, motions
from stereocalib_core.back.rig.road_points import Look
from stereocalib_core.back.rig.smoothing import filter_drive
from stereocalib_core.config import FilterConfig, PipelineConfig
from stereocalib_core.geometry import Extrinsics
from stereocalib_core.numeric.small_algebra import vector_from_rotation
from stereocalib_core.results import FrameResult

WHITE = FilterConfig(persistent_share=0.0, persistent_roll_share=0.0)
SURE = np.diag(np.square([3e-5] * 3 + [3e-4] * 3))


def between(before: np.ndarray, after: np.ndarray, travel_m: float) -> Moved:
    """The motion of a camera that goes straight ahead over a plane, its pose over it known before and after."""
    T = Extrinsics(*after).T_camera_road @ np.linalg.inv(Extrinsics(*before).T_camera_road)
    ahead = T[:3, :3] @ (Extrinsics(*before).R_camera_road @ np.array([0.0, 0.0, travel_m]))
    return Moved(np.r_[vector_from_rotation(np.ascontiguousarray(T[:3, :3])), T[:3, 3] - ahead], SURE)


def test_a_plane_is_where_the_motion_has_brought_the_camera() -> None:
    before, after = np.array([1.65, 0.014, -0.007]), np.array([1.63, 0.021, 0.004])
    moved = between(before, after, 0.9)
    found, by_values, covariance = carry(before, moved)
    np.testing.assert_allclose(found, after, atol=1e-12)
    off = 1e-6 * np.eye(3)
    differences = [carry(before + o, moved)[0] - carry(before - o, moved)[0] for o in off]
    np.testing.assert_allclose(by_values, np.array(differences).T / 2e-6, atol=1e-7)
    # a camera that looks down by more than was thought has come down on the way
    assert by_values[0, 1] == pytest.approx(-0.9, abs=0.05)
    rng = np.random.default_rng(1)
    scattered = [
        carry(before, moved._replace(motion=moved.motion + rng.normal(0, np.sqrt(np.diag(SURE)))))[0]
        for _ in range(2000)
    ]
    np.testing.assert_allclose(np.cov(np.array(scattered).T), covariance, rtol=0.15, atol=1e-9)


def test_motions_are_those_of_the_tracks_and_none_where_there_are_none() -> None:
    results, extrinsics = simulate(np.zeros(12), 0.0, noise_px=0.05)
    results[5] = FrameResult(5, 0.5, results[5].road)
    found = motions(pack(TRACKED_BY, results))
    assert [i for i, m in enumerate(found) if m is None] == [0, 5]
    for i in (1, 4, 9):
        moved = found[i]
        assert moved is not None and moved.travel_m == pytest.approx(0.8, abs=0.01)
        expected = carry(extrinsics[i - 1, :3], moved)[0]
        assert np.rad2deg(np.abs(expected - extrinsics[i, :3])[1:]).max() < 0.02


def test_who_hears_of_the_motion_need_not_guess_springs() -> None:
    """The same looks of white noise, with the true motions and without: less error, and sigma that says so."""
    drive = ride(400)
    z, covariance = measure(drive.truth, PAPER)
    heard, alone = RigFilter(CAMERA, WHITE), RigFilter(CAMERA, WHITE)
    steps = []
    for i, (t, row) in enumerate(zip(drive.time_s.tolist(), z, strict=True)):
        moved = None if i == 0 else between(drive.truth[i - 1], drive.truth[i], 0.8)
        steps.append(
            [rig.step(t, Look(row, covariance), moved=m) for rig, m in ((heard, moved), (alone, None))]
        )
    settled = slice(20, None)
    error, sigma = (
        np.array([[f(s, i) for s in pair] for i, pair in enumerate(steps)])[settled]
        for f in (lambda s, i: s.values - drive.truth[i], lambda s, _: np.sqrt(np.diag(s.covariance)))
    )
    rms = np.sqrt((error**2).mean(axis=0))
    assert (rms[0] < rms[1] * [0.8, 0.65, 0.9]).all(), rms[0] / rms[1]
    assert (np.median(sigma[:, 0], axis=0) < np.median(sigma[:, 1], axis=0)).all()
    assert ((np.abs(error) < 2.0 * sigma).mean(axis=0) > 0.92).all()


def test_a_motion_of_something_else_does_not_stop_the_filter() -> None:
    """For a second, a truck beside turns what is taken for the camera by 8 deg a frame: the looks go on being heard."""
    drive = ride(120)
    z, covariance = measure(drive.truth, PAPER)
    rig, states, errors = RigFilter(CAMERA), [], []
    for i, (t, row) in enumerate(zip(drive.time_s.tolist(), z, strict=True)):
        wrong = Moved(np.r_[np.deg2rad([8.0, 0.0, 0.0]), 0.0, 0.0, -0.8], SURE)
        step = rig.step(t, Look(row, covariance), moved=wrong if 50 <= i < 60 else None)
        states.append(step.state)
        errors.append(np.abs(step.values - drive.truth[i]))
    assert set(states) == {"updated"}
    assert np.rad2deg(np.array(errors)[50:, 1:].max()) < 0.3


def test_standing_still_the_filter_stands_still() -> None:
    """Whoever stands sees one scene: nothing of the road changes, and the errors are those of one look."""
    rig, config = RigFilter(CAMERA), FilterConfig()
    rng, covariance = np.random.default_rng(2), np.diag(np.square(PAPER))
    values, standing = np.array([1.65, 0.014, -0.007]), Moved(np.zeros(6), SURE / 100.0)
    shared = np.sqrt(config.persistent_share) * np.array(PAPER)
    found = []
    for i in range(100):
        noise = np.sqrt(1.0 - config.persistent_share) * rng.normal(0.0, PAPER)
        found.append(rig.step(0.1 * i, Look(values + shared + noise, covariance), moved=standing))
    error = np.array([s.values for s in found]) - values - shared
    assert (np.abs(error[-1]) < 0.35 * np.array(PAPER)).all()
    # ... which no number of looks from one place makes smaller
    assert (np.sqrt(np.diag(found[-1].covariance)) > 0.6 * np.array(PAPER)).all()


def test_the_look_back_hears_of_the_motions_too() -> None:
    results, extrinsics = simulate(np.zeros(60), 0.0, noise_px=0.1)
    z, covariance = measure(extrinsics[:, :3], PAPER)
    plain = as_results(z, covariance, np.array([r.timestamp_s for r in results]))
    tracked = [
        FrameResult(r.frame, r.timestamp_s, p.road, tracks=r.tracks)
        for r, p in zip(results, plain, strict=True)
    ]
    config = PipelineConfig(filter=WHITE)
    error = [
        np.abs(filter_drive(r, TRACKED_BY, config).smoothed.values - extrinsics[:, :3]).mean(axis=0)
        for r in (tracked, plain)
    ]
    assert (error[0] < error[1] * [0.95, 0.7, 0.8]).all(), error
