"""The fine match of single points along rows: what is no place in a picture is lost, the rest is found."""

from __future__ import annotations

import cv2
import numpy as np

from stereocalib_core.config.pair import ScanDisparityConfig
from stereocalib_core.front.scan.scan_disparity import shifted_rows
from stereocalib_core.front.tracks.patches import match_rows


def test_guesses_and_points_that_are_no_numbers_are_lost_and_harm_nobody() -> None:
    rng = np.random.default_rng(0)
    right = cv2.GaussianBlur(rng.integers(0, 255, (120, 240), np.uint8), (0, 0), 1.5)
    left = np.roll(right, 12, axis=1)
    points = np.tile([120.0, 60.0], (6, 1))
    guess = np.array([12.4, np.nan, np.inf, 11.8, 12.0, 12.0])
    slopes = np.zeros((6, 2))
    points[4, 0], slopes[5, 1] = np.nan, np.nan
    found = match_rows(left, right, points, guess, slopes, 0.75, 2.0, 2.0)
    np.testing.assert_allclose(found[[0, 3]], 12.0, atol=0.05)
    assert np.isnan(found[[1, 2, 4, 5]]).all()


def test_rows_that_part_are_put_together_again_to_a_grey_or_two() -> None:
    u, v = np.meshgrid(np.arange(200.0), np.arange(120.0))
    bend, (f, cx, cy) = (0.7, 0.004, 0.02), (150.0, 99.5, 59.5)

    def scene(v: np.ndarray) -> np.ndarray:
        return 120.0 + 60.0 * np.sin(0.21 * u + 0.3 * v) + 40.0 * np.cos(0.17 * u - 0.25 * v)

    x, y = (u - cx) / f, (v - cy) / f
    down = bend[0] * (1.0 + y * y) + f * (bend[1] * x + bend[2] * x * y)
    # by fixed-point iteration: the picture in which row v lies where the bend has put it
    source = v.copy()
    for _ in range(20):
        yy = (source - cy) / f
        source = v - (bend[0] * (1.0 + yy * yy) + f * (bend[1] * x + bend[2] * x * yy))
    bent = np.round(scene(source)).astype(np.uint8)
    found = shifted_rows(bent, bend, (f, cx, cy)).astype(float)
    inner = (slice(5, -5), slice(5, -5))
    assert np.abs(found - scene(v))[inner].max() < 3.0
    assert np.abs(bent - scene(v))[inner].max() > 10.0 and np.abs(down).max() > 1.0
    np.testing.assert_array_equal(shifted_rows(bent, (0.0, 0.0, 0.0), (f, cx, cy)), bent)


def test_of_a_long_drive_a_third_of_the_scans_is_compared() -> None:
    config = ScanDisparityConfig()
    assert all(config.wanted(k) for k in range(30))
    assert sum(config.wanted(k) for k in range(30, 330)) == 100
