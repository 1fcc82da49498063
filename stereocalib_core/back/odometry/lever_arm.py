"""Yaw and lever arm of the rig together, from the free motions of a whole drive on the road.

A rear axle that does not slip sideways moves the camera by x = yaw z + z heading / 2 + L heading in each pair,
so a robust line through (z, heading) -> x - z heading / 2 gives both. Straight driving shows yaw, turns show L.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stereocalib_core.back.odometry.trajectory import DEFAULT_LEVER_ARM_M, Trajectory
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.robust import SIGMA_PER_MAD

PRIOR_LEVER_SIGMA_M = 0.7
"""How far rear axle to camera may differ from the default where no turn shows it."""

MIN_TRAVEL_M = 0.1
"""Pairs that move less than this say nothing of the direction of travel."""

MIN_PAIRS = 10

SYSTEMATIC = np.diag([np.deg2rad(0.005), 0.02]) ** 2
"""What no number of pairs takes away: covariance of yaw and lever arm by the unevenness of road and tyres."""

SLIP_SIGMA = 1.5e-3
"""Sideways motion per metre of travel that real tyres and roads add to the measurement noise."""


@dataclass(frozen=True)
class LeverYaw:
    """yaw [rad] and lever arm [m] with their (2, 2) covariance, and the number of pairs behind them."""

    yaw_rad: float
    lever_arm_m: float
    covariance: Array
    pairs: int

    @property
    def yaw_sigma_rad(self) -> float:
        """Standard deviation of the yaw [rad]."""
        return float(np.sqrt(self.covariance[0, 0]))

    @property
    def lever_arm_sigma_m(self) -> float:
        """Standard deviation of the lever arm [m]."""
        return float(np.sqrt(self.covariance[1, 1]))


def estimate_lever_and_yaw(free: Trajectory) -> LeverYaw | None:
    """From a trajectory of a free model, best of `full`; None where too few pairs move.

    A weak prior holds the lever arm near its default, so that a drive without turns gives a usable value
    with the σ that says so.
    """
    x, z, heading = free.planar.T
    use = free.measured & (z > MIN_TRAVEL_M) & (free.planar_covariance[:, 0, 0] > 0)
    if np.count_nonzero(use) < MIN_PAIRS:
        return None
    x, z, heading = x[use], z[use], heading[use]
    A = np.column_stack([z, heading])
    y = x - 0.5 * z * heading
    cov = free.planar_covariance[use]
    solution = np.array([np.median(y / z), DEFAULT_LEVER_ARM_M])
    inverse_cov = np.zeros((2, 2))
    for _ in range(20):
        # derivative of y - yaw z - L heading by x, z, heading
        J = np.stack([np.ones_like(z), -0.5 * heading - solution[0], -0.5 * z - solution[1]], axis=1)
        variance = np.einsum("ni,nij,nj->n", J, cov, J) + (SLIP_SIGMA * z) ** 2
        residual = y - A @ solution
        spread = max(1.0, (SIGMA_PER_MAD * np.median(np.abs(residual) / np.sqrt(variance))) ** 2)
        weight = 1.0 / (variance * spread * (1.0 + residual**2 / (4.0 * variance * spread)))
        prior = 1.0 / PRIOR_LEVER_SIGMA_M**2
        inverse_cov = (A * weight[:, None]).T @ A + np.diag([0.0, prior])
        right = (A * weight[:, None]).T @ y + [0.0, prior * DEFAULT_LEVER_ARM_M]
        step = np.linalg.solve(inverse_cov, right) - solution
        solution = solution + step
        if np.abs(step).max() < 1e-9:
            break
    return LeverYaw(
        float(solution[0]),
        float(solution[1]),
        np.asarray(np.linalg.inv(inverse_cov) + SYSTEMATIC, dtype=np.float64),
        int(np.count_nonzero(use)),
    )
