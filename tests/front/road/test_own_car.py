"""What is in every picture and is no road: the car's own bonnet, and the black borders that rectifying leaves."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest

from stereocalib_core.config import PipelineConfig
from stereocalib_core.front.pipeline import FrontEnd
from stereocalib_core.numeric.arrays import Grey
from stereocalib_core.sources.formats.synthetic import SyntheticSource

BONNET_PX = 172
"""Disparity of a bonnet 2.2 m ahead: nearly three times that of the nearest road."""


def _bonnet(picture: Grey, shift: int) -> tuple[Grey, np.ndarray]:
    """The picture with a textured bonnet at its foot, seen `shift` pixels farther left, and where it is."""
    height, width = picture.shape
    shape = np.zeros_like(picture)
    cv2.ellipse(shape, (width // 2 - shift, height + 45), (width // 3, 90), 0, 0, 360, 255, -1)
    paint = np.random.default_rng(3).uniform(0.0, 255.0, (height, 2 * width)).astype(np.float32)
    paint = cv2.GaussianBlur(paint, (0, 0), 2.0)
    paint = 70.0 + 12.0 * (paint - paint.mean()) / paint.std() + np.linspace(0.0, 40.0, height)[:, None]
    drawn = np.where(shape > 0, paint[:, shift : shift + width], picture)
    return drawn.clip(0, 255).astype(np.uint8), shape > 0


def _borders(picture: Grey, _: int) -> tuple[Grey, np.ndarray]:
    """The picture with black borders, and where they are."""
    black = np.ones(picture.shape, np.bool_)
    black[10:-12, 14:-18] = False
    return np.where(black, 0, picture).astype(np.uint8), black


@pytest.fixture(scope="module")
def source() -> SyntheticSource:
    return SyntheticSource.from_spec("synthetic:straight?frames=4")


@pytest.mark.parametrize("paint", [_bonnet, _borders], ids=["bonnet", "black borders"])
def test_what_never_moves_is_not_taken_for_road(source: SyntheticSource, paint: object) -> None:
    assert callable(paint)
    truth = source.ground_truth.extrinsics
    assert truth is not None
    front_end = FrontEnd(source.camera, PipelineConfig())
    for i in range(len(source)):
        frame = source[i]
        assert frame.left is not None and frame.right is not None
        left, painted = paint(frame.left, 0)
        right, _ = paint(frame.right, BONNET_PX)
        look = front_end.look(dataclasses.replace(frame, left=left, right=right))
        road, seen = look.result.road, look.road
        assert road is not None, look.result.failure
        assert seen is not None and seen.region is not None and seen.direct is not None
        cells = seen.region.cells
        step = seen.disparity.step_px
        under = painted[::step, ::step][: cells.shape[0], : cells.shape[1]]
        # the matcher's window reaches over the edge
        assert np.mean(cells[under]) < 0.12
        patches = seen.direct.patches
        assert np.count_nonzero(painted[patches.v.astype(int), patches.u.astype(int)]) <= 3
        e = road.extrinsics
        error = np.abs([e.height_m, e.pitch_rad, e.roll_rad] - truth[i, :3])
        assert np.all(error < [0.006, *np.deg2rad([0.06, 0.1])])
        assert np.all(error < 4.0 * road.sigma)
