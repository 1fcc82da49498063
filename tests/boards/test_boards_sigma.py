"""Rendered sets against their sigma, as the command beside the documentation's figures counts them."""

from __future__ import annotations

import numpy as np
import pytest

from stereocalib_core.experiments import boards_sigma
from stereocalib_core.experiments.boards_sigma import Coverage


def test_coverage_of_known_errors() -> None:
    rng = np.random.default_rng(0)
    sigmas = rng.uniform(0.5, 2.0, (4000, 6))
    held = Coverage(sigmas * rng.standard_normal((4000, 6)), sigmas)
    np.testing.assert_allclose(held.within(1.0), 0.683, atol=0.03)
    np.testing.assert_allclose(held.within(2.0), 0.954, atol=0.015)
    np.testing.assert_allclose(held.rms(), 1.0, atol=0.05)
    table = boards_sigma.table(held, Coverage(3 * held.errors, sigmas))
    assert "4000 rendered sets" in table
    assert "| fixed | within 1 sigma [%] | 6" in table
    assert "| refined | within 1 sigma [%] | 2" in table


@pytest.fixture(scope="module")
def measured() -> tuple[Coverage, Coverage]:
    return boards_sigma.measure([300], pairs=8)


@pytest.mark.parametrize("kind", [0, 1])
def test_a_rendered_set_lies_within_its_sigma(measured: tuple[Coverage, Coverage], kind: int) -> None:
    coverage = measured[kind]
    assert coverage.errors.shape == (1, 6)
    assert np.all(np.abs(coverage.errors) < 4.0 * coverage.sigmas)
    # A sigma that holds because it is huge would be no answer.
    assert np.all(coverage.sigmas[:, :3] < np.deg2rad(1.0))
    assert np.all(coverage.sigmas[:, 3:] < 0.04)
