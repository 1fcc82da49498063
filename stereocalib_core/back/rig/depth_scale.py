"""The scale of the pair's depths (focal length times baseline) against something that has metres of its own.

By LiDAR: on smooth surfaces the scan predicts a disparity d, the pair measures m (`front.scan.scan_disparity`). A pair
whose focal length times baseline is truly k times as calibrated, and whose right camera is turned by a yaw, shows

    m = k d - f yaw (1 + x^2)

so that near and far surfaces tell the two apart. Between the two stands how well LiDAR and camera are placed: 2 cm of
height look like 1 % of scale on a road, since a road's disparity goes with one over its height. So the placement is
kept in the balance, as unknown by `pose_angle_deg` and `pose_m` (Schmidt's considered parameters: not estimated, since
scale and offset would drain into them, but paid for in sigma). What jitters from scan to scan (a body that pitches
between laser and shutter) is estimated for every scan, and so is how much of the car's motion, turning included, a
scan shows smeared while it is swept.

Rows are measured anew in every frame, but a rigid pair has the same ones in all: by how much a frame's own differ from
their mean moves all slanted things of that scan alike (`front.tracks.row_patches.row_leans`), and is put right. A
sample counts by what is known of its noise: a LiDAR's range error is d^2 of it in disparity, its pointing goes with the
slope of the surface, and a match has its own.

By the path of a truth or a GNSS: its steps against those of the tracked points, once the yaw is taken out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.back.rig.yaw_solution import YawSolution
from stereocalib_core.config.pair import PairConfig
from stereocalib_core.geometry import StereoCamera
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.robust import mad_sigma
from stereocalib_core.results import Measured, RectificationSample

GLOBAL = 3
"""Unknowns of the drive: disparity offset [px], scale less one, share of the sweep's time that moves points."""
JITTER = 3
"""Unknowns of each scan: small rotations of the LiDAR about the camera's axes [rad]."""


@dataclass(frozen=True)
class LidarDisparity:
    """What the LiDAR says of the pair. offset_px: to be added to measured disparities; scale: true / assumed depth.

    covariance: (2, 2) of both. scans: how many. halves: (2, 2) offset [px] and scale by the odd and the even scans.
    noise_px: of a usual sample.
    """

    offset_px: float
    scale: float
    covariance: Array
    scans: int
    halves: Array
    noise_px: float

    @property
    def offset(self) -> Measured:
        """The offset [px] with its sigma."""
        return Measured(self.offset_px, float(np.sqrt(self.covariance[0, 0])))

    def scale_given(self, offset: Measured | None) -> Measured:
        """The scale, also by an offset [px] that somebody else measured: the two go together in sigma."""
        sigma2, cross = self.covariance[1, 1], self.covariance[0, 1]
        if offset is None:
            return Measured(self.scale, float(np.sqrt(sigma2)))
        gain = cross / (self.covariance[0, 0] + offset.sigma**2)
        value = self.scale + gain * (offset.value - self.offset_px)
        return Measured(float(value), float(np.sqrt(sigma2 - gain * cross)))


