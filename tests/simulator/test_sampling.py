"""Textures sampled eight pixels at once against one by one, and the arithmetic of lanes against numpy's."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit

from stereocalib_core.numeric.wide import (
    as_doubles,
    as_longs,
    bits,
    choose,
    doubles_of_bits,
    down,
    gather,
    load,
    size,
    smallest,
    some,
    store,
)
from stereocalib_core.simulator.sampling import sample_wide
from stereocalib_core.simulator.textures import build_atlas, sample


@njit
def one_by_one(texels, table, levels, texture, u, v, ux, vx, uy, vy, taps, out):  # type: ignore[no-untyped-def]
    for i in range(u.size):
        out[i] = sample(texels, table, levels, texture[i], u[i], v[i], ux[i], vx[i], uy[i], vy[i], taps)


@njit
def eight_at_once(texels, starts, sizes, texture, u, v, ux, vx, uy, vy, taps, out):  # type: ignore[no-untyped-def]
    for i in range(0, u.size, 8):
        steps = load(ux, i), load(vx, i), load(uy, i), load(vy, i)
        place = load(texture, i), load(u, i), load(v, i)
        store(out, i, sample_wide(texels, starts, sizes, *place, *steps, taps))


@pytest.mark.parametrize("taps", [0, 1, 5])
def test_eight_at_once_are_the_same_as_one_by_one(taps: int) -> None:
    rng = np.random.default_rng(taps)
    atlas = build_atlas([rng.integers(0, 256, shape).astype(np.uint8) for shape in ((64, 256), (512, 512))])
    count = 8000
    texture = rng.integers(0, 2, count)
    u, v = rng.uniform(-600, 5000, (2, count))
    footprint = rng.normal(0, 1, (4, count)) * 10 ** rng.uniform(-1, 2, count)
    found, expected = np.zeros(count), np.zeros(count)
    eight_at_once(atlas.texels, atlas.starts, atlas.sizes, texture, u, v, *footprint, taps, found)
    one_by_one(atlas.texels, atlas.table, atlas.levels, texture, u, v, *footprint, taps, expected)
    # four digits behind the point are what single precision leaves of 255
    np.testing.assert_allclose(found, expected, atol=1e-4)
    assert np.ptp(expected) > 100


def test_a_footprint_has_no_direction() -> None:
    """Its taps lie alike to both sides of the middle, or the texture would move by where its levels change."""
    rng = np.random.default_rng(3)
    atlas = build_atlas([rng.integers(0, 256, (512, 512)).astype(np.uint8)] * 2)
    count = 4000
    texture, (u, v) = np.zeros(count, int), rng.uniform(0, 512, (2, count))
    footprint = rng.normal(0, 1, (4, count)) * 10 ** rng.uniform(0, 1.5, count)
    seen, turned = np.zeros(count), np.zeros(count)
    eight_at_once(atlas.texels, atlas.starts, atlas.sizes, texture, u, v, *footprint, 5, seen)
    eight_at_once(atlas.texels, atlas.starts, atlas.sizes, texture, u, v, *-footprint, 5, turned)
    np.testing.assert_allclose(turned, seen, atol=1e-3)


@njit
def arithmetic(a, b, table, where, out):  # type: ignore[no-untyped-def]
    x, y = load(a, 0), load(b, 0)
    store(out, 0, x * y - y / 2.0 + 1)
    store(out, 8, choose((x > y) & (x < 6.0), x, -1.0))
    store(out, 16, down(size(x - 3.5)))
    store(out, 24, gather(a, load(where, 0)))
    store(out, 32, as_doubles((gather(table, load(where, 0)) >> 8) & 255))
    store(out, 40, doubles_of_bits(bits(x) + (as_longs(y) << 52)))
    return some(x > 7.5), smallest(x)


def test_lanes_compute_what_numpy_computes() -> None:
    a, b = np.array([1.0, 2.5, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]), np.arange(8.0)[::-1].copy()
    table, where = np.arange(40, dtype=np.uint8) * 3, np.array([0, 7, 3, 3, 5, 1, 2, 6])
    out = np.zeros(48)
    assert arithmetic(a, b, table, where, out) == (True, 1.0)
    expected = [
        a * b - b / 2 + 1, np.where((a > b) & (a < 6), a, -1), np.floor(np.abs(a - 3.5)), a[where],
        table[where + 1], a * 2**b,
    ]  # fmt: skip
    np.testing.assert_allclose(out.reshape(6, 8), np.array(expected))
