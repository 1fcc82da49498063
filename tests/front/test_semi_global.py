"""Our semi-global matcher against OpenCV's: the same rules, so the same map, bit for bit."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from stereocalib_core.config import DisparityConfig
from stereocalib_core.front.matching import compute
from stereocalib_core.front.semi_global.paths import fits, match
from stereocalib_core.geometry import StereoCamera

Picture = NDArray[np.uint8]


def pair(height: int, width: int, seed: int = 5) -> tuple[Picture, Picture]:
    """A textured slope with a box on it, with noise, a dark patch and one without any texture (nothing but ties)."""
    random = np.random.default_rng(seed)
    texture = cv2.GaussianBlur(random.integers(0, 255, (height, 2 * width)).astype(np.float32), (0, 0), 1.5)
    texture = cv2.normalize(texture, None, 0, 255, cv2.NORM_MINMAX)
    u, v = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    disparity = 1.0 + 0.2 * v
    disparity[height // 3 : height // 2, width // 2 : width // 2 + 20] = 0.2 * height
    right = cv2.remap(texture, u, v, cv2.INTER_LINEAR)
    left = cv2.remap(right, u - disparity, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    pictures = [np.clip(p + random.normal(0, 3, p.shape), 0, 255).astype(np.uint8) for p in (left, right)]
    for picture in pictures:
        picture[height // 2 :, -width // 3 : -width // 5] = 90
        picture[: height // 4] //= 8
    return pictures[0], pictures[1]


@pytest.mark.parametrize(
    ("shape", "lowest", "count", "block", "small", "large"),
    [
        ((123, 301), 0, 64, 3, 8, 600),
        ((31, 153), 0, 32, 3, 8, 600),
        ((90, 200), 0, 48, 5, 200, 800),
        ((91, 199), -5, 32, 3, 8, 600),
        ((64, 160), 3, 32, 3, 8, 600),
        ((40, 120), 0, 16, 1, 4, 40),
        ((9, 60), 0, 16, 3, 8, 600),
        ((17, 33), -4, 16, 7, 8, 100),
    ],
)
def test_the_map_is_that_of_opencv(
    shape: tuple[int, int], lowest: int, count: int, block: int, small: int, large: int
) -> None:
    left, right = pair(*shape)
    matcher = cv2.StereoSGBM.create(lowest, count, block, small, large, mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY)
    theirs = matcher.compute(left, right)
    left.flags.writeable = False
    ours = match(left, right, lowest, count, block, small, large)
    np.testing.assert_array_equal(ours, theirs)
    if shape[0] > 50:
        assert np.mean(ours > 16 * lowest) > 0.5, "hardly anything was matched: a test of nothing"


def test_pictures_of_a_few_rows_are_matched_in_place() -> None:
    """OpenCV's strips of less than three rows are put together wrongly: what lies higher comes out lower."""
    left, right = pair(40, 120)
    few = match(left[:6], right[:6], 0, 16, 3, 8, 600)
    many = match(left[:40], right[:40], 0, 16, 3, 8, 600)
    both = (few > 0) & (many[:6] > 0)
    assert both.mean() > 0.3
    assert np.mean(np.abs(few[both] - many[:6][both]) <= 8) > 0.8


def test_costs_beyond_16_bits_are_left_to_opencv() -> None:
    assert fits(3, 8, 600)
    assert not fits(11, 8, 600)
    assert not fits(3, 8, 6000)
    camera = StereoCamera(301, 123, 300.0, 150.0, 60.0, 0.5)
    left, right = pair(123, 301)
    config = DisparityConfig(block_size=11, max_disparity_px=64)
    matcher = cv2.StereoSGBM.create(0, 64, 11, 8, 600, mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY)
    theirs = matcher.compute(left, right)
    ours = compute(left, right, camera, config, step=1)
    np.testing.assert_array_equal(ours.values[theirs > 0], theirs[theirs > 0] / np.float32(16))
