"""Small systems and medians of compiled loops against numpy's."""

from __future__ import annotations

import numpy as np
import pytest

from stereocalib_core.front.road.patches import offsets_of
from stereocalib_core.numeric.small_algebra import median_size, solve_square


@pytest.mark.parametrize("size", [1, 2, 3, 6])
def test_a_system_is_solved_as_numpy_solves_it(size: int) -> None:
    rng = np.random.default_rng(size)
    H, R = rng.normal(size=(size, size)), rng.normal(size=(size, 3))
    H[0, 0] = 0.0 if size > 1 else 2.0  # the first pivot has to be looked for
    solved = R.copy()
    assert solve_square(H.copy(), solved) == pytest.approx(np.linalg.det(H), rel=1e-12)
    assert np.allclose(solved, np.linalg.solve(H, R), rtol=1e-10, atol=1e-12)


def test_a_singular_system_has_no_determinant() -> None:
    assert solve_square(np.array([[0.0, 1.0], [0.0, 2.0]]), np.ones((2, 1))) == 0.0
    assert np.isnan(solve_square(np.full((2, 2), np.nan), np.ones((2, 1))))


def test_the_median_of_sizes_is_numpys() -> None:
    rng = np.random.default_rng(1)
    for n in (*range(1, 12), 500, 501):
        for values in (rng.normal(size=n), rng.integers(-2, 3, n).astype(np.float64)):
            assert median_size(values) == np.median(np.abs(values))
    assert np.isnan(median_size(np.empty(0)))
    assert np.isnan(median_size(np.array([1.0, np.nan, 2.0])))


def test_offsets_are_those_of_whole_arrays() -> None:
    """The same least squares written with numpy; a patch without a gradient says nothing."""
    rng = np.random.default_rng(2)
    n, pixels = 40, 99
    uu, vv = rng.uniform(500.0, 4000.0, (2, n))
    uv = 0.3 * np.sqrt(uu * vv) * rng.uniform(-1.0, 1.0, n)
    offset, row = rng.normal(0.0, 0.3, n), 0.2
    ur, vr = -offset * uu + row * uv, -offset * uv + row * vv
    rr = offset**2 * uu + row**2 * vv - 2.0 * offset * row * uv + 30.0
    sums = np.stack([uu, uv, vv, ur, vr, rr], axis=1)
    sums[3] = 0.0
    found, sigma = offsets_of(sums, np.linspace(-200.0, 200.0, n), np.ones(n), pixels)
    seen = np.arange(n) != 3
    assert np.allclose(found[seen], offset[seen], atol=1e-9)
    assert np.allclose(sigma[seen], np.sqrt((30.0 / (pixels - 3) + 0.1) / uu[seen]), rtol=1e-6)
    assert found[3] == 0.0
    assert np.isinf(sigma[3])
