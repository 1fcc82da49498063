"""One look: does a block of the picture stand, or does it move on as the road; and does it lie on the road?"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from stereocalib_core.config import OwnCarConfig
from stereocalib_core.front.own_car.place import Grid
from stereocalib_core.geometry import Extrinsics, StereoCamera
from stereocalib_core.numeric.arrays import Array, Grey, Mask


@dataclass(frozen=True)
class Small:
    """A shrunk picture. light: (h, w) float32 grey levels, their mean about each pixel. detail: what is left of it."""

    light: NDArray[np.float32]
    detail: NDArray[np.float32]

    @classmethod
    def of(cls, picture: Grey, grid: Grid, config: OwnCarConfig) -> Small:
        """Of (H, W) grey levels."""
        h, w = picture.shape[0] // grid.by, picture.shape[1] // grid.by
        small = cv2.resize(picture[: h * grid.by, : w * grid.by], (w, h), interpolation=cv2.INTER_AREA)
        grey = small.astype(np.float32)
        light = np.asarray(cv2.blur(grey, config.detail), dtype=np.float32)
        return cls(light, grey - light)


@njit(cache=True, nogil=True)
def _shade(
    detail: NDArray[np.float32], light: NDArray[np.float32], u: float, v: float, under: float
) -> float:
    """The detail at (u, v) as it is where the light is `under`: twice the light is twice the detail."""
    i, j = int(v), int(u)
    a, b = v - i, u - j
    value = (1.0 - a) * ((1.0 - b) * detail[i, j] + b * detail[i, j + 1]) + a * (
        (1.0 - b) * detail[i + 1, j] + b * detail[i + 1, j + 1]
    )
    return value * (under + 1.0) / (light[int(v + 0.5), int(u + 0.5)] + 1.0)


@njit(cache=True, nogil=True)
def look_at(
    now: NDArray[np.float32], light: NDArray[np.float32],
    before: NDArray[np.float32], light_before: NDArray[np.float32],
    long_before: NDArray[np.float32], light_long_before: NDArray[np.float32],
    H: Array, block: tuple[int, int], top: int, noise: tuple[float, float], most: float, least_shift: float,
    found: NDArray[np.float64], seen: Mask,
) -> None:  # fmt: skip
    """Fills `found` (r, C) with how much rather a block stood than moved as the road [log likelihood], and `seen`."""
    w, h = block
    rows, columns = found.shape
    height, width = now.shape
    for r in range(rows):
        for c in range(columns):
            total, n = 0.0, 0
            for y in range((r + top) * h, (r + top + 1) * h):
                for x in range(c * w, (c + 1) * w):
                    q = H[2, 0] * x + H[2, 1] * y + H[2, 2]
                    if q <= 0.0:
                        continue
                    u = (H[0, 0] * x + H[0, 1] * y + H[0, 2]) / q
                    v = (H[1, 0] * x + H[1, 1] * y + H[1, 2]) / q
                    if not (0.0 <= u < width - 1.0 and 0.0 <= v < height - 1.0):
                        continue
                    if abs(u - x) + abs(v - y) < least_shift:
                        continue
                    road = _shade(before, light_before, u, v, light[y, x])
                    own = long_before[y, x] * (light[y, x] + 1.0) / (light_long_before[y, x] + 1.0)
                    sigma = noise[0] + noise[1] * light[y, x]
                    moved = min(abs(now[y, x] - road) / sigma, most)
                    stood = min(abs(now[y, x] - own) / sigma, most)
                    total += 0.5 * (moved * moved - stood * stood)
                    n += 1
            seen[r, c] = 2 * n > w * h
            found[r, c] = total / n if seen[r, c] else 0.0


@njit(cache=True, nogil=True)
def depths(
    left: NDArray[np.float32], light: NDArray[np.float32],
    right: NDArray[np.float32], light_right: NDArray[np.float32],
    own: Mask, block: tuple[int, int], top: int, plane: Array, offset: float, times: Array,
    noise: tuple[float, float], most: float,
) -> Array:  # fmt: skip
    """(K,) by how much the own blocks differ from the right picture at so many `times` the road's disparity, summed
    over blocks [log likelihood]. plane: disparity [shrunk px] by column, row and 1."""
    w, h = block
    rows, columns = own.shape
    height, width = left.shape
    off = np.zeros(len(times))
    for r in range(rows):
        for c in range(columns):
            if not own[r, c]:
                continue
            last = plane[0] * c * w + plane[1] * (r + top) * h + plane[2]
            if last <= 0.0 or c * w - last * times.max() - abs(offset) < 0.0:
                continue
            for k in range(len(times)):
                for y in range((r + top) * h, min((r + top + 1) * h, height - 1)):
                    for x in range(c * w, (c + 1) * w):
                        u = x - times[k] * (plane[0] * x + plane[1] * y + plane[2]) - offset
                        if 0.0 <= u < width - 1.0:
                            seen = _shade(right, light_right, u, float(y), light[y, x])
                            sigma = noise[0] + noise[1] * light[y, x]
                            e = min(abs(left[y, x] - seen) / sigma, most)
                            off[k] += 0.5 * e * e / (w * h)
    return off


def road_homography(camera: StereoCamera, by: int, road: Extrinsics, T: Array) -> Array:
    """(3, 3) from shrunk pixels of this picture to those of the one before, of the road.

    T: (4, 4) T_current_before.
    """
    back = np.linalg.inv(T)
    plane = road.plane()
    H = back[:3, :3] + np.outer(back[:3, 3], plane.normal) / plane.offset_m
    # the centre of shrunk pixel j is u = by (j + 0.5) - 0.5
    K = np.array(
        [
            [camera.focal_px / by, 0.0, (camera.cx_px + 0.5) / by - 0.5],
            [0.0, camera.focal_px / by, (camera.cy_px + 0.5) / by - 0.5],
            [0.0, 0.0, 1.0],
        ]
    )
    return np.asarray(K @ H @ np.linalg.inv(K))