def lidar_disparity(
    camera: StereoCamera,
    samples: Sequence[NDArray[np.float32]],
    motions: Array,
    roll_pitch: tuple[float, float],
    config: PairConfig,
    rows: RectificationSample | None = None,
) -> LidarDisparity | None:
    """Offset and scale of a drive by its scans; None where they are too few or lie at one distance.

    samples: per scan (K, 8) as `scan_disparities` gives them. motions: (S, 6) rotation vector [rad] and translation [m]
    of T_current_previous into each scan. roll_pitch: of the right camera [rad], taken out first. rows: of the frames of
    all scans together; None = those of every frame stand.
    """
    kept = [i for i, found in enumerate(samples) if len(found) >= config.least_samples]
    if len(kept) < config.min_scans:
        return None
    every = -(-sum(len(samples[i]) for i in kept) // config.lidar_samples)
    scans = [
        _Scan.of(camera, samples[i][::every].astype(np.float64), motions[i], roll_pitch, config, rows)
        for i in kept
    ]
    whole = _fit(scans, config)
    if whole is None or whole.covariance[1, 1] > config.most_scale_sigma**2:
        return None
    halves = np.full((2, 2), np.nan)
    if len(scans) >= 2 * config.min_scans:
        for k in range(2):
            half = _fit(scans[1 - k :: 2], config, (whole, whole.turns[1 - k :: 2]))
            if half is not None:
                halves[k] = half.values[:2] + [0.0, 1.0]
    offset, excess = (float(value) for value in whole.values[:2])
    noise_px = whole.factor * float(np.median(np.concatenate([scan.noise for scan in scans])))
    return LidarDisparity(offset, 1.0 + excess, whole.covariance, len(scans), halves, noise_px)


@dataclass(frozen=True)
class _Scan:
    """error: (K,) measured minus predicted disparity [px]. drive: (K, 3), pose: (K, 6) its derivatives. noise: (K,)
    [px] 1 sigma of the error as it is foreseen."""

    error: Array
    drive: Array
    pose: Array
    noise: Array

    @classmethod
    def of(
        cls,
        camera: StereoCamera,
        table: Array,
        motion: Array,
        roll_pitch: tuple[float, float],
        config: PairConfig,
        rows: RectificationSample | None,
    ) -> _Scan:
        # runs of earlier versions have no lean
        x, y, predicted, measured, slope_u, slope_v, lean, down = np.pad(
            table, ((0, 0), (0, 8 - table.shape[1]))
        ).T
        f, fb = camera.focal_px, camera.focal_px * camera.baseline_m
        right = x - measured / f
        if rows is not None:
            measured = measured + lean * (rows.down_px(f, right, y) - down)
        roll, pitch = roll_pitch
        z = fb / predicted
        points = np.stack([x * z, y * z, z], axis=1)

        def moved(by: Array) -> Array:
            """What small displacements (K, 3) [m] of the points add to the disparity predicted at a pixel."""
            du, dv = f * (by[:, 0] - x * by[:, 2]) / z, f * (by[:, 1] - y * by[:, 2]) / z
            return np.asarray(-predicted / z * by[:, 2] - slope_u * du - slope_v * dv)

        turns = [moved(np.cross(axis, points)) for axis in np.eye(3)]
        shifts = [moved(np.broadcast_to(axis, points.shape)) for axis in np.eye(3)]
        # by the part of a turn that a point lies to the side, the car's whole motion from frame to frame
        swept = np.arctan(x)[:, None] / (2.0 * np.pi) * -(np.cross(motion[:3], points) + motion[3:6])
        drive = np.stack([-(1.0 + right**2), predicted, moved(swept)], axis=1)
        error = measured - f * (roll * y + pitch * right * y) - predicted
        by_range = predicted**2 * config.lidar_range_m / fb
        by_angle = np.hypot(slope_u, slope_v) * f * np.deg2rad(config.lidar_angle_deg)
        noise = np.sqrt(config.match_px**2 + by_range**2 + by_angle**2)
        return cls(error, drive, np.stack([*turns, *shifts], axis=1), noise)


@dataclass(frozen=True)
class _Fit:
    """values: (3,) of the drive, turns: (S, 3) of the scans. factor: of the noise that was foreseen."""

    values: Array
    covariance: Array
    turns: Array
    factor: float


def _fit(scans: Sequence[_Scan], config: PairConfig, start: tuple[_Fit, Array] | None = None) -> _Fit | None:
    """Robust least squares over all scans, their jitters eliminated; covariance (2, 2) of offset and scale.

    start: what more scans than these gave, and the jitters of these in it.
    """
    jitter = np.full(JITTER, np.deg2rad(config.jitter_deg) ** -2.0)
    prior = np.diag([0.0, 0.0, config.sweep_sigma**-2.0])
    values, factor, rounds = np.zeros(GLOBAL), config.first_noise, config.lidar_rounds
    turns = np.zeros((len(scans), JITTER))
    if start is not None:
        values, factor, rounds = start[0].values, start[0].factor, config.half_rounds
        turns = start[1].copy()
    scores: list[Array] = []
    sensitivity = information = np.zeros((GLOBAL, GLOBAL))
    for _ in range(rounds):
        information, right = prior.copy(), -prior @ values
        scores, reduced, residuals = [], [], []
        sensitivity = np.zeros((GLOBAL, 6))
        for scan, turn in zip(scans, turns, strict=True):
            own = scan.pose[:, :JITTER]
            residual = scan.error - scan.drive @ values - own @ turn
            noise = factor * scan.noise
            weight = 1.0 / (1.0 + (residual / (config.lidar_tuning * noise)) ** 2) ** 2 / noise**2
            A, B = scan.drive * weight[:, None], own * weight[:, None]
            inverse = np.linalg.inv(own.T @ B + np.diag(jitter))
            cross = A.T @ own
            gradient = B.T @ residual - jitter * turn
            score = A.T @ residual - cross @ inverse @ gradient
            information += A.T @ scan.drive - cross @ inverse @ cross.T
            sensitivity += A.T @ scan.pose - cross @ inverse @ (B.T @ scan.pose)
            right += score
            scores.append(score)
            reduced.append((inverse, cross, gradient))
            residuals.append(residual / scan.noise)
        if np.linalg.cond(information) > config.worst_condition:
            return None
        step = np.linalg.solve(information, right)
        values = values + step
        for turn, (inverse, cross, gradient) in zip(turns, reduced, strict=True):
            turn += inverse @ (gradient - cross.T @ step)
        factor = max(mad_sigma(np.concatenate(residuals)), config.least_noise)
    inverse = np.linalg.inv(information)
    S = np.array(scores)
    spread = inverse @ (S.T @ S) @ inverse * len(S) / (len(S) - 1.0)
    pose = np.array([np.deg2rad(config.pose_angle_deg)] * 3 + [config.pose_m] * 3)
    considered = -inverse @ sensitivity * pose
    covariance = (spread + considered @ considered.T)[:2, :2]
    return _Fit(values, covariance, turns, factor)


def path_scale(solution: YawSolution, baseline_m: float, truth: Array, config: PairConfig) -> Measured | None:
    """True step over measured step of the camera, by (N, 4, 4) poses of a truth or a GNSS, NaN = unknown.

    Only lengths are compared: no heading is asked for.
    """
    used = solution.used[solution.used > 0]
    steps = np.linalg.norm(truth[used, :3, 3] - truth[used - 1, :3, 3], axis=1)
    measured = np.linalg.norm(solution.motions[used, 3:], axis=1) * baseline_m
    known = np.isfinite(steps) & (measured > config.least_step_m)
    if np.count_nonzero(known) < config.min_pairs:
        return None
    steps, measured = steps[known], measured[known]
    ratio = steps / measured
    centre = np.median(ratio)
    inside = np.abs(ratio - centre) < config.strays * max(mad_sigma(ratio, None), 1e-4)
    value = float(steps[inside].sum() / measured[inside].sum())
    groups = np.flatnonzero(inside) // config.pairs_together
    scores = np.bincount(groups, weights=(steps - value * measured)[inside])
    sigma = np.sqrt(np.sum(scores**2)) / measured[inside].sum()
    return Measured(value, float(np.hypot(sigma, config.path_systematic)))
