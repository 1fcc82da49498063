"""From what many looks have shown to where the own car is."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from stereocalib_core.config import OwnCarConfig
from stereocalib_core.front.own_car.looks import Small, depths
from stereocalib_core.front.own_car.place import Grid
from stereocalib_core.geometry import Extrinsics, StereoCamera
from stereocalib_core.numeric.arrays import Array, Grey, Mask
from stereocalib_core.results import OwnCarMemory

UNIT = 64.0
"""Evidence is counted in whole parts of so many to one."""


def decided(
    memory: OwnCarMemory,
    shown: list[Small],
    right: Grey,
    road: Extrinsics,
    camera: StereoCamera,
    grid: Grid,
    config: OwnCarConfig,
) -> NDArray[np.int16] | None:
    """(C,) `tops` by the evidence; what was known before, where there is none that speaks against it.

    shown: pictures of the left camera over some metres, the last of them that of `right` and of `road`.
    """
    if memory.evidence is None:
        return memory.tops
    total, looks = memory.evidence.astype(np.float64)
    mean = total / (UNIT * np.maximum(looks, 1.0))
    black, beside = _black(shown, grid, config)
    tops = highest(mean + np.where(black[grid.top :], config.black_evidence, 0.0), grid, config)
    if tops is not None:
        own = np.arange(grid.top, grid.rows)[:, None] >= tops
        stands = own & (mean > config.stands) & ~beside[grid.top :]
        if on_road(stands, shown[-1], Small.of(right, grid, config), road, camera, grid, config):
            return None
        return np.where((tops == grid.top) & black.all(axis=0), 0, tops).astype(np.int16)
    if memory.tops is None:
        return None
    own = np.arange(grid.top, grid.rows)[:, None] >= memory.tops
    return None if mean[own].sum() < 0.0 else memory.tops


def on_road(
    stands: Mask,
    left: Small,
    right: Small,
    road: Extrinsics,
    camera: StereoCamera,
    grid: Grid,
    config: OwnCarConfig,
) -> bool:
    """Whether what stands still lies on the road: the own car's shadow, and the light of its lamps.

    Then left and right picture agree at the road's disparity, and at no other. stands: (r, C) the blocks that do.
    """
    plane, by = road.disparity_plane(camera), grid.by
    # shrunk column j is u = by (j + 0.5) - 0.5, and a disparity is as many times smaller
    middle = 0.5 * by - 0.5
    first = plane.c_px + plane.a * (middle - camera.cy_px) + plane.b * (middle - camera.cx_px)
    off = depths(
        left.detail, left.light, right.detail, right.light, stands, grid.block, grid.top,
        np.array([plane.b, plane.a, first / by]), camera.disparity_offset_px / by,
        np.array([1.0, *config.other_depths]), config.noise, config.most_sigmas,
    )  # fmt: skip
    return bool(off[0] < config.on_road * off[1:].min())


def _black(shown: list[Small], grid: Grid, config: OwnCarConfig) -> tuple[Mask, Mask]:
    """(R, C) of the blocks that are black in all of the pictures, and of those whose detail has something of one."""
    brightest = np.max([small.light + small.detail for small in shown], axis=0)
    black = (brightest <= config.black).astype(np.uint8)
    near = cv2.dilate(black, np.ones(config.detail[::-1], np.uint8))
    w, h = grid.block
    blocks = [
        mask[: grid.rows * h, : grid.columns * w].reshape(grid.rows, h, grid.columns, w) > 0
        for mask in (black, np.asarray(near))
    ]
    return np.asarray(blocks[0].all(axis=(1, 3))), np.asarray(blocks[1].any(axis=(1, 3)))


def highest(evidence: Array, grid: Grid, config: OwnCarConfig) -> NDArray[np.int16] | None:
    """(C,) `tops` of the edge with the most (r, C) `evidence` [log likelihood a look] below it; None: of none.

    The edge costs something where it rises or falls (a Viterbi path from column to column); whatever is of one piece
    must be wide enough, and have enough evidence.
    """
    r, columns = evidence.shape
    below = np.zeros((columns, r + 1))
    below[:, :r] = np.cumsum((evidence - config.reluctance).T[:, ::-1], axis=1)[:, ::-1]
    at = np.arange(r + 1)
    jump = -config.jump * np.abs(at[:, None] - at)
    best, came = below[0], np.zeros((columns, r + 1), np.int64)
    for c in range(1, columns):
        through = best[:, None] + jump
        came[c] = np.argmax(through, axis=0)
        best = through[came[c], at] + below[c]
    path = np.empty(columns, np.int64)
    path[-1] = np.argmax(best)
    for c in range(columns - 1, 0, -1):
        path[c - 1] = came[c, path[c]]
    tops = np.full(columns, grid.rows, np.int16)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], path < r, [False]]).astype(int)))
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        own = slice(first, last)
        enough = below[np.arange(first, last), path[own]].sum() >= config.least_evidence
        if enough and last - first >= config.least_columns:
            tops[own] = grid.top + path[own]
    return tops if (tops < grid.rows).any() else None
