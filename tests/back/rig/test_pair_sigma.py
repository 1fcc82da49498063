"""Whether the pair's sigma holds: the counting, and one rendered drive with its pieces."""

from __future__ import annotations

import numpy as np
import pytest

from stereocalib_core.experiments import pair_sigma
from stereocalib_core.experiments.pair_sigma import Coverage, course_of, pieces_of


def test_coverage_of_known_errors() -> None:
    rng = np.random.default_rng(0)
    sigmas = rng.uniform(0.5, 2.0, 6000)
    errors = sigmas * rng.standard_normal(6000)
    right, sure = Coverage(200, errors, sigmas), Coverage(80, 3 * errors, sigmas)
    assert right.within(1.0) == pytest.approx(0.683, abs=0.02)
    assert right.within(2.0) == pytest.approx(0.954, abs=0.01)
    assert right.rms() == pytest.approx(1.0, abs=0.03)
    assert sure.within(1.0) == pytest.approx(0.261, abs=0.02)
    assert sure.rms() == pytest.approx(3.0, abs=0.1)
    lines = pair_sigma.table([right, sure]).splitlines()
    assert lines[2].startswith("| 200 | 6000 | 6")
    assert lines[3].startswith("| 80 | 6000 | 2")


def test_a_yaw_that_is_not_measured_lies_within_no_sigma() -> None:
    half = Coverage(80, np.array([0.0, np.nan]), np.array([1.0, np.nan]))
    assert half.within(1.0) == 0.5


def test_seeds_draw_small_and_large_turns_to_both_sides() -> None:
    courses, yaws = zip(*(course_of(seed) for seed in range(400)), strict=True)
    sizes = np.abs(yaws)
    assert set(courses) == {"town", "curves"}
    assert 0.4 < np.mean(np.array(yaws) > 0) < 0.6
    assert 0.4 < np.mean(sizes < np.sqrt(np.prod(pair_sigma.YAWS_DEG))) < 0.6
    assert pair_sigma.YAWS_DEG[0] <= sizes.min() < sizes.max() <= pair_sigma.YAWS_DEG[1]


def test_pieces_lie_within_the_drive() -> None:
    assert pieces_of(200)[:3] == [(0, 200), (0, 120), (80, 200)]
    assert pieces_of(80) == [(0, 80)]
    assert all(0 <= first < end <= 130 for first, end in pieces_of(130))


def test_a_rendered_drive_lies_within_its_sigma() -> None:
    (one,) = pair_sigma.measure([300], 30)
    assert one.frames == 30
    assert np.abs(one.errors) < 4 * one.sigmas
    # a sigma that holds because it is huge would be no answer
    assert one.sigmas < 0.002
