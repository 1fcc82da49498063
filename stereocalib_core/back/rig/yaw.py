"""The mounting yaw, once per rig: where straight travel leads in the image (eq. 1, exact under pitch, roll).

Each pair of frames on a straight gives a vanishing point of its road tracks; turned into the road frame, its
azimuth is the direction in which the camera travels. A car that turns by dpsi over a distance z carries its
camera, a lever arm L ahead of the rear axle, sideways as well, so that

    azimuth = yaw + dpsi / 2 + L dpsi / z

which is taken out: no road is straight to a hundredth of a degree. A camera also sways sideways, by its height
over the axis of roll, where the road begins to bank; that is taken out likewise. A second RANSAC over the pairs
gives the yaw.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.back.odometry.lever_arm import estimate_lever_and_yaw
from stereocalib_core.back.odometry.packing import PackedTracks
from stereocalib_core.back.odometry.trajectory import (
    Trajectory,
    TrajectorySettings,
    fill_missing,
    trajectory,
)
from stereocalib_core.back.rig.vanishing_point import (
    VanishingPointView,
    vanishing_points,
    view_pair,
)
from stereocalib_core.config import OdometryConfig, VehicleConfig, YawConfig
from stereocalib_core.geometry import road_rotation
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.chunks import in_chunks
from stereocalib_core.numeric.robust import cauchy_weights, mad_sigma
from stereocalib_core.numeric.small_algebra import rotation_from_vector
from stereocalib_core.results import Measured


@dataclass(frozen=True)
class YawEstimate:
    """The mounting yaw of a drive.

    value_rad, sigma_rad: None where `reason` says why there is none. pairs_used: pairs of frames behind it.
    lever_arm_m, lever_arm_sigma_m: rear axle to camera as used. pair_yaw_rad: (N,) what each pair on a
    straight says by itself, its curvature taken out, else NaN. straight: (N,) pairs of straight driving.
    """

    value_rad: float | None
    sigma_rad: float | None
    reason: str | None
    pairs_used: int
    lever_arm_m: float
    lever_arm_sigma_m: float
    pair_yaw_rad: Array
    straight: NDArray[np.bool_]


def _sum_of_five(values: Array) -> Array:
    """(N,) of each value and its two neighbours on either side; also for fewer than five values."""
    return np.convolve(values, np.ones(5), "full")[2 : 2 + len(values)]


def roll_per_metre(tracks: PackedTracks, distance_m: Array, usable: NDArray[np.bool_]) -> Array:
    """(N,) how far the camera rolls to the right per metre of travel, over five pairs; 0 where unknown."""
    # the rotation vector turns points, not the camera
    roll = np.where(usable, -tracks.stereo_motion[:, 2], 0.0)
    travel = _sum_of_five(np.where(usable, distance_m, 0.0))
    return np.asarray(np.where(travel > 0.5, _sum_of_five(roll) / np.maximum(travel, 0.5), 0.0))


def without_sway(
    values: Array, roll: Array, vehicle: VehicleConfig | None = None, config: YawConfig | None = None
) -> Array:
    """(M,) yaw of pairs without the part that goes with (M,) roll per metre; the arm fitted robustly."""
    vehicle, config = vehicle or VehicleConfig(), config or YawConfig()
    pair_sigma = float(np.deg2rad(config.pair_sigma_deg))
    arm, level = vehicle.sway_m, float(np.median(values))
    for _ in range(10):
        residual = values - level - arm * roll
        spread = max(mad_sigma(residual), 1e-7)
        weight = cauchy_weights(residual, spread)
        level = float((weight * (values - arm * roll)).sum() / weight.sum())
        prior = (max(spread, pair_sigma) / vehicle.sway_sigma_m) ** 2
        information = float((weight * roll * roll).sum())
        arm = (float((weight * roll * (values - level)).sum()) + prior * vehicle.sway_m) / (
            information + prior
        )
    return np.asarray(values - arm * roll)


def straight_pairs(
    distance_m: Array, heading_rad: Array, measured: NDArray[np.bool_], config: YawConfig
) -> NDArray[np.bool_]:
    """(N,) pairs within a straight stretch.

    distance_m, heading_rad: (N,) travel and turn of each pair. A stretch is `min_stretch_m` and
    `min_stretch_pairs` long, nowhere curved below `min_radius_m`.
    """
    moving = measured & (distance_m > config.min_travel_m)
    curvature = np.where(moving, heading_rad / np.where(moving, distance_m, 1.0), 0.0)
    smooth = _sum_of_five(np.where(moving, curvature, 0.0)) / np.maximum(
        _sum_of_five(moving.astype(float)), 1.0
    )
    candidate = moving & (np.abs(smooth) < 1.0 / config.min_radius_m)
    result = np.zeros(len(candidate), dtype=bool)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], candidate.astype(int), [0]])))
    for first, end in edges.reshape(-1, 2):
        length = float(distance_m[first:end].sum())
        if end - first >= config.min_stretch_pairs and length >= config.min_stretch_m:
            result[first:end] = True
    return result


def pair_rotations(tracks: PackedTracks) -> Array:
    """(N, 3, 3) R_current_previous of every pair, from the whole scene."""
    return np.array([rotation_from_vector(w) for w in tracks.stereo_motion[:, :3]]).reshape(-1, 3, 3)


def view(tracks: PackedTracks, frame: int, config: YawConfig | None = None) -> VanishingPointView | None:
    """Figure 1c for the pair that ends in `frame`; None where there are no tracks."""
    config = config or YawConfig()
    if tracks.previous[frame] < 0 or tracks.road_end[frame] - tracks.start[frame] < 8:
        return None
    rays = tracks.rays[:, tracks.start[frame] : tracks.road_end[frame]]
    rotation = rotation_from_vector(tracks.stereo_motion[frame, :3])
    return view_pair(tracks.camera, rays, rotation, config)


def estimate_yaw(
    tracks: PackedTracks,
    extrinsics: Array,
    config: YawConfig | None = None,
    lever: Measured | None = None,
    vehicle: VehicleConfig | None = None,
    extrinsics_sigma: Array | None = None,
) -> YawEstimate:
    """The mounting yaw of a drive, or the reason why it shows none.

    extrinsics: (N, 3) height, pitch, roll of every frame, NaN = unknown, with their sigma (N, 3). lever: of
    the rig file, if known; else it is estimated from the drive's own turns.
    """
    config, vehicle = config or YawConfig(), vehicle or VehicleConfig()
    full = np.column_stack([extrinsics[:, :3], np.zeros(len(extrinsics))])
    motion = trajectory(tracks, full, TrajectorySettings(model="full"), extrinsics_sigma)
    turn, distance = motion.planar[:, 2], motion.planar[:, 1]
    usable = motion.measured & (tracks.previous >= 0)
    straight = straight_pairs(distance, turn, usable, config)
    if lever is None:
        lever = _lever(motion, vehicle, tracks.config)
    pairs = np.full(len(tracks), np.nan)

    def refuse(reason: str) -> YawEstimate:
        return YawEstimate(None, None, reason, 0, lever.value, lever.sigma, pairs, straight)

    travelled = float(np.abs(distance[usable]).sum())
    if len(tracks) > 1 and not usable.any():
        return refuse(_unmeasured(tracks))
    if travelled < config.min_stretch_m:
        return refuse(f"the car hardly moves: {travelled:.1f} m of measured travel")
    if straight.sum() < config.min_pairs:
        return refuse(
            f"no straight driving: {int(straight.sum())} of {int(usable.sum())} pairs of frames lie on "
            f"stretches straighter than a radius of {config.min_radius_m:g} m, {config.min_pairs} are needed"
        )
    camera = tracks.camera
    tolerance = config.tolerance_px / camera.focal_px
    found = np.full((len(tracks), 4), np.nan)
    in_chunks(
        vanishing_points, len(tracks),
        tracks.rays, tracks.start, tracks.road_end, pair_rotations(tracks), straight, tolerance,
        config.min_flow_px / camera.focal_px, config.samples, found,
    )  # fmt: skip
    use = straight & (found[:, 2] >= config.min_tracks)
    origin = np.maximum(tracks.previous, 0)
    filled = fill_missing(full)
    to_road = np.swapaxes(road_rotation(filled[:, 1], filled[:, 2]), 1, 2)[origin]
    direction = np.einsum("nij,nj->ni", to_road, np.column_stack([found[:, :2], np.ones(len(found))]))
    with np.errstate(divide="ignore", invalid="ignore"):
        curvature = np.where(use, turn / np.where(use, distance, 1.0), 0.0)
    azimuth = np.arctan2(direction[:, 0], direction[:, 2])
    pairs = np.where(use, azimuth - 0.5 * turn - lever.value * curvature, np.nan)
    if use.any():
        pairs[use] = without_sway(pairs[use], roll_per_metre(tracks, distance, usable)[use], vehicle, config)
    values = pairs[use]
    if len(values) < config.min_pairs:
        return refuse(
            f"too few road tracks on the straights: {len(values)} pairs of frames show a vanishing point, "
            f"at least {config.min_pairs} are needed"
        )
    yaw, inlier, sigma = _consensus(values, config)
    if inlier.sum() < max(config.min_pairs, config.min_inlier_share * len(values)):
        return refuse(
            f"the vanishing points do not agree: {int(inlier.sum())} of {len(values)} pairs of frames"
        )
    by_lever = lever.sigma * float(np.mean(curvature[use][inlier]))
    floor = np.deg2rad(config.systematic_deg)
    sigma = float(np.sqrt(sigma**2 + by_lever**2 + floor**2))
    return YawEstimate(yaw, sigma, None, int(inlier.sum()), lever.value, lever.sigma, pairs, straight)


def _unmeasured(tracks: PackedTracks) -> str:
    """Why no pair of frames shows how far the car went."""
    pairs, followed = len(tracks) - 1, tracks.previous >= 0
    if not tracks.road_ok.any():
        return f"no frame of {len(tracks)} shows the road"
    few = int((followed & (tracks.road_end - tracks.start[:-1] < tracks.config.min_road_points)).sum())
    return (
        f"no travel was measured: of {pairs} pairs of frames {pairs - int(followed.sum())} have no tracks and {few} "
        "too few on the road; steps of several metres from frame to frame are too long for them, so take more frames"
    )


def _lever(motion: Trajectory, vehicle: VehicleConfig, config: OdometryConfig) -> Measured:
    """Rear axle to camera from the drive's turns; the default with a wide sigma where it has none.

    Without turns a regression would read the lever arm from the noise of the headings.
    """
    found = None
    if (
        np.count_nonzero(motion.measured & (np.abs(motion.planar[:, 2]) > config.turn_rad))
        >= config.turn_pairs
    ):
        found = estimate_lever_and_yaw(motion, vehicle, config)
    if found is None or found.lever_arm_sigma_m > vehicle.lever_arm_sigma_m:
        return Measured(vehicle.lever_arm_m, vehicle.lever_arm_sigma_m)
    return Measured(found.lever_arm_m, found.lever_arm_sigma_m)


def _consensus(values: Array, config: YawConfig) -> tuple[float, NDArray[np.bool_], float]:
    """RANSAC over the pairs (every pair is a hypothesis), then a robust mean; value, inliers, sigma."""
    tolerance, alike = np.deg2rad(config.pair_tolerance_deg), config.alike_pairs
    hypotheses = np.sort(values)[:: max(1, len(values) // config.hypotheses)]
    score = [np.maximum(1.0 - ((values - each) / tolerance) ** 2, 0.0).sum() for each in hypotheses]
    centre = float(hypotheses[int(np.argmax(score))])
    inlier = np.abs(values - centre) < tolerance
    for _ in range(config.rounds):
        inside = values[inlier]
        spread = max(mad_sigma(inside, None), 1e-7)
        weight = cauchy_weights(inside - centre, spread)
        centre = float((weight * inside).sum() / weight.sum())
        inlier = np.abs(values - centre) < max(min(tolerance, config.stray_sigmas * spread), 1e-6)
    inside = values[inlier]
    blocks = [inside[i : i + alike].mean() for i in range(0, len(inside) - alike + 1, alike)]
    white = float(np.std(inside)) / np.sqrt(max(len(inside), 1))
    shared = float(np.std(blocks, ddof=1)) / np.sqrt(len(blocks)) if len(blocks) > 1 else white
    return centre, np.asarray(inlier), max(white, shared)
