"""The filter against a body whose motion is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from body_on_springs import CAMERA, DIRECT, PAPER, as_results, measure, ride

from stereocalib_core.back.rig.body_filter import oscillator
from stereocalib_core.back.rig.smoothing import filter_drive
from stereocalib_core.config import FilterConfig, PipelineConfig


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


@pytest.mark.parametrize(("sigma", "limit"), [(PAPER, 0.7), (DIRECT, 0.95)])
@pytest.mark.parametrize("look_ahead", [True, False])
def test_it_removes_noise_and_not_motion(
    sigma: tuple[float, float, float], limit: float, look_ahead: bool
) -> None:
    drive = ride()
    z, covariance = measure(drive.truth, sigma)
    filtered = filter_drive(
        as_results(z, covariance, drive.time_s),
        CAMERA,
        PipelineConfig(filter=FilterConfig(look_ahead=look_ahead)),
    )
    ratio = rms(filtered.values - drive.truth) / rms(z - drive.truth)
    assert (ratio <= (limit if look_ahead else limit + 0.15)).all(), ratio
    assert set(filtered.state) == {"updated"}


@pytest.mark.parametrize("sigma", [PAPER, DIRECT])
def test_sigma_covers_the_error(sigma: tuple[float, float, float]) -> None:
    drive = ride()
    z, covariance = measure(drive.truth, sigma)
    settings = FilterConfig(persistent_share=0.0)
    filtered = filter_drive(as_results(z, covariance, drive.time_s), CAMERA, PipelineConfig(filter=settings))
    within = (np.abs(filtered.values - drive.truth) < filtered.sigma).mean(axis=0)
    assert (within > 0.58).all(), within
    assert (within[1:] < 0.8).all(), within


def test_a_gap_is_predicted_with_growing_sigma() -> None:
    drive = ride()
    z, covariance = measure(drive.truth, DIRECT)
    gap = range(200, 230)
    filtered = filter_drive(as_results(z, covariance, drive.time_s, gap), CAMERA)
    assert all(filtered.state[i] == ("predicted" if i in gap else "updated") for i in range(len(z)))
    assert (np.diff(filtered.sigma[199:230], axis=0) >= 0).all()
    assert (filtered.sigma[229] > 3 * filtered.sigma[199]).all()
    # what comes after the gap does not reach back into it
    cut = filter_drive(as_results(z, covariance, drive.time_s, range(200, len(z))), CAMERA)
    np.testing.assert_array_equal(cut.values[200:230], filtered.values[200:230])


def test_a_bend_ahead_widens_sigma_and_moves_nothing() -> None:
    drive = ride()
    z, covariance = measure(drive.truth, DIRECT)
    plain = as_results(z, covariance, drive.time_s, range(210, 215))
    bent = list(plain)
    for i in range(200, 210):
        assert plain[i].road is not None
        bent[i] = replace(plain[i], road=replace(plain[i].road, bend=(0.1, 0.02)))
    before, after = filter_drive(plain, CAMERA), filter_drive(bent, CAMERA)
    np.testing.assert_allclose(after.values, before.values, atol=1e-12)
    added = np.sqrt(np.maximum(after.sigma**2 - before.sigma**2, 0.0))
    np.testing.assert_allclose(added[200:215], np.tile([0.1, 0.02, 0.0], (15, 1)), atol=1e-6)
    np.testing.assert_allclose(added[:200], 0.0, atol=1e-6)
    np.testing.assert_allclose(added[215:], 0.0, atol=1e-6)


def test_before_the_first_measurement_there_is_nothing() -> None:
    drive = ride(60)
    z, covariance = measure(drive.truth, DIRECT)
    filtered = filter_drive(as_results(z, covariance, drive.time_s, range(10)), CAMERA)
    assert filtered.state[:11] == ("none",) * 10 + ("updated",)
    assert np.isnan(filtered.values[:10]).all()
    assert not np.isnan(filtered.values[10:]).any()


def test_wild_measurements_are_gated_out_and_said() -> None:
    drive = ride()
    z, covariance = measure(drive.truth, DIRECT)
    wild = np.arange(50, 600, 37)
    z[wild] += np.deg2rad([0.0, 2.0, -2.0]) * np.where(np.arange(len(wild)) % 2, 1.0, -1.0)[:, None]
    filtered = filter_drive(as_results(z, covariance, drive.time_s), CAMERA)
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
    filtered = filter_drive(as_results(z, covariance, drive.time_s), CAMERA)
    assert sum(s == "predicted" for s in filtered.state) <= 2
    assert set(filtered.state[303:]) == {"updated"}
    assert np.rad2deg(rms(filtered.values[304:] - truth[304:])[1]) < 0.02


def test_it_repeats_bit_for_bit() -> None:
    drive = ride(100)
    z, covariance = measure(drive.truth, PAPER)
    first, second = (filter_drive(as_results(z, covariance, drive.time_s), CAMERA) for _ in range(2))
    np.testing.assert_array_equal(first.values, second.values)
    np.testing.assert_array_equal(first.covariance, second.covariance)
