"""Where the points of a pair of frames go if the stereo pair itself is bent: for what is kept, not for what is known.

A right camera turned by a yaw makes all depths wrong (`back.rig.relative_yaw`), and the motion that fits best at those
depths puts far points where they are not. Whoever drops what lies off that motion then drops just the points that show
the yaw, and reads it too small: by 3 % at 0.3 deg on a rendered town. So a motion is fitted with the bend left free as
well, and where that matters and is sure, points are judged by it. What is handed on as the motion stays the one by the
depths as measured: no correction enters.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stereocalib_core.config.tracks import BentPairConfig
from stereocalib_core.front.tracks.pair_motion import reprojection
from stereocalib_core.geometry import StereoCamera
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.small_algebra import rotation_from_vector, vector_from_rotation


@dataclass(frozen=True)
class Judge:
    """Where points are expected. motion: (6,) of T_current_previous. yaw_rad: of the right camera, 0 = not bent."""

    camera: StereoCamera
    motion: Array
    yaw_rad: float = 0.0

    def expected(self, rays: Array) -> Array:
        """(3, N) x', y' and inverse depth' as this pair would measure it, for rays (5, N) as it measured them."""
        if self.yaw_rad == 0.0:
            return np.asarray(reprojection(rays, self.motion))
        true = rays.copy()
        b = self.camera.baseline_m
        true[2] += _turned(rays[0], rays[2], b) * self.yaw_rad / b
        seen = reprojection(true, self.motion)
        seen[2] -= _turned(seen[0], seen[2], b) * self.yaw_rad / b
        return np.asarray(seen)


def judge_by(
    camera: StereoCamera, rays: Array, motion: Array, tolerance_px: float, config: BentPairConfig
) -> Judge:
    """By whom the points (5, N) x, y, inverse depth, x', y' are judged, starting from their own robust motion (6,)."""
    f, b = camera.focal_px, camera.baseline_m
    turned = _turned(rays[0], rays[2], b) / b
    ahead = np.stack([rays[0], rays[1], np.ones(rays.shape[1])])
    now, yaw = np.array(motion, dtype=np.float64), 0.0
    reach, scale = config.reach * tolerance_px / f, config.noise_px / f
    information = np.zeros((7, 7))
    for _ in range(config.rounds):
        R, t = rotation_from_vector(now[:3]), now[3:]
        q = R @ ahead + np.outer(t, rays[2] + turned * yaw)
        iz = 1.0 / np.maximum(q[2], 0.05)
        X, Y = q[0] * iz, q[1] * iz
        inverse = (rays[2] + turned * yaw) * iz
        error = np.concatenate([rays[3] - X, rays[4] - Y])
        squares = (rays[3] - X) ** 2 + (rays[4] - Y) ** 2
        weight = np.where(squares < reach**2, 1.0 / (1.0 + squares / (3.0 * scale) ** 2) ** 2, 0.0) / scale**2
        zero = np.zeros_like(X)
        J = np.stack(
            [
                np.concatenate([-X * Y, -1.0 - Y * Y]),
                np.concatenate([1.0 + X * X, X * Y]),
                np.concatenate([-Y, X]),
                np.concatenate([inverse, zero]),
                np.concatenate([zero, inverse]),
                np.concatenate([-X * inverse, -Y * inverse]),
                np.concatenate([turned * iz * (t[0] - X * t[2]), turned * iz * (t[1] - Y * t[2])]),
            ]
        )
        weighted = J * np.concatenate([weight, weight])
        information = weighted @ J.T
        # a car that stands shows no bend, and then there is none
        information[6, 6] += config.widest_rad**-2.0
        right = weighted @ error
        right[6] -= yaw * config.widest_rad**-2.0
        try:
            step = np.linalg.solve(information, right)
        except np.linalg.LinAlgError:
            return Judge(camera, motion)
        turn = rotation_from_vector(step[:3])
        now = np.concatenate([vector_from_rotation(turn @ R), turn @ t + step[3:6]])
        yaw += float(step[6])
    straight = Judge(camera, motion)
    sigma = float(np.sqrt(np.linalg.inv(information)[6, 6]))
    if not np.isfinite(yaw) or abs(yaw) < config.sure * sigma:
        return straight
    bent = Judge(camera, now, yaw)
    apart = (bent.expected(rays) - straight.expected(rays))[:2] * f
    return bent if np.quantile(np.hypot(*apart), 0.9) > config.least_move_px else straight


def _turned(x: Array, inverse_depth: Array, baseline_m: float) -> Array:
    """(N,) what a yaw of one takes from disparities over the focal length: 1 + x^2 of the right picture."""
    return np.asarray(1.0 + (x - inverse_depth * baseline_m) ** 2)
