"""`calibration.json`: the result as plain numbers, metres and degrees."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from stereocalib_core.geometry import Array, invert_transform
from stereocalib_core.lidar_camera.calibration import Calibration


def to_dict(result: Calibration, estimated_rms_px: float | None = None) -> dict[str, Any]:
    """Everything a reader needs, in the documented form; what is not a number becomes null.

    sigma_rotation_deg is about the camera's x, y, z axes (roll, pitch, yaw of a LiDAR that looks along a
    camera are near gimbal lock, where their own sigmas say nothing).
    """
    seen = result.observability
    camera: dict[str, Any] = {
        "model": result.camera.model,
        "K": _list(result.camera.K),
        "D": _list(result.camera.D),
    }
    if estimated_rms_px is not None:
        camera["estimated_rms_px"] = _number(estimated_rms_px)
    if result.intrinsic_sigma is not None:
        camera["sigma"] = _list(result.intrinsic_sigma)
    return {
        "T_camera_lidar": _list(result.T_camera_lidar),
        "T_lidar_camera": _list(result.T_lidar_camera),
        "translation_m": _list(result.T_camera_lidar[:3, 3]),
        "rotation_rpy_deg": _list(np.rad2deg(result.rotation_rpy_rad)),
        "sigma_translation_m": _list(result.sigma_translation_m),
        "sigma_rotation_deg": _list(np.rad2deg(result.sigma_rotation_rad)),
        "covariance": _list(result.covariance),
        "linear": {"T_camera_lidar": _list(result.linear)},
        "baselines": {
            "unnikrishnan_hebert": _list(result.unnikrishnan_hebert),
            "points_on_plane": _list(result.points_on_plane),
        },
        "reprojection_rms_px": _number(result.reprojection_rms_px),
        "plane_rms_m": _number(result.plane_rms_m),
        "held_out": {
            "plane_rms_m": _number(result.held_out.plane_rms_m),
            "reprojection_rms_px": _number(result.held_out.reprojection_rms_px),
        },
        "pairs": [
            {
                "name": p.name,
                "status": p.status,
                "reason": p.reason,
                "plane_rms_m": _number(p.plane_rms_m),
                "reprojection_rms_px": _number(p.reprojection_rms_px),
                "normal_error_deg": _number(p.normal_error_deg),
                "offset_m": _number(p.offset_m),
            }
            for p in result.pairs
        ],
        "observability": {
            "singular_values": _list(seen.singular_values),
            "verdict": seen.verdict,
            "why": seen.why,
            "missing_direction_camera": None if seen.missing is None else _list(seen.missing),
        },
        "iterations": [
            {"cost": _number(i.cost), "reprojection_rms_px": _number(i.reprojection_rms_px)}
            for i in result.iterations
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


def write(result: Calibration, path: Path, estimated_rms_px: float | None = None) -> None:
    """Write `calibration.json`."""
    text = json.dumps(to_dict(result, estimated_rms_px), indent=1, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")


def summary_lines(result: Calibration) -> list[str]:
    """The result in a few lines for a terminal, refused pairs with their reasons first."""
    lines = [f"{p.name}: rejected: {p.reason}" for p in result.pairs if not p.ok]
    used = sum(p.ok for p in result.pairs)
    t, s = result.T_camera_lidar[:3, 3], 1000 * result.sigma_translation_m
    r, q = np.rad2deg(result.rotation_rpy_rad), np.rad2deg(result.sigma_rotation_rad)
    back = invert_transform(result.T_camera_lidar)[:3, 3]
    return [
        *lines,
        f"{used} of {len(result.pairs)} pairs used; {result.verdict}: {result.observability.why}",
        f"LiDAR in the camera: x {t[0]:.4f} y {t[1]:.4f} z {t[2]:.4f} m, sigma {_three(s, 1)} mm",
        f"roll pitch yaw of T_camera_lidar {_three(r, 3)} deg, sigma about camera x y z {_three(q, 3)} deg",
        f"camera in the LiDAR: {_three(back, 4)} m",
        f"points to boards {1000 * result.plane_rms_m:.1f} mm rms (held out {1000 * result.held_out.plane_rms_m:.1f}), "
        f"corners {result.reprojection_rms_px:.2f} px (held out {result.held_out.reprojection_rms_px:.2f})",
    ]


def _three(values: Iterable[float], digits: int) -> str:
    return " ".join(f"{v:.{digits}f}" for v in values)


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _list(values: Array) -> Any:
    return np.where(np.isfinite(values), values, 0.0).tolist()
