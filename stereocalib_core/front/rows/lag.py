"""Were left and right taken at once? The right pictures of neighbouring frames are tried in place of a frame's own.

In a car that moves, what one camera saw a frame earlier or later lies on other rows, so fewer corners find their
partner on their own row. A list of pictures that is shifted by a frame therefore matches better when it is shifted
back. A car that stands shows nothing: every shift matches alike.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.config import LagConfig, RectificationConfig
from stereocalib_core.front.rows.row_matches import row_matches
from stereocalib_core.geometry import StereoCamera
from stereocalib_core.numeric.arrays import Array


def lags_of(config: LagConfig) -> tuple[int, ...]:
    """Frames by which the right pictures are tried later, in order; 0 is in the middle."""
    return tuple(range(-config.most, config.most + 1))


def matches_by_lag(
    camera: StereoCamera,
    left: NDArray[np.uint8],
    rights: list[NDArray[np.uint8]],
    config: RectificationConfig,
) -> Array:
    """(K,) matches on their own rows of one left picture with each of K right ones, all (H, W) uint8."""
    offset = camera.disparity_offset_px
    far, near = offset - 0.4 * config.search_px, offset + config.search_px
    return np.array([float(len(row_matches(left, right, far, near).points)) for right in rights])


def lag_of(matches: Array, config: LagConfig) -> int | None:
    """The lag that (N, lags) matches of N frames agree on; None where it is none, or not sure.

    Sure is: more matches in all, beyond what counts scatter by (Poisson), and in three of four frames by themselves.
    """
    if len(matches) < 2:
        return None
    total, own = matches.sum(axis=0), config.most
    best = int(np.argmax(total))
    more = total[best] - total[own]
    scatter = np.sqrt(config.alike * (total[best] + total[own]))
    agree = float(np.mean(matches[:, best] > matches[:, own]))
    sure = more > config.sigmas * scatter and agree >= config.share
    return best - own if best != own and sure else None
