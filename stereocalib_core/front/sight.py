"""What a camera can tell of a road, from the camera itself: how finely to match, how far the disparity reaches, and
between which distances a road can be measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stereocalib_core.config import DisparityConfig, LimitsConfig, SightConfig
from stereocalib_core.geometry import DisparityPlane, Extrinsics, StereoCamera

STEPS = (1, 2, 4, 8)


@dataclass(frozen=True)
class Reach:
    """Road distances [m] between which a plane is looked at: the nearest in the picture, and the farthest worth it."""

    near_m: float
    far_m: float


def matching_step(camera: StereoCamera, config: DisparityConfig) -> int:
    """Picture pixels per cell of the disparity grid: the finest that keeps within the cells that time allows."""
    if config.scale != "auto":
        return int(config.scale)
    pixels = camera.width * camera.height
    return next((step for step in STEPS if pixels <= config.most_cells * step**2), STEPS[-1])


def noise_px(step_px: int, config: SightConfig) -> float:
    """1 sigma of the matcher's disparity [full-resolution px] where it matches on a grid of `step_px`."""
    return config.matcher_noise * step_px


def widest_disparity(camera: StereoCamera, limits: LimitsConfig, config: SightConfig) -> float:
    """Disparity [px] of the nearest road that can be in the picture: lowest camera, steepest tilt.

    The camera stands at least `min_height_m` high, and higher than `heights_per_baseline` baselines: a wider pair
    is mounted higher, or its pictures would have no road in common.
    """
    height_m = max(limits.min_height_m, config.heights_per_baseline * camera.baseline_m)
    rows = camera.height - 1.0 - camera.cy_px + camera.focal_px * np.tan(limits.max_pitch_rad)
    return float(min(camera.baseline_m / height_m * max(rows, 0.0), config.most_of_width * camera.width))


def road_disparity(camera: StereoCamera, road: Extrinsics) -> float:
    """Largest disparity [px] of a known road: at the lower edge of the picture."""
    plane = road.disparity_plane(camera)
    ends = [0.0, camera.width - 1.0]
    return float(np.max(plane.disparity(camera, ends, [camera.height - 1.0] * 2)))


def reach_of(camera: StereoCamera, plane: DisparityPlane, step_px: int, config: SightConfig) -> Reach:
    """How near and how far the road of `plane` [disparity space] is to be looked at.

    Near: where it comes into the picture. Far: where the matcher's noise is `most_noise` of the disparity (so much
    of the camera's height it is in height) or the lane ends, but at least `least_reach` near ends; and no farther
    than where it leaves a picture that looks down.
    """
    fb = camera.focal_px * camera.baseline_m
    bottom = plane.a * (camera.height - 1.0 - camera.cy_px) + plane.c_px
    top = plane.a * -camera.cy_px + plane.c_px
    near_m = fb / max(bottom, 1e-6)
    by_noise = fb * config.most_noise / noise_px(step_px, config)
    far_m = max(min(by_noise, config.lane_far_m), config.least_reach * near_m)
    return Reach(near_m, min(far_m, fb / top) if top > 0 else far_m)
