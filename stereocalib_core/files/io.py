"""Trajectories and rig.yaml."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from stereocalib_core.errors import SourceError
from stereocalib_core.results import Measured, Rig
from stereocalib_core.system.tables import read_table
from stereocalib_core.system.whole_file import plain, write_atomic
from stereocalib_core.system.yaml_file import read_mapping

# --- trajectories


def write_kitti(path: Path, poses: NDArray[np.float64]) -> None:
    """(N, 4, 4) poses as 12 numbers a line."""
    rows = poses[:, :3, :].reshape(-1, 12) + 0.0
    write_atomic(path, "".join(" ".join(f"{value:.9e}" for value in row) + "\n" for row in rows))


def read_kitti(path: Path) -> NDArray[np.float64]:
    """A KITTI trajectory to (N, 4, 4); raises SourceError."""
    table = read_table(path, 12, "pose")
    poses = np.tile(np.eye(4), (len(table), 1, 1))
    poses[:, :3, :] = table.reshape(-1, 3, 4)
    return poses


def write_tum(path: Path, timestamps_s: NDArray[np.float64], poses: NDArray[np.float64]) -> None:
    """(N,) times and (N, 4, 4) poses as `time x y z qx qy qz qw`; frames without a pose are left out."""
    from scipy.spatial.transform import Rotation

    known = np.isfinite(poses).all(axis=(1, 2))
    quaternions = Rotation.from_matrix(poses[known, :3, :3]).as_quat(canonical=True) if known.any() else []
    lines = []
    for time_s, position, q in zip(timestamps_s[known], poses[known, :3, 3], quaternions, strict=True):
        lines.append(" ".join([f"{time_s:.6f}", *(f"{value + 0.0:.9f}" for value in (*position, *q))]) + "\n")
    write_atomic(path, "".join(lines))


def read_tum(path: Path) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """A TUM trajectory to (N,) times [s] and (N, 4, 4) poses; raises SourceError."""
    from scipy.spatial.transform import Rotation

    table = read_table(path, 8, "pose")
    poses = np.tile(np.eye(4), (len(table), 1, 1))
    poses[:, :3, 3] = table[:, 1:4]
    if len(table):
        poses[:, :3, :3] = Rotation.from_quat(table[:, 4:]).as_matrix()
    return table[:, 0], poses


# --- rig.yaml


MOUNT_KEYS = {
    "height_m": ("height_m", 1.0),
    "pitch_deg": ("pitch_rad", math.pi / 180),
    "roll_deg": ("roll_rad", math.pi / 180),
    "yaw_deg": ("yaw_rad", math.pi / 180),
}
"""What files call the fields of a `Rig`, and the unit in which they have them."""
_RIG_KEYS = {**MOUNT_KEYS, "lever_arm_m": ("lever_arm_m", 1.0)}


def write_rig(path: Path, rig: Rig) -> None:
    """Nominal mount, yaw and lever arm with their sigmas, in metres and degrees."""
    values: dict[str, Any] = {}
    for key, (field, unit) in _RIG_KEYS.items():
        given = getattr(rig, field)
        values[key] = (
            None
            if given is None
            else {"value": round(float(given.value / unit), 6), "sigma": round(float(given.sigma / unit), 6)}
        )
    write_atomic(path, yaml.safe_dump(plain(values), sort_keys=False))


def read_rig(path: Path) -> Rig:
    """A rig.yaml: height_m pitch_deg roll_deg yaw_deg lever_arm_m: null, a number, or value and sigma."""
    values = read_mapping(path, "rig file", SourceError)
    unknown = sorted(str(key) for key in values.keys() - _RIG_KEYS.keys())
    if unknown:
        raise SourceError(f"unknown key {unknown[0]}", path, f"known are {' '.join(_RIG_KEYS)}")
    fields: dict[str, Any] = {}
    for key, (field, unit) in _RIG_KEYS.items():
        given = values.get(key)
        pair = (given.get("value"), given.get("sigma") or 0.0) if isinstance(given, dict) else (given, 0.0)
        if pair[0] is None:
            continue
        numbers = [
            n for n in pair if isinstance(n, (int, float)) and not isinstance(n, bool) and abs(n) < 1e6
        ]
        if len(numbers) != 2 or numbers[1] < 0:
            raise SourceError(
                f"{key} is no number with a sigma", path, "write `{value: NUMBER, sigma: NUMBER}`"
            )
        fields[field] = Measured(numbers[0] * unit, numbers[1] * unit)
    return Rig(**fields)
