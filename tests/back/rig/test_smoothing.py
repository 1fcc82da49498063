"""The filter against a body whose motion is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from body_on_springs import CAMERA, DIRECT, PAPER, as_results, measure, ride

from stereocalib_core.back.rig.body_filter import oscillator, plane_covariance, plane_of
from stereocalib_core.back.rig.road_points import Look
from stereocalib_core.back.rig.smoothing import filter_drive
from stereocalib_core.config import FilterConfig, PipelineConfig
from stereocalib_core.config.back import NoiseBankConfig
from stereocalib_core.experiments.filter import LinearFilter
from stereocalib_core.geometry import DisparityPlane, Extrinsics
from stereocalib_core.results import FrameResult, RoadEstimate


def rms(values: np.ndarray) -> np.ndarray:
    return np.sqrt((values**2).mean(axis=0))


def test_oscillator_is_the_exact_solution() -> None:
    F, Q = oscillator(1.4, 0.35, 0.1)
    half, _ = oscillator(1.4, 0.35, 0.05)
    np.testing.assert_allclose(half @ half, F, atol=1e-12)
    # x'' = -w^2 x - 2 d w x' from (1, 0) in small steps
    w, x, v = 2 * np.pi * 1.4, 1.0, 0.0
    for _ in range(100_000):
        x, v = x + 1e-6 * v, v + 1e-6 * (-(w**2) * x - 0.7 * w * v)
    np.testing.assert_allclose(F[:, 0], [x, v], rtol=1e-3)
    assert (np.linalg.eigvalsh(Q) > 0).all()


@pytest.mark.parametrize(("sigma", "limit"), [(PAPER, (0.85, 0.7)), (DIRECT, (1.0, 0.95))])
def test_it_removes_noise_and_not_motion(
    sigma: tuple[float, float, float], limit: tuple[float, float]
) -> None:
    drive = ride()
    z, covariance = measure(drive.truth, sigma)
    for found, most in zip(filter_drive(as_results(z, covariance, drive.time_s), CAMERA), limit, strict=True):
        ratio = rms(found.values - drive.truth) / rms(z - drive.truth)
        assert (ratio <= most).all(), ratio
        assert set(found.state) == {"updated"}


@pytest.mark.parametrize("sigma", [PAPER, DIRECT])
def test_sigma_covers_the_error(sigma: tuple[float, float, float]) -> None:
    """White noise has nothing that persists: without that share both sigmas are what the errors are."""
    drive = ride()
    z, covariance = measure(drive.truth, sigma)
    settings = PipelineConfig(filter=FilterConfig(persistent_share=0.0, persistent_roll_share=0.0))
    for found in filter_drive(as_results(z, covariance, drive.time_s), CAMERA, settings):
        within = (np.abs(found.values - drive.truth) < found.sigma).mean(axis=0)
        assert (within > 0.58).all(), within
        assert (within[1:] < 0.8).all(), within


@pytest.mark.parametrize("sigma", [PAPER, DIRECT])
def test_sigma_covers_errors_that_neighbours_share(sigma: tuple[float, float, float]) -> None:
    """With the share that ships: most of an error is the road's and stays for seconds, the rest is white."""
    ships = FilterConfig()
    share = np.array([ships.persistent_share, ships.persistent_share, ships.persistent_roll_share])
    errors = []
    for seed in (11, 12, 13):
        drive = ride(seed=seed)
        white, covariance = measure(drive.truth, sigma, seed)
        rng = np.random.default_rng([seed, 7])
        slow = np.repeat(rng.standard_normal((30, 3)), 20, axis=0) * np.array(sigma)
        z = drive.truth + np.sqrt(1.0 - share) * (white - drive.truth) + np.sqrt(share) * slow
        found = filter_drive(as_results(z, covariance, drive.time_s), CAMERA)
        errors.append([np.abs(series.values - drive.truth) / series.sigma for series in found])
    for in_sigmas in np.concatenate(errors, axis=1):
        once, twice = (in_sigmas < 1.0).mean(axis=0), (in_sigmas < 2.0).mean(axis=0)
        assert (once > 0.58).all() and (once < 0.88).all(), once
        assert (twice > 0.92).all(), twice


