"""Yaw and lever arm of the rig together, from the free motions of a whole drive on the road.

A rear axle that does not slip sideways moves the camera by x = yaw z + z heading / 2 + L heading in each pair,
so a robust line through (z, heading) -> x - z heading / 2 gives both. Straight driving shows yaw, turns show L.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stereocalib_core.back.odometry.trajectory import Trajectory
from stereocalib_core.config import OdometryConfig, VehicleConfig
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.robust import SIGMA_PER_MAD


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


def estimate_lever_and_yaw(
    free: Trajectory, vehicle: VehicleConfig | None = None, config: OdometryConfig | None = None
) -> LeverYaw | None:
    """From a trajectory of a free model, best of `full`; None where too few pairs move.

    A weak prior holds the lever arm near its default, so that a drive without turns gives a usable value
    with the σ that says so.
    """
    vehicle, config = vehicle or VehicleConfig(), config or OdometryConfig()
    x, z, heading = free.planar.T
    use = free.measured & (z > config.lever_min_travel_m) & (free.planar_covariance[:, 0, 0] > 0)
    if np.count_nonzero(use) < config.lever_min_pairs:
        return None
    x, z, heading = x[use], z[use], heading[use]
    A = np.column_stack([z, heading])
    y = x - 0.5 * z * heading
    cov = free.planar_covariance[use]
    solution = np.array([np.median(y / z), vehicle.lever_arm_m])
    inverse_cov = np.zeros((2, 2))
    systematic = np.diag([np.deg2rad(config.lever_yaw_floor_deg), config.lever_floor_m]) ** 2
    for _ in range(20):
        # derivative of y - yaw z - L heading by x, z, heading
        J = np.stack([np.ones_like(z), -0.5 * heading - solution[0], -0.5 * z - solution[1]], axis=1)
        variance = np.einsum("ni,nij,nj->n", J, cov, J) + (vehicle.slip * z) ** 2
        residual = y - A @ solution
        spread = max(1.0, (SIGMA_PER_MAD * np.median(np.abs(residual) / np.sqrt(variance))) ** 2)
        weight = 1.0 / (variance * spread * (1.0 + residual**2 / (4.0 * variance * spread)))
        prior = 1.0 / vehicle.lever_arm_prior_sigma_m**2
        inverse_cov = (A * weight[:, None]).T @ A + np.diag([0.0, prior])
        right = (A * weight[:, None]).T @ y + [0.0, prior * vehicle.lever_arm_m]
        step = np.linalg.solve(inverse_cov, right) - solution
        solution = solution + step
        if np.abs(step).max() < 1e-9:
            break
    return LeverYaw(
        float(solution[0]),
        float(solution[1]),
        np.asarray(np.linalg.inv(inverse_cov) + systematic, dtype=np.float64),
        int(np.count_nonzero(use)),
    )
