"""`calibration.json`: the result as plain numbers, metres and degrees."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from stereocalib_core.boards.calibration import Calibration
from stereocalib_core.system.whole_file import plain, write_json


def to_dict(result: Calibration, estimated_rms_px: float | None = None) -> dict[str, Any]:
    """Everything a reader needs, in the documented form; what is not a number becomes null.

    sigma_rotation_deg is about the camera's x, y, z axes (roll, pitch, yaw of a LiDAR that looks along a
    camera are near gimbal lock, where their own sigmas say nothing).
    """
    seen = result.observability
    camera: dict[str, Any] = {
        "model": result.camera.model,
        "K": result.camera.K,
        "D": result.camera.D,
    }
    if estimated_rms_px is not None:
        camera["estimated_rms_px"] = estimated_rms_px
    if result.intrinsic_sigma is not None:
        camera["sigma"] = result.intrinsic_sigma
    values = {
        "T_camera_lidar": result.T_camera_lidar,
        "T_lidar_camera": result.T_lidar_camera,
        "translation_m": result.T_camera_lidar[:3, 3],
        "rotation_rpy_deg": np.rad2deg(result.rotation_rpy_rad),
        "sigma_translation_m": result.sigma_translation_m,
        "sigma_rotation_deg": np.rad2deg(result.sigma_rotation_rad),
        "covariance": result.covariance,
        "linear": {"T_camera_lidar": result.linear},
        "baselines": {
            "unnikrishnan_hebert": result.unnikrishnan_hebert,
            "points_on_plane": result.points_on_plane,
        },
        "reprojection_rms_px": result.reprojection_rms_px,
        "plane_rms_m": result.plane_rms_m,
        "held_out": {
            "plane_rms_m": result.held_out.plane_rms_m,
            "reprojection_rms_px": result.held_out.reprojection_rms_px,
        },
        "pairs": [
            {
                "name": p.name,
                "status": p.status,
                "reason": p.reason,
                "plane_rms_m": p.plane_rms_m,
                "reprojection_rms_px": p.reprojection_rms_px,
                "normal_error_deg": p.normal_error_deg,
                "offset_m": p.offset_m,
            }
            for p in result.pairs
        ],
        "observability": {
            "singular_values": seen.singular_values,
            "verdict": seen.verdict,
            "why": seen.why,
            "missing_direction_camera": seen.missing,
        },
        "iterations": [
            {"cost": i.cost, "reprojection_rms_px": i.reprojection_rms_px} for i in result.iterations
        ],
        "noise": {
            "corner_sigma_px": result.noise.corner_px,
            "range_sigma_m": result.noise.range_m,
            "kappa_px_per_m": result.noise.kappa,
            "scatter": result.scatter,
        },
        "camera": camera,
        "ros2_static_transform": result.ros2_static_transform(),
    }
    return plain(values)


def write(result: Calibration, path: Path, estimated_rms_px: float | None = None) -> None:
    """Write `calibration.json`."""
    write_json(path, to_dict(result, estimated_rms_px))
