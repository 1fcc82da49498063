"""The fine match of single points along rows: what is no place in a picture is lost, the rest is found."""

from __future__ import annotations

import cv2
import numpy as np

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
