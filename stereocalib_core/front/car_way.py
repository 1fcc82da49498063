"""Where the car goes, by the motion between the last two pairs: the arc ahead, and where straight ahead is."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from stereocalib_core.config import RegionConfig
from stereocalib_core.config.vehicle import USUAL_HEIGHT_M
from stereocalib_core.front.road.candidates import Way
from stereocalib_core.geometry import Extrinsics, transform
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.small_algebra import rotation_from_vector


def curvature_of(
    motion: Array | None, height_m: float = USUAL_HEIGHT_M, config: RegionConfig | None = None
) -> float:
    """[1/m] of the car's way, positive to the right; motion: (6,) of T_current_previous. 0 where it hardly moves.

    A car that backs up has the arc ahead that it came along.
    """
    least_travel_m = (config or RegionConfig()).least_travel * height_m
    if motion is None or abs(motion[5]) < least_travel_m:
        return 0.0
    return float(motion[1] / motion[5])


def way_of(motion: Array | None, height_m: float, config: RegionConfig) -> Way:
    """The arc ahead; motion: (6,) of T_current_previous. Straight along the optical axis where the car hardly moves.

    The translation is the arc's chord: seen from the camera now, its tangent is turned on by half of the turn.
    """
    if motion is None or abs(motion[5]) < config.least_travel * height_m:
        return Way()
    slope = motion[3] / motion[5] - 0.5 * motion[1]
    curvature = curvature_of(motion, height_m, config)
    most, sharpest = config.most_slope, config.most_curvature_per_m
    return Way(float(np.clip(slope, -most, most)), float(np.clip(curvature, -sharpest, sharpest)))


def carried_on(roads: Iterable[Extrinsics | None], motion: Array) -> list[Extrinsics | None]:
    """Roads seen from the previous pair as they are seen from the one after; motion: (6,) of T_current_previous."""
    T = transform(rotation_from_vector(motion[:3]), motion[3:])
    return [None if road is None else Extrinsics.from_plane(road.plane().transformed(T)) for road in roads]


def heading_of(motion: Array | None, height_m: float, config: RegionConfig) -> float | None:
    """x / z of where the car points, seen from the camera, by a pair that drives straight; None: it does not."""
    if motion is None or abs(motion[5]) < config.least_travel * height_m:
        return None
    if abs(curvature_of(motion, height_m, config)) > config.straight_per_m:
        return None
    return way_of(motion, height_m, config).slope
