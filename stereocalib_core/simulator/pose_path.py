"""A road under somebody else's drive: KITTI poses of a left camera to a course.

The poses are used as they are. The road follows the camera's own path at the mount's height, smoothed; it
banks with the slow part of the camera's roll.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter1d

from stereocalib_core.config.scene import AHEAD_M, BEHIND_M, SMOOTH_BANK_M, SMOOTH_HEIGHT_M, SMOOTH_M, STEP_M
from stereocalib_core.errors import ConfigError
from stereocalib_core.geometry import Extrinsics, transform
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.simulator.path import Course


def read_poses(path: str) -> Array:
    """(N, 4, 4) from a file of 12 numbers a line."""
    try:
        rows = np.loadtxt(path, ndmin=2)
    except (OSError, ValueError) as error:
        raise ConfigError(
            "pose file cannot be read", path, "give a file of KITTI poses, 12 numbers a line"
        ) from error
    if rows.shape[1:] != (12,) or len(rows) < 2 or not np.all(np.isfinite(rows)):
        raise ConfigError("not a pose file", path, "give at least two lines of 12 numbers")
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3] = rows.reshape(-1, 3, 4)
    return poses


def course_from_poses(path: str, mount: Extrinsics) -> tuple[Course, Array, Array]:
    """The course under the poses, where on it each pose is (N,) [m], and the poses in the world (N, 4, 4).

    In the world, down is where the cameras' mounts point on the average of the drive.
    """
    file_poses = read_poses(path)
    poses = mount.T_vehicle_camera @ (np.linalg.inv(file_poses[0]) @ file_poses)
    poses = _leveller(poses, mount) @ poses
    positions = poses[:, :3, 3]
    keep = [0]
    for i in range(1, len(positions)):
        if np.linalg.norm(positions[i] - positions[keep[-1]]) > 0.25:
            keep.append(i)
    if len(keep) < 3:
        raise ConfigError("pose file hardly moves", path, "give a drive of some metres")
    R_road = poses[:, :3, :3] @ mount.R_camera_road
    bank = np.arctan2(R_road[:, 1, 0], np.hypot(R_road[:, 0, 0], R_road[:, 2, 0]))
    way = np.concatenate(
        [[0.0], np.cumsum(np.linalg.norm(np.diff(positions[keep][:, [0, 2]], axis=0), axis=1))]
    )
    fine = np.arange(0.0, way[-1], STEP_M)
    x, y, z, tilt = (np.interp(fine, way, values[keep]) for values in (*positions.T, bank))
    x, y, z = _extended(x, SMOOTH_M), _extended(y, SMOOTH_HEIGHT_M), _extended(z, SMOOTH_M)
    tilt = gaussian_filter1d(np.pad(tilt, _margins(), mode="edge"), SMOOTH_BANK_M / STEP_M)
    dx, dy, dz = np.gradient(x), np.gradient(y), np.gradient(z)
    step = np.hypot(dx, dz)
    s = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(z)))])
    y = y + mount.height_m * np.hypot(1.0, dy / step)
    heading = np.unwrap(np.arctan2(dx, dz))
    even = np.arange(0.0, s[-1], STEP_M)
    x, y, z, heading, tilt = (np.interp(even, s, values) for values in (x, y, z, heading, tilt))
    course = Course(x, y, z, heading, np.gradient(heading, STEP_M), tilt, closed=False)
    behind = s[_margins()[0]]
    s_frames = behind + np.interp(
        np.interp(np.arange(len(poses)), keep, way), fine, s[_margins()[0] :][: len(fine)] - behind
    )
    return course, s_frames, poses


def _leveller(poses: Array, mount: Extrinsics) -> Array:
    """(4, 4) smallest rotation of the world that brings the mean of the mounted cameras' down axes to y."""
    down = (poses[:, :3, :3] @ mount.R_camera_road[:, 1]).mean(axis=0)
    down /= np.linalg.norm(down)
    axis = np.cross(down, [0.0, 1.0, 0.0])
    sine, cosine = float(np.linalg.norm(axis)), float(down[1])
    if sine < 1e-12:
        return np.eye(4)
    x, y, z = axis / sine
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return transform(np.eye(3) + sine * cross + (1 - cosine) * cross @ cross, np.zeros(3))


def _margins() -> tuple[int, int]:
    return round((BEHIND_M + 5.0) / STEP_M), round((AHEAD_M + 20.0) / STEP_M)


def _extended(values: Array, sigma_m: float) -> Array:
    """Go on straight at both ends, and smooth."""
    before, after = _margins()
    n = min(len(values) - 1, round(4.0 / STEP_M))
    first, last = (values[n] - values[0]) / n, (values[-1] - values[-1 - n]) / n
    head = values[0] - first * np.arange(before, 0, -1)
    tail = values[-1] + last * np.arange(1, after + 1)
    return gaussian_filter1d(np.concatenate([head, values, tail]), sigma_m / STEP_M, mode="nearest")
