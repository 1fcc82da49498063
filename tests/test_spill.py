"""Arrays on the disk: the same numbers as in memory, whoever lets them go and however they are cut into chunks."""

from __future__ import annotations

import os

import numpy as np
import pytest

from stereocalib_core.numeric import chunks, spill
from stereocalib_core.numeric.stretches import STRETCH, median_of


def test_contents_outlive_being_let_go() -> None:
    values = np.random.default_rng(1).normal(size=(300, 1000))
    place = spill.roomy(values.shape)
    assert len(spill.spilled([place, values, 3])) == 1, "nothing is on the disk: a test of nothing"
    place[...] = values
    part = place[:, 7:90]
    spill.let_go(part, place, values)
    np.testing.assert_array_equal(place, values)
    np.testing.assert_array_equal(part, values[:, 7:90])
    np.testing.assert_array_equal(spill.put_away(values), values)
    assert not spill.roomy((3, 4)).any()
    assert not spill.spilled([spill.roomy((3, 4))])


def test_a_full_disk_means_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "posix_fallocate", full)
    place = spill.roomy((300, 1000))
    assert not spill.spilled([place])
    assert not place.any()


def test_a_shelf_holds_what_was_put_on_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spill, "FIRST_SEGMENT_BYTES", 1000)
    random, shelf = np.random.default_rng(2), spill.Shelf()
    arrays = [random.normal(size=(n % 7, 6)).astype(np.float32) for n in range(200)]
    arrays.append(random.normal(size=(3000, 900)))  # larger than a segment
    arrays.append(random.random(77) < 0.5)
    kept = [shelf.put(a) for a in arrays]
    for a, b in zip(arrays, kept, strict=True):
        assert a.dtype == b.dtype
        np.testing.assert_array_equal(a, b)


def test_chunks_of_what_is_on_the_disk_cover_all_of_it_once() -> None:
    count = 3 * chunks.MOST_AT_ONCE + 17
    counted, data = np.zeros(count), spill.roomy((100, count))
    data[...] = np.arange(count)
    sizes = []

    def work(first: int, last: int, rows: np.ndarray, out: np.ndarray) -> None:
        sizes.append(last - first)
        out[first:last] += rows[:, first:last].sum(axis=0)

    chunks.in_chunks(work, count, data, counted)
    np.testing.assert_array_equal(counted, 100.0 * np.arange(count))
    assert max(sizes) <= chunks.MOST_AT_ONCE


def test_a_median_that_needs_no_copy_is_the_median() -> None:
    rng = np.random.default_rng(0)
    for count in (1, 2, 3, 10, 1001, 2 * STRETCH, 3 * STRETCH + 1):
        values = 10.0 ** rng.integers(-5, 5, count) * rng.standard_normal(count) ** 2
        values[::7] = 0.0
        chosen = rng.random(count) < 0.7
        chosen[0] = True
        assert median_of(values, chosen) == np.median(values[chosen])
