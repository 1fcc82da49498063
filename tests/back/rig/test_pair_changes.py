"""Steps of a pair: where one camera was knocked against the other."""

from __future__ import annotations

import numpy as np
import pytest

from stereocalib_core.back.rig.pair_changes import steps, stretches
from stereocalib_core.config.steps import PairStepConfig

CONFIG = PairStepConfig()


def _series(
    count: int, at: int, size: float, noise: float = 0.01, seed: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    values = np.random.default_rng(seed).normal(0.0, noise, count)
    values[at:] += size
    return values, np.full(count, noise**-2.0)


@pytest.mark.parametrize("seed", range(4))
def test_a_step_is_found_at_its_frame(seed: int) -> None:
    found = steps(*_series(200, 110, 0.1, seed=seed), 0.02, spans=False, config=CONFIG)
    assert [step.at for step in found] == [110]
    assert found[0].size == pytest.approx(0.1, abs=4 * found[0].sigma)


def test_the_pair_of_frames_at_a_step_belongs_to_neither_side() -> None:
    values, precision = _series(200, 111, 0.1)
    values[110] = 0.05
    found = steps(values, precision, 0.02, spans=True, config=CONFIG)
    assert [step.at for step in found] == [110]
    values[110] = np.nan
    assert [step.at for step in steps(values, precision, 0.02, spans=True, config=CONFIG)] == [110]


def test_two_steps_and_back() -> None:
    values, precision = _series(300, 100, 0.1)
    values[200:] -= 0.1
    assert [step.at for step in steps(values, precision, 0.02, spans=False, config=CONFIG)] == [100, 200]


@pytest.mark.parametrize("seed", range(6))
def test_noise_and_strays_are_no_step(seed: int) -> None:
    values, precision = _series(400, 0, 0.0, seed=seed)
    values[np.random.default_rng(seed).integers(0, 400, 20)] += 1.0
    assert steps(values, precision, 0.02, spans=False, config=CONFIG) == ()


def test_a_step_too_small_to_matter_is_none() -> None:
    assert steps(*_series(400, 200, 0.015, noise=0.001), 0.02, spans=False, config=CONFIG) == ()


def test_the_unit_of_the_precision_does_not_matter() -> None:
    values, precision = _series(200, 110, 0.1)
    assert steps(values, precision, 0.02, False, CONFIG) == steps(values, precision, 0.02, False, CONFIG)
    scaled = steps(values, 1e6 * precision, 0.02, spans=False, config=CONFIG)
    assert [step.at for step in scaled] == [110]


def test_stretches_join_edges_that_are_close() -> None:
    assert stretches(100, [40, 41, 70]) == [(0, 40), (40, 70), (70, 100)]
    assert stretches(100, []) == [(0, 100)]
