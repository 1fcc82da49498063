"""`calibration.json`: the result as plain numbers, metres and degrees."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from stereocalib_core.boards.answer import Answer
from stereocalib_core.boards.calibration import Calibration
from stereocalib_core.boards.detect import Detection
from stereocalib_core.boards.findings import Finding
from stereocalib_core.boards.next_pose import NextPose
from stereocalib_core.system.whole_file import json_bytes, write_json

NO_NUMBERS = (
    "T_camera_lidar", "T_lidar_camera", "translation_m", "rotation_rpy_deg", "sigma_translation_m",
    "sigma_rotation_deg", "linear", "baselines", "reprojection_rms_px", "plane_rms_m", "held_out", "board_scale",
    "intrinsics", "ros2_static_transform",
)  # fmt: skip
"""What is null where nothing could be solved."""


def calibration_bytes(answer: Answer) -> bytes:
    """`calibration.json`, as `write_calibration` writes it."""
    return json_bytes(_values(answer))


def write_calibration(answer: Answer, path: Path) -> None:
    """Write `calibration.json`; raises OutputError."""
    write_json(path, _values(answer))


def _values(answer: Answer) -> Mapping[str, Any]:
    """Everything a reader needs, in the documented form; what is not a number becomes null.

    sigma_rotation_deg is about the camera's x, y, z axes (roll, pitch, yaw of a LiDAR that looks along a
    camera are near gimbal lock, where their own sigmas say nothing).
    """
    result, found = answer.calibration, answer.found
    seen = result.observability
    camera: dict[str, Any] = {
        "model": result.camera.model,
        "K": result.camera.K,
        "D": result.camera.D,
    }
    if found.estimated_rms_px is not None:
        camera["estimated_rms_px"] = found.estimated_rms_px
    if result.intrinsic_sigma is not None:
        camera["sigma"] = result.intrinsic_sigma
    return {
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
            "plane_tilt_sigma_deg": np.rad2deg(result.plane_sigma[0]),
            "plane_offset_sigma_m": result.plane_sigma[1],
            "beam_sigma_m": result.beam_sigma_m,
        },
        "board_scale": {"value": result.scale.value, "sigma": result.scale.sigma},
        "intrinsics": None
        if result.intrinsic_sigma is None
        else {"K": result.camera.K, "D": result.camera.D, "sigma": result.intrinsic_sigma},
        "causes": [_finding(f) for f in answer.findings],
        "notes": list(found.notes),
        "next_pose": None if answer.pose is None else _pose(answer.pose, result),
        "camera": camera,
        "ros2_static_transform": result.ros2_static_transform(),
    }


def _finding(finding: Finding) -> Mapping[str, Any]:
    return {"cause": finding.cause, "remedy": finding.remedy, "spoils": finding.spoils}


def _pose(pose: NextPose, result: Calibration) -> Mapping[str, Any]:
    return {
        "words": pose.words(),
        "T_camera_board": pose.T_camera_board,
        "T_lidar_board": result.T_lidar_camera @ pose.T_camera_board,
        "distance_m": pose.distance_m,
        "tilt_deg": np.rad2deg(pose.tilt_rad),
        "place_px": pose.place_px,
        "sigma_rotation_deg": np.rad2deg(pose.sigma_after[:3]),
        "sigma_translation_m": pose.sigma_after[3:],
    }


def write_refusals(found: Detection, said: Sequence[Finding], error: str, path: Path) -> None:
    """`calibration.json` of a set that cannot be solved: the documented keys without numbers, and every reason."""
    pairs = [
        {
            "name": o.name,
            "status": "rejected",
            "reason": o.reason,
            "plane_rms_m": None,
            "reprojection_rms_px": o.corner_rms_px,
            "normal_error_deg": None,
        }
        for o in found.observations
    ]
    values: dict[str, Any] = dict.fromkeys(NO_NUMBERS) | {
        "error": error,
        "pairs": pairs,
        "observability": {
            "singular_values": None,
            "verdict": "degenerate",
            "why": str(said[0]) if said else error,
        },
        "iterations": [],
        "causes": [_finding(f) for f in said],
        "notes": list(found.notes),
    }
    write_json(path, values)
