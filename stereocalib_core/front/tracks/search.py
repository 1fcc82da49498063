"""A first guess of the motion when nothing predicts it: at the start, after a jump, when tracks fail.

Speeds and turns are tried in turn on the quarter-size pictures; the one under which most patches look alike
is the start of the tracking proper, which needs to be right to within a few pixels only.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from stereocalib_core.config.tracks import MotionSearchConfig
from stereocalib_core.front.tracks.pair_motion import reprojection
from stereocalib_core.geometry import StereoCamera
from stereocalib_core.numeric.arrays import Array, Grey

_HALF = MotionSearchConfig().half_px
"""Compiled in."""


def speeds_m(config: MotionSearchConfig, wide: bool = False) -> list[float]:
    """Travel per frame that is tried [m]; `wide`: what lies beyond the usual."""
    if wide:
        return np.arange(config.fast_m, config.widest_m, config.fast_step_m).tolist()
    slow = np.arange(0.0, config.slow_m, config.slow_step_m)
    return np.concatenate([slow, np.arange(config.slow_m, config.fast_m, config.fast_step_m)]).tolist()


def to_both_sides(values: tuple[float, ...]) -> list[float]:
    """Nothing, and each value to either side, in radians from degrees."""
    return np.deg2rad([0.0, *(sign * value for value in values for sign in (-1.0, 1.0))]).tolist()


@njit(cache=True, nogil=True)
def _likeness(before: Grey, after: Grey, u: float, v: float, x: float, y: float) -> float:
    """Correlation of two patches of the quarter-size pictures about whole pixels, 0 where it is bad."""
    j, i, c, r = int(np.round(u)), int(np.round(v)), int(np.round(x)), int(np.round(y))
    height, width = before.shape
    if j < _HALF or i < _HALF or j >= width - _HALF or i >= height - _HALF:
        return 0.0
    if c < _HALF or r < _HALF or c >= width - _HALF or r >= height - _HALF:
        return 0.0
    a = b = aa = bb = ab = 0.0
    for dr in range(-_HALF, _HALF + 1):
        for dc in range(-_HALF, _HALF + 1):
            p, q = np.float64(before[i + dr, j + dc]), np.float64(after[r + dr, c + dc])
            a += p
            b += q
            aa += p * p
            bb += q * q
            ab += p * q
    n = (2 * _HALF + 1) ** 2
    variance = (aa - a * a / n) * (bb - b * b / n)
    if variance <= 1.0:
        return 0.0
    return max(0.0, (ab - a * b / n) / np.sqrt(variance))


@njit(cache=True, nogil=True)
def _scores(
    before: Grey, after: Grey, rays: Array, candidates: Array, focal_px: float, cx_px: float, cy_px: float
) -> Array:
    """(C,) sum of squared likeness of all points under each candidate motion."""
    result = np.zeros(len(candidates))
    for m in range(len(candidates)):
        seen = reprojection(rays, candidates[m])
        total = 0.0
        for k in range(rays.shape[1]):
            u = (rays[0, k] * focal_px + cx_px + 0.5) / 4 - 0.5
            v = (rays[1, k] * focal_px + cy_px + 0.5) / 4 - 0.5
            x = (seen[0, k] * focal_px + cx_px + 0.5) / 4 - 0.5
            y = (seen[1, k] * focal_px + cy_px + 0.5) / 4 - 0.5
            total += _likeness(before, after, u, v, x, y) ** 2
        result[m] = total
    return result


def search_motion(
    before: Grey,
    after: Grey,
    rays: Array,
    on_road: NDArray[np.bool_],
    camera: StereoCamera,
    last: Array | None,
    jump: int,
    config: MotionSearchConfig | None = None,
    wide: bool = False,
) -> Array:
    """(6,) motion (rotation vector [rad], translation [m] of T_current_previous) that looks best.

    before, after: quarter-size pictures. rays: (5, N) as in `PackedTracks`. last: (6,) motion per frame or None.
    jump: frames between the two pictures. wide: look beyond the usual steps.
    """
    config = config or MotionSearchConfig()
    road, above = np.flatnonzero(on_road), np.flatnonzero(~on_road)
    pick = np.concatenate([_thin(road, config.points // 2), _thin(above, config.points // 2)])
    chosen = np.ascontiguousarray(rays[:, pick])
    motions = [] if last is None or wide else [last * factor * jump for factor in (1.0, 0.0, *config.factors)]
    # T_current_previous of a move straight ahead, turned to the right by `turn`
    motions += [
        np.array([0.0, -turn * jump, 0.0, 0.0, 0.0, -speed * jump])
        for turn in to_both_sides(config.turns_deg)
        for speed in speeds_m(config, wide)
    ]
    candidates = np.array(motions)
    scores = _scores(before, after, chosen, candidates, camera.focal_px, camera.cx_px, camera.cy_px)
    best = candidates[int(np.argmax(scores))]
    # a finer look around the best: pitch moves everything by several pixels over a bump
    shifts = np.sort(to_both_sides(config.fine_deg))
    fine = np.array(
        [
            best + [pitch, turn, 0.0, 0.0, 0.0, speed]
            for pitch in shifts
            for turn in shifts
            for speed in (-config.fine_m * jump, 0.0, config.fine_m * jump)
        ]
    )
    scores = _scores(before, after, chosen, fine, camera.focal_px, camera.cx_px, camera.cy_px)
    return np.asarray(fine[int(np.argmax(scores))])


def _thin(indices: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """At most `count` of them, evenly."""
    if len(indices) <= count:
        return indices
    return indices[np.linspace(0, len(indices) - 1, count).astype(np.int64)]
