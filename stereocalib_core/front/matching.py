"""Dense disparity of a rectified pair: what a matcher is, which ones there are by name, and ours.

Ours is semi-global matching as OpenCV has it, with exact pixel centres.
"""

from __future__ import annotations

import hashlib
import importlib
import threading
from collections import OrderedDict
from collections.abc import Hashable
from concurrent.futures import Future
from functools import lru_cache
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from stereocalib_core.config import DisparityConfig
from stereocalib_core.errors import ConfigError
from stereocalib_core.front.semi_global import paths
from stereocalib_core.front.sight import matching_step
from stereocalib_core.geometry import StereoCamera
from stereocalib_core.numeric.arrays import Grey
from stereocalib_core.results import DisparityMap

_SUBPIXEL = 16.0
UNKNOWN_PX = 128.0
"""Searched where nothing says how near the road comes."""


class Matcher(Protocol):
    """Gives the dense disparity of a rectified pair. Safe from several threads, and the same for the same pair.

    left, right: (H, W) uint8 grey. The map holds geometric disparity in full-resolution pixels (the camera's
    `disparity_offset_px` taken off), NaN where there is none, on a grid of whole picture pixels.
    step: picture pixels per cell that are wished, farthest_px: the largest disparity that is needed; None = as
    `config` has it. A matcher may do better than either. The pictures may be part of a pair, the rows below its
    horizon or above, and `camera` that part's: see `front.horizon`. Two pairs may be matched at once.
    """

    def __call__(
        self,
        left: Grey,
        right: Grey,
        camera: StereoCamera,
        config: DisparityConfig,
        step: int | None = None,
        farthest_px: float | None = None,
    ) -> DisparityMap: ...


def find_matcher(name: str) -> Matcher:
    """A matcher by its name in `MATCHERS`, or by `MODULE:NAME` of a Python module; raises ConfigError."""
    if name in MATCHERS:
        return MATCHERS[name]
    module, _, attribute = name.partition(":")
    known = f"known are {' '.join(MATCHERS)}, and MODULE:NAME of a Python module"
    if not attribute:
        raise ConfigError("unknown matcher", name, known)
    try:
        found = getattr(importlib.import_module(module), attribute)
    except (ImportError, AttributeError, ValueError) as error:
        raise ConfigError("matcher cannot be loaded", name, f"{error}; {known}") from error
    matcher: Matcher = found() if isinstance(found, type) else found
    if not callable(matcher):
        raise ConfigError("no matcher", name, "name a class or a function that takes a pair")
    return matcher


class MatchedOnce:
    """A matcher that remembers its latest maps: several who look at one pair share one. Safe from any thread."""

    def __init__(self, matcher: Matcher, maps: int = 48) -> None:
        self._matcher, self._most = matcher, maps
        self._maps: OrderedDict[Hashable, Future[DisparityMap]] = OrderedDict()
        self._lock = threading.Lock()

    def __call__(
        self,
        left: Grey,
        right: Grey,
        camera: StereoCamera,
        config: DisparityConfig,
        step: int | None = None,
        farthest_px: float | None = None,
    ) -> DisparityMap:
        """The map of the pair, made by the first who asks."""
        pictures = [hashlib.blake2b(p.tobytes(), digest_size=16).digest() for p in (left, right)]
        key = (*pictures, left.shape, camera, config, step, farthest_px)
        with self._lock:
            found = self._maps.get(key)
            mine: Future[DisparityMap] = Future()
            if found is None:
                self._maps[key] = mine
                while len(self._maps) > self._most:
                    self._maps.popitem(last=False)
        if found is not None:
            return found.result()
        try:
            mine.set_result(self._matcher(left, right, camera, config, step, farthest_px))
        except BaseException as error:
            mine.set_exception(error)
            with self._lock:
                self._maps.pop(key, None)
            raise
        return mine.result()


@lru_cache(maxsize=16)
def _matcher(_thread: int, first: int, count: int, config: DisparityConfig) -> Any:
    """OpenCV's own, for blocks and penalties that are beyond 16 bits here.

    One per thread: a matcher keeps its buffers, and two threads on one would corrupt each other's map."""
    return cv2.StereoSGBM.create(
        minDisparity=first,
        numDisparities=count,
        blockSize=config.block_size,
        P1=config.small_step_penalty,
        P2=config.large_step_penalty,
        mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )


def shrunk(image: NDArray[np.uint8], step: int) -> NDArray[np.uint8]:
    """(H, W) to (H // step, W // step) by means; what is left over is cut, so that cell centres are exact."""
    if step == 1:
        return image
    height, width = image.shape[0] // step, image.shape[1] // step
    whole = image[: height * step, : width * step]
    return np.asarray(cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA), dtype=np.uint8)


def compute(
    left: Grey,
    right: Grey,
    camera: StereoCamera,
    config: DisparityConfig,
    step: int | None = None,
    farthest_px: float | None = None,
) -> DisparityMap:
    """The `Matcher` by semi-global matching.

    step, farthest_px: None = `config`'s; where that leaves them open, as the camera has it, and `UNKNOWN_PX`.
    """
    step = matching_step(camera, config) if step is None else step
    if farthest_px is None:
        farthest_px = UNKNOWN_PX if config.max_disparity_px == "auto" else config.max_disparity_px
    left, right = shrunk(left, step), shrunk(right, step)
    offset = camera.disparity_offset_px
    first = int(np.floor(offset / step))
    wanted = int(np.ceil(farthest_px / step / 16)) * 16
    # The matcher needs some columns that see the whole search range; narrow pictures are searched less far.
    count = min(wanted, (left.shape[1] - abs(first) - 8) // 16 * 16)
    if count < 16:
        return DisparityMap(np.full(left.shape, np.nan, np.float32), step)
    block, small, large = config.block_size, config.small_step_penalty, config.large_step_penalty
    if paths.fits(block, small, large):
        raw = paths.match(left, right, first, count, block, small, large)
    else:
        raw = _matcher(threading.get_ident(), first, count, config).compute(left, right)
    scale = np.float32(step / _SUBPIXEL)
    values = raw.astype(np.float32)
    values *= scale
    values -= np.float32(offset)
    values[raw <= first * int(_SUBPIXEL)] = np.nan
    return DisparityMap(values, step)


MATCHERS: dict[str, Matcher] = {"sgbm": compute}
"""The matchers by the names that settings and `--matcher` give them."""
