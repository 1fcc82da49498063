"""The fine match of single points along rows: what is no place in a picture is lost, the rest is found."""

from __future__ import annotations

import cv2
import numpy as np

from stereocalib_core.config.pair import ScanDisparityConfig
from stereocalib_core.front.rows.offsets import rows_down
from stereocalib_core.front.scan.scan_disparity import surfaces
from stereocalib_core.front.tracks.row_patches import HALF_V, match_rows, row_leans
from stereocalib_core.geometry import StereoCamera
from stereocalib_core.results import RectificationSample


def test_guesses_and_points_that_are_no_numbers_are_lost_and_harm_nobody() -> None:
    rng = np.random.default_rng(0)
    right = cv2.GaussianBlur(rng.integers(0, 255, (120, 240), np.uint8), (0, 0), 1.5)
    left = np.roll(right, 12, axis=1)
    points = np.tile([120.0, 60.0], (6, 1))
    guess = np.array([12.4, np.nan, np.inf, 11.8, 12.0, 12.0])
    slopes = np.zeros((6, 2))
    points[4, 0], slopes[5, 1] = np.nan, np.nan
    found = match_rows(left, right, points, guess, slopes, np.zeros(6), 0.75, 2.0, 2.0)
    np.testing.assert_allclose(found[[0, 3]], 12.0, atol=0.05)
    assert np.isnan(found[[1, 2, 4, 5]]).all()


