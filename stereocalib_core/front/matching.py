"""Dense disparity of a rectified pair by semi-global matching, with exact pixel centres."""

from __future__ import annotations

import threading
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereocalib_core.config import DisparityConfig
from stereocalib_core.front.road.stages import DisparityMap
from stereocalib_core.geometry import StereoCamera

_SUBPIXEL = 16.0


@lru_cache(maxsize=16)
def _matcher(_thread: int, first: int, count: int, config: DisparityConfig) -> Any:
    """One per thread: a matcher keeps its buffers, and two threads on one would corrupt each other's map."""
    return cv2.StereoSGBM.create(
        minDisparity=first,
        numDisparities=count,
        blockSize=config.block_size,
        P1=config.small_step_penalty,
        P2=config.large_step_penalty,
        mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )


def half_size(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(H, W) to (H // 2, W // 2) by 2x2 means; an odd last row or column is cut, so that cell centres are exact."""
    even = image[: image.shape[0] // 2 * 2, : image.shape[1] // 2 * 2]
    return np.asarray(
        cv2.resize(even, (even.shape[1] // 2, even.shape[0] // 2), interpolation=cv2.INTER_AREA),
        dtype=np.uint8,
    )


def compute(
    left: NDArray[np.uint8], right: NDArray[np.uint8], camera: StereoCamera, config: DisparityConfig
) -> DisparityMap:
    """(H, W) uint8 grey images to a `DisparityMap` of geometric disparity in full-resolution pixels."""
    step = config.scale
    if step == 2:
        left, right = half_size(left), half_size(right)
    offset = camera.disparity_offset_px
    first = int(np.floor(offset / step))
    wanted = int(np.ceil(config.max_disparity_px / step / 16)) * 16
    # The matcher needs some columns that see the whole search range; narrow pictures are searched less far.
    count = min(wanted, (left.shape[1] - abs(first) - 8) // 16 * 16)
    if count < 16:
        return DisparityMap(np.full(left.shape, np.nan, np.float32), step)
    raw = _matcher(threading.get_ident(), first, count, config).compute(left, right)
    scale = np.float32(step / _SUBPIXEL)
    values = raw.astype(np.float32)
    values *= scale
    values -= np.float32(offset)
    values[raw <= first * int(_SUBPIXEL)] = np.nan
    return DisparityMap(values, step)
