"""The camera over the road under its own wheels, from the road that it saw there a moment ago.

A stereo pair shows the road ahead. Where that banks, twists or rises against the road under the car, pitch and
roll over it change although neither camera nor body has moved. The odometry carries the planes of earlier
frames to where the car is now, and what remains is mount and springs alone. It is also far less noisy: each
value rests on several planes, and what changes from one frame to the next is the odometry's own rotation.
"""

from __future__ import annotations

import numpy as np

from stereocalib_core.back.rig.body_motion import MotionSeries
from stereocalib_core.config.back import WheelsConfig
from stereocalib_core.geometry import road_rotation
from stereocalib_core.numeric.arrays import Array


def over_wheels(values: Array, motion: MotionSeries, config: WheelsConfig | None = None) -> Array:
    """(N, 3) height [m], pitch, roll [rad] over the road under the wheels; NaN where it was not seen before.

    values: (N, 3) over the road ahead, NaN = unknown. Without poses in `motion` there is nothing to carry the
    planes with, and `values` are given back.
    """
    config = config or WheelsConfig()
    if motion.poses is None or len(values) < 2:
        return values
    tracked = np.ones(len(values), dtype=bool) if motion.tracked is None else motion.tracked
    R, position = motion.poses[:, :3, :3], motion.poses[:, :3, 3]
    travelled = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(position, axis=0), axis=1))])
    breaks = np.cumsum(~tracked)
    height, pitch, roll = values.T
    # contiguous: einsum sums strided arrays in another order, and the last bits would differ
    down = np.ascontiguousarray(road_rotation(pitch, roll)[:, :, 1])
    normal = np.einsum("nij,nj->ni", R, down)
    offset = np.einsum("ni,ni->n", normal, position) + height
    known = np.asarray(np.isfinite(values).all(axis=1))
    first = np.searchsorted(travelled, travelled - (config.ahead_m + config.half_m))
    stop = np.searchsorted(travelled, travelled - (config.ahead_m - config.half_m))
    result = np.full(values.shape, np.nan)
    for i in range(len(values)):
        j = np.arange(first[i], stop[i])
        j = j[known[j] & (breaks[j] == breaks[i])]
        if len(j) < config.min_planes:
            continue
        mean = normal[j].mean(axis=0)
        x, y, z = R[i].T @ (mean / np.linalg.norm(mean))
        result[i] = np.mean(offset[j] - normal[j] @ position[i]), np.arctan2(z, y), -np.arcsin(x)
    return result