def test_a_slanted_edge_is_found_where_it_is_along_rows_as_they_are() -> None:
    u, v = np.meshgrid(np.arange(240.0), np.arange(120.0))
    camera = StereoCamera(240, 120, 150.0, 119.5, 59.5, 0.5)
    offset, roll, keystone, disparity = 0.7, 0.004, 0.02, 12.3

    def scene(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        # most of the contrast slants one way, as of a road's edges on one side of the vanishing point
        return 120.0 + 60.0 * np.sin(0.3 * u + 0.3 * v) + 30.0 * np.cos(0.17 * u - 0.05 * v)

    # the right picture shows at row v what belongs to the row above it, by fixed-point iteration
    x, source = (u - 119.5) / 150.0, v.copy()
    for _ in range(20):
        y = (source - 59.5) / 150.0
        source = v - (offset * (1.0 + y * y) + 150.0 * x * (roll + keystone * y))
    left = np.round(scene(u, v)).astype(np.uint8)
    right = np.round(scene(u + disparity, source)).astype(np.uint8)
    points = np.stack(
        [g.ravel() for g in np.meshgrid(np.linspace(40.0, 210.0, 9), np.linspace(15.4, 104.0, 7))], 1
    )
    guess, slopes = np.full(len(points), 12.0), np.zeros((len(points), 2))
    rows = RectificationSample(np.array([offset, 0.0, roll]), np.eye(3), 100, keystone)

    def matched(sample: RectificationSample | None) -> np.ndarray:
        down = rows_down(camera, sample, points, guess)
        return match_rows(left, right, points, guess, slopes, down, 0.75, 3.0, 2.0) - disparity

    assert np.isfinite(matched(rows)).all()
    np.testing.assert_allclose(matched(rows), 0.0, atol=0.03)
    assert np.nanmedian(np.abs(matched(None))) > 0.3
    # rows that part by a little lean as foretold
    true = match_rows(left, left, points, 0 * guess, slopes, 0 * guess, 0.75, 3.0, 2.0)
    apart = match_rows(
        left, np.roll(left, 1, axis=0), points, 0 * guess, slopes, 0 * guess + 0.7, 0.75, 3.0, 2.0
    )
    lean = row_leans(left, np.roll(left, 1, axis=0), points, apart, slopes, 0 * guess + 0.7)
    assert np.median(lean) > 0.5
    np.testing.assert_allclose(true - apart, 0.3 * lean, atol=0.06)


def test_noise_makes_no_lean_smaller_and_a_slope_is_part_of_it() -> None:
    rng = np.random.default_rng(4)
    u, v = np.meshgrid(np.arange(400.0), np.arange(200.0))
    slope = 0.3

    def scene(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        # the texture of a road, fine from row to row, that slants, weak against the noise of the camera
        return 100.0 + 6.0 * np.sin(0.35 * u + 0.9 * v) + 5.0 * np.sin(0.2 * u + 0.6 * v + 1.0)

    def camera(picture: np.ndarray) -> np.ndarray:
        return np.asarray(
            np.clip(picture + rng.normal(0.0, 2.0, picture.shape), 0, 255).round().astype(np.uint8)
        )

    # right row v shows the left row v - down, disparity grows with the row
    down, about = 0.25, 30.0
    left = camera(scene(u, v))
    right = camera(scene(u + about + slope * (v - down - 100.0), v - down))
    points = np.stack(
        [g.ravel() for g in np.meshgrid(np.arange(80.0, 380.0, 6.0), np.arange(20.0, 180.0, 5.0))], 1
    )
    tilts = np.tile([0.0, slope], (len(points), 1))
    true = about + slope * (points[:, 1] - 100.0)
    found = match_rows(left, right, points, true, tilts, 0.0 * true, 0.5, 3.0, 2.0)
    lean = row_leans(left, right, points, found, tilts, 0.0 * true)
    known = np.isfinite(found)
    assert known.mean() > 0.9
    misread = np.median((true - found)[known])
    assert misread > 0.4
    np.testing.assert_allclose(down * np.median(lean[known]), misread, rtol=0.1)


def test_rows_reach_the_border_of_the_picture_and_not_beyond() -> None:
    rng = np.random.default_rng(1)
    right = cv2.GaussianBlur(rng.integers(0, 255, (60, 240), np.uint8), (0, 0), 1.5)
    left = np.roll(right, 12, axis=1)
    v = np.arange(60.0)
    points = np.stack([np.full(60, 120.0), v], axis=1)
    straight = match_rows(left, right, points, np.full(60, 12.0), np.zeros((60, 2)), 0 * v, 0.75, 2.0, 2.0)
    assert np.isfinite(straight[HALF_V:-HALF_V]).all() and np.isnan(straight[:HALF_V]).all()
    for down in (-70.0, -0.4, 0.4, 70.0):
        found = match_rows(
            left, right, points, np.full(60, 12.0), np.zeros((60, 2)), 0 * v + down, 0.1, 2.0, 2.0
        )
        assert np.isnan(found[:HALF_V]).all() and np.isnan(found[-HALF_V:]).all()
        assert np.isfinite(found).any() == (abs(down) < 1.0)


def test_surfaces_are_the_cells_whose_points_lie_on_one_plane() -> None:
    rng = np.random.default_rng(0)
    u, v = rng.uniform(-20.0, 140.0, 8000), rng.uniform(-20.0, 90.0, 8000)
    d = 8.0 + 0.03 * u - 0.02 * v
    # one cell has a step, one too few points, one only a line
    d[(u > 15.0) & (u < 20.0) & (v > 10.0) & (v < 20.0)] += 2.0
    few = (u > 100.0) & (u < 110.0) & (v > 50.0) & (v < 60.0)
    line = (u > 50.0) & (u < 60.0) & (v > 20.0) & (v < 30.0)
    v[line] = 24.5
    keep = ~few | (np.cumsum(few) <= 4)
    seen = np.column_stack([u, v, d])[keep]
    found = surfaces(seen, (120, 70), (6.0, 11.0), 10, 5, 0.3)
    cells = {(int(row[0]) // 10, int(row[1]) // 10) for row in found}
    assert cells == {(i, j) for i in range(1, 11) for j in range(1, 6)} - {(1, 1), (10, 5), (5, 2)}
    np.testing.assert_allclose(found[:, 2], 8.0 + 0.03 * found[:, 0] - 0.02 * found[:, 1], atol=1e-9)
    assert len(surfaces(seen, (120, 70), (11.0, 50.0), 10, 5, 0.3)) < 10
    np.testing.assert_allclose(found[:, 3:], np.tile([0.03, -0.02], (len(found), 1)), atol=1e-9)


def test_of_a_long_drive_a_third_of_the_scans_is_compared() -> None:
    config = ScanDisparityConfig()
    assert all(config.wanted(k) for k in range(30))
    assert sum(config.wanted(k) for k in range(30, 330)) == 100
