"""The paper's chain on the free map: road profile (eq. 9-11), roll at fixed disparity (eq. 12), profile again."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.config import ProfileConfig
from stereocalib_core.front.road.profile import Profile, collect, fit_profile, search_profile
from stereocalib_core.front.road.region import Region
from stereocalib_core.front.road.roll_vote import RollVote, vote_roll
from stereocalib_core.geometry import (
    Extrinsics,
    StereoCamera,
    extrinsics_from_profile,
    road_profile,
    roll_from_slope,
    slope_from_roll,
)
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.results import DisparityMap


@dataclass(frozen=True)
class PaperFit:
    """The chain's result. `profile` is the last fit, with roll taken out; `first` the one before."""

    extrinsics: Extrinsics
    covariance: Array
    first: Profile
    profile: Profile
    roll: RollVote | None


def covariance_of(
    camera: StereoCamera, profile: Profile, roll: RollVote, pitch_rad: float, config: ProfileConfig
) -> Array:
    """(3, 3) of height, pitch, roll from those of profile and slope, with what roads add to it."""
    c = np.cos(pitch_rad)
    jacobian = np.array([[camera.baseline_m * c, 0.0], [0.0, -(c**2) / camera.focal_px]])
    result = np.zeros((3, 3))
    result[:2, :2] = jacobian @ profile.covariance @ jacobian.T
    result[2, 2] = c**2 * roll.variance
    systematic = (
        config.systematic_height_m,
        *np.deg2rad([config.systematic_pitch_deg, config.systematic_roll_deg]),
    )
    result += np.diag(np.square(systematic))
    return result


def fit_paper(
    disparity: DisparityMap,
    mask: NDArray[np.bool_],
    camera: StereoCamera,
    config: ProfileConfig,
    single_pass: bool = False,
    start: tuple[float, float, float] | None = None,
) -> PaperFit | None:
    """Profile on the v-disparity of `mask`, roll by eq. 12, profile again with the roll taken out of the rows.

    start: tilt, slope and intercept of the first line; None = looked for among `mask`'s cells.
    `single_pass` keeps the paper's order: pitch and height from the first profile. None without a road.
    """
    wide = collect(
        disparity.values, mask, disparity.step_px, camera.cx_px,
        config.roll_half_width_m / camera.baseline_m, config.min_disparity_px,
    )  # fmt: skip
    inside = np.abs(wide[0] - camera.cx_px) * camera.baseline_m <= config.corridor_half_width_m * wide[2]
    u, v, d = (array[inside] for array in wide)
    start = start or search_profile(u, v, d, camera, config)
    if start is None:
        return None
    tilt, slope, intercept = start
    search = v if single_pass else v - tilt * (u - camera.cx_px)
    first = fit_profile(search, d, (slope, intercept), config.search_relative_tolerance, config)
    if first is None:
        return None
    roll = vote_roll(*wide, disparity.step_px, first, camera, config)
    pitch = extrinsics_from_profile(camera, first.slope, first.intercept_px).pitch_rad
    roll_rad = 0.0 if roll is None else roll_from_slope(roll.slope, pitch)
    profile = first
    if not single_pass and roll is not None:
        for _ in range(2):
            level = v - slope_from_roll(roll_rad, pitch) * (u - camera.cx_px)
            refit = fit_profile(
                level, d, (profile.slope, profile.intercept_px), config.relative_tolerance, config
            )
            if refit is None:
                return None
            profile = refit
            pitch = extrinsics_from_profile(camera, profile.slope, profile.intercept_px).pitch_rad
            roll_rad = roll_from_slope(roll.slope, pitch)
    extrinsics = extrinsics_from_profile(
        camera, profile.slope, profile.intercept_px, 0.0 if single_pass else roll_rad
    )
    extrinsics = Extrinsics(extrinsics.height_m, extrinsics.pitch_rad, roll_rad)
    vote = roll or RollVote(0.0, float(np.deg2rad(3.0)) ** 2, 0, 0)
    return PaperFit(extrinsics, covariance_of(camera, profile, vote, pitch, config), first, profile, roll)


def fit_on_region(
    disparity: DisparityMap, region: Region, camera: StereoCamera, config: ProfileConfig
) -> PaperFit | None:
    """The chain on the cells of the road's region, from its plane."""
    e = region.plane.extrinsics(camera)
    slope, intercept = road_profile(camera, e)
    farthest = camera.focal_px * camera.baseline_m / region.reach.far_m
    scaled = dataclasses.replace(
        config,
        min_disparity_px=farthest,
        roll_min_disparity_px=farthest,
        min_inliers=min(config.min_inliers, region.count // 4 + 1),
    )
    start = slope_from_roll(e.roll_rad, e.pitch_rad), slope, intercept
    return fit_paper(disparity, region.cells, camera, scaled, start=start)