def test_noise_is_learnt() -> None:
    """Measurements twice as bad as they say are smoothed by what they are, and sigma says so."""
    drive = ride()
    z, covariance = measure(drive.truth, PAPER)
    results = as_results(z, covariance / 4.0, drive.time_s)
    believing = FilterConfig(noise_bank=NoiseBankConfig(noise_prior=1e-3))
    learnt, believed = (
        filter_drive(results, CAMERA, PipelineConfig(filter=config)).smoothed
        for config in (FilterConfig(), believing)
    )
    assert (rms(learnt.values - drive.truth) < 0.93 * rms(believed.values - drive.truth)).all()
    assert (np.median(learnt.sigma, axis=0) > 1.4 * np.median(believed.sigma, axis=0)).all()


def test_filtered_is_causal_and_smoothed_looks_back() -> None:
    """Nothing in row i depends on later frames: a drive cut anywhere has the same rows up to there."""
    drive = ride(300)
    z, covariance = measure(drive.truth, PAPER)
    results = as_results(z, covariance, drive.time_s, range(150, 155))
    whole = filter_drive(results, CAMERA)
    for count in (1, 40, 152, 200):
        part = filter_drive(results[:count], CAMERA)
        np.testing.assert_array_equal(part.filtered.values, whole.filtered.values[:count])
        np.testing.assert_array_equal(part.filtered.covariance, whole.filtered.covariance[:count])
    assert not np.array_equal(part.smoothed.values, whole.smoothed.values[:count])
    np.testing.assert_array_equal(whole.smoothed.values[-1], whole.filtered.values[-1])


def linear(results: list[FrameResult]) -> np.ndarray:
    """(N, 3) what the same filter makes of height, pitch and roll taken as they are: linear in its state."""
    rig = LinearFilter(CAMERA)
    rows = []
    for r in results:
        assert r.road is not None
        e = r.road.extrinsics
        z = np.array([e.height_m, e.pitch_rad, e.roll_rad])
        rows.append(rig.step(r.timestamp_s, Look(z, r.road.covariance)).values)
    return np.array(rows)


@pytest.mark.parametrize("height_m", [1.65, 0.4])
def test_a_linear_filter_is_worse_where_sigma_is_large(height_m: float) -> None:
    """Planes with normal errors in (A, B, C): their heights are not normal, and a linear filter takes them for it."""
    drive = ride(400, straight=True)
    scale = height_m / 1.65
    truth = drive.truth * [scale, 1.0, 1.0]
    planes = np.array([plane_of(CAMERA, row) for row in truth])
    rough = np.diag(np.square([0.12 * height_m, *np.deg2rad([1.0, 2.0])]))
    rng = np.random.default_rng(3)
    sigma = np.linalg.cholesky(plane_covariance(CAMERA, truth[0], rough))
    seen = planes + rng.standard_normal(planes.shape) @ sigma.T
    poses = [DisparityPlane(*row).extrinsics(CAMERA) for row in seen]
    z = np.array([[e.height_m, e.pitch_rad, e.roll_rad] for e in poses])
    results = []
    for i, row in enumerate(z):
        J = Extrinsics(*row).disparity_plane_jacobian(CAMERA)
        covariance = np.linalg.inv(J) @ sigma @ sigma.T @ np.linalg.inv(J).T
        road = RoadEstimate(Extrinsics(*row), covariance, 1000, 0.5, (4.0, 20.0))
        results.append(FrameResult(i, float(drive.time_s[i]), road))
    ours, theirs = filter_drive(results, CAMERA).filtered.values, linear(results)
    settled = slice(50, None)
    assert np.abs(ours - theirs)[settled, 0].max() > 0.005 * scale
    assert rms((ours - truth)[settled])[0] < 0.8 * rms((theirs - truth)[settled])[0]


def test_a_gap_is_predicted_with_growing_sigma() -> None:
    drive = ride()
    z, covariance = measure(drive.truth, DIRECT)
    gap = range(200, 230)
    filtered = filter_drive(as_results(z, covariance, drive.time_s, gap), CAMERA).smoothed
    assert all(filtered.state[i] == ("predicted" if i in gap else "updated") for i in range(len(z)))
    assert (np.diff(filtered.sigma[199:230], axis=0) >= 0).all()
    assert (filtered.sigma[229] > 2.5 * filtered.sigma[199]).all()
    # what comes after the gap does not reach back into it
    cut = filter_drive(as_results(z, covariance, drive.time_s, range(200, len(z))), CAMERA).smoothed
    np.testing.assert_array_equal(cut.values[200:230], filtered.values[200:230])


