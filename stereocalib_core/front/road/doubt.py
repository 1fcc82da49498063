"""Is it the road? A region held against the road carried along, and what is left of doubt as uncertainty."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.config import DirectConfig, PipelineConfig, RegionConfig
from stereocalib_core.front.road.candidates import Way
from stereocalib_core.front.road.carried import Moved, Past, nearest_of, step_of
from stereocalib_core.front.road.region import Region
from stereocalib_core.geometry import Extrinsics, StereoCamera


def step_m(
    region: Region, carried: Extrinsics, camera: StereoCamera, moved: Moved, config: RegionConfig
) -> float | None:
    """How much higher [m] a region lies than the road carried along, where a kerb lies between; None: none does.

    Both lean alike, but one is higher. After every stretch the road's slope is another, and a body that a hump has set
    swinging tilts the road carried along: what either makes of the near road is no kerb.
    """
    found = region.plane.extrinsics(camera)
    leaning_since = config.carried_pitch_rad * moved.travel_m / carried.height_m
    lever_m = config.near_length * nearest_of(carried, camera)
    step = step_of(found, carried, camera, config)
    kerb = np.hypot(config.kerb, 2.0 * leaning_since) + abs(moved.swing_rad) * lever_m / carried.height_m
    alike = bool(np.abs(leaning(found, carried, config)).max() < 1.0)
    return -step * carried.height_m if abs(step) > kerb and alike else None


def leans(region: Region, carried: Extrinsics, camera: StereoCamera, config: RegionConfig) -> bool:
    """Whether a region that is small leans from the road carried along, as one that reaches over a kerb does."""
    off = leaning(region.plane.extrinsics(camera), carried, config)
    return region.share < config.leans_below and bool(np.abs(off).max() > 2.0)


def leaning(found: Extrinsics, carried: Extrinsics, config: RegionConfig) -> NDArray[np.float64]:
    """(2,) how a road leans from the one carried along, in pitch and roll [sigma]."""
    off = np.array([found.pitch_rad - carried.pitch_rad, found.roll_rad - carried.roll_rad])
    return off / [config.carried_pitch_rad, config.carried_roll_rad]


def beside_the_step(
    region: Region | None, carried: Extrinsics, camera: StereoCamera, moved: Moved, config: RegionConfig
) -> Region | None:
    """The region about the road carried along; None where that too is beyond a kerb, or hardly seen."""
    if region is None or region.share < config.least_share_carried:
        return None
    return region if step_m(region, carried, camera, moved, config) is None else None


def alone(region: Region, past: Past, config: DirectConfig) -> tuple[float, float]:
    """1 sigma of pitch and roll [rad] that a pair with nothing before it took another plane for its road; or with
    nothing but what the car has seen from where it stands.

    By how little of the lane is on the plane: on one side of a crown, on a bank of snow, or over a pavement.
    """
    if past.known and past.driven:
        return 0.0, 0.0
    none, full = config.alone_planar
    doubt = float(np.clip((none - region.planar) / (none - full), 0.0, 1.0))
    return doubt * config.alone_pitch_rad, doubt * config.alone_roll_rad


def in_doubt(found: Extrinsics, region: Region, past: Past, settings: PipelineConfig) -> tuple[float, float]:
    """1 sigma of pitch and roll [rad] of not being the road at all: of a small region, by how much it disagrees
    with the road carried along."""
    config = settings.region
    if past.carried is None or region.share >= config.leans_below:
        return 0.0, 0.0
    beyond = np.maximum(np.abs(leaning(found, past.carried, config)) - 1.0, 0.0)
    return float(beyond[0] * config.carried_pitch_rad), float(beyond[1] * config.carried_roll_rad)


def crossfalls(region: Region, way: Way, settings: PipelineConfig) -> tuple[float, tuple[float, float]]:
    """1 sigma of roll [rad] by a crossfall that the region does not show, and of height [m] and pitch [rad] by it.

    way: of the car. What is seen straight ahead goes over into the lane of a turn, and so does what is along the car.
    """
    config = settings.direct
    # Where much of the lane ahead is seen and lies off the plane, the plane is one side of a crown, or of a kerb.
    other = config.other_side_rad * (1.0 - region.planar) ** 3
    if region.strip.curvature_per_m != 0.0:
        crossfall = float(np.hypot(other, config.turning_roll_rad))
        return crossfall, along_car(crossfall, region.strip, region.range_m)
    turn = float(np.clip(2.0 - region.share / settings.region.min_share_ahead, 0.0, 1.0))
    unseen = float(np.hypot(other, turn * config.turning_roll_rad))
    return float(other), along_car(unseen, way, region.range_m)


def along_car(crossfall_rad: float, way: Way, range_m: tuple[float, float]) -> tuple[float, float]:
    """1 sigma of height [m] and pitch [rad]: what a crossfall ahead is along the car, where it turns to it or from it.

    The slope grows from none at the car's own road: half of it on the average, and the surface, which bends, is at
    the car about half of the way nearer to the plane than the plane's own slope has it.
    """
    middle = 0.5 * (range_m[0] + range_m[1])
    turned = min(abs(way.slope + way.curvature_per_m * middle), 0.5 * np.pi)
    pitch = 0.5 * crossfall_rad * float(np.sin(turned))
    return 0.5 * middle * pitch, pitch