def test_a_bend_ahead_widens_sigma_and_moves_nothing() -> None:
    drive = ride()
    z, covariance = measure(drive.truth, DIRECT)
    plain = as_results(z, covariance, drive.time_s, range(210, 215))
    bent = list(plain)
    for i in range(200, 210):
        assert plain[i].road is not None
        bent[i] = replace(plain[i], road=replace(plain[i].road, bend=(0.1, 0.02)))
    before, after = filter_drive(plain, CAMERA).smoothed, filter_drive(bent, CAMERA).smoothed
    np.testing.assert_allclose(after.values, before.values, atol=1e-12)
    added = np.sqrt(np.maximum(after.sigma**2 - before.sigma**2, 0.0))
    np.testing.assert_allclose(added[200:215], np.tile([0.1, 0.02, 0.0], (15, 1)), atol=1e-6)
    np.testing.assert_allclose(added[:200], 0.0, atol=1e-6)
    np.testing.assert_allclose(added[215:], 0.0, atol=1e-6)


def test_before_the_first_measurement_there_is_nothing() -> None:
    drive = ride(60)
    z, covariance = measure(drive.truth, DIRECT)
    filtered = filter_drive(as_results(z, covariance, drive.time_s, range(10)), CAMERA).smoothed
    assert filtered.state[:11] == ("none",) * 10 + ("updated",)
    assert np.isnan(filtered.values[:10]).all()
    assert not np.isnan(filtered.values[10:]).any()


def test_wild_measurements_are_gated_out_and_said() -> None:
    drive = ride()
    z, covariance = measure(drive.truth, DIRECT)
    wild = np.arange(50, 600, 37)
    z[wild] += np.deg2rad([0.0, 2.0, -2.0]) * np.where(np.arange(len(wild)) % 2, 1.0, -1.0)[:, None]
    filtered = filter_drive(as_results(z, covariance, drive.time_s), CAMERA).smoothed
    assert [i for i, s in enumerate(filtered.state) if s == "predicted"] == wild.tolist()
    assert np.abs(np.rad2deg(filtered.values - drive.truth)[wild, 1:]).max() < 0.6


@pytest.mark.parametrize("knock_deg", [0.3, 1.0, 5.0])
def test_a_knock_does_not_lock_the_filter_out(knock_deg: float) -> None:
    drive = ride()
    truth = drive.truth + np.where(np.arange(600) >= 300, np.deg2rad(knock_deg), 0.0)[:, None] * [
        0.0,
        1.0,
        0.0,
    ]
    z, covariance = measure(truth, DIRECT)
    filtered = filter_drive(as_results(z, covariance, drive.time_s), CAMERA).smoothed
    assert sum(s == "predicted" for s in filtered.state) <= 2
    assert set(filtered.state[303:]) == {"updated"}
    assert np.rad2deg(rms(filtered.values[304:] - truth[304:])[1]) < 0.02


def test_who_comes_out_of_a_junction_is_believed_at_once() -> None:
    """Thirty frames share an error of roll of 3 deg, and say so; then the lane is seen, and sure."""
    drive = ride(frames=60, straight=True)
    sigma = np.tile([0.005, 0.001, np.deg2rad(0.1)], (60, 1))
    sigma[:30, 2] = np.deg2rad(3.0)
    z = drive.truth + 0.3 * sigma * np.random.default_rng(8).standard_normal((60, 3))
    z[:30, 2] = drive.truth[:30, 2] + np.deg2rad(3.0)
    results = [
        as_results(z[i : i + 1], np.diag(sigma[i] ** 2), drive.time_s[i : i + 1])[0] for i in range(60)
    ]
    for found in filter_drive(results, CAMERA):
        assert set(found.state) == {"updated"}
        error = np.rad2deg(np.abs(found.values - drive.truth)[:, 2])
        assert error[32:].max() < 0.3, error[28:36]
        assert (error[30:] < 3.0 * np.rad2deg(found.sigma[30:, 2])).all()


def test_it_repeats_bit_for_bit() -> None:
    drive = ride(100)
    z, covariance = measure(drive.truth, PAPER)
    first, second = (filter_drive(as_results(z, covariance, drive.time_s), CAMERA).smoothed for _ in range(2))
    np.testing.assert_array_equal(first.values, second.values)
    np.testing.assert_array_equal(first.covariance, second.covariance)
