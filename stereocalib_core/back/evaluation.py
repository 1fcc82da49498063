"""How far an estimated path is from the true one; every figure names its alignment.

Unless said otherwise both paths start at the identity (alignment `first_pose`): poses are T_world_camera of
the left camera, world = the first left camera. Distances are metres along the true path.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.errors import ConfigError
from stereocalib_core.geometry import invert_transform
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.results import OdometryErrors

Alignment = Literal["none", "first_pose", "se3", "sim3"]

KITTI_LENGTHS_M = (100.0, 200.0, 300.0, 400.0, 500.0, 600.0, 700.0, 800.0)
KITTI_STEP_FRAMES = 10


@dataclass(frozen=True)
class PathError:
    """Statistics of a per-pose error. unit: `m` or `deg`. alignment: how the paths were laid over each other."""

    rmse: float
    mean: float
    median: float
    maximum: float
    unit: str
    alignment: str


def path_lengths(poses: Array) -> Array:
    """(N,) metres travelled up to each of (N, 4, 4) poses."""
    steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def rotation_angle(R: Array) -> Array:
    """(..., 3, 3) to the angle of rotation [rad]."""
    off = np.stack(
        [R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]], axis=-1
    )
    trace = R[..., 0, 0] + R[..., 1, 1] + R[..., 2, 2]
    return np.asarray(np.arctan2(np.linalg.norm(off, axis=-1), trace - 1.0))


def heading_between(R_a: Array, R_b: Array) -> Array:
    """(..., 3, 3) and (..., 3, 3) to the turn about the vertical axis from a to b [rad], > 0 to the right."""
    D = np.swapaxes(R_a, -1, -2) @ R_b
    return np.asarray(np.arctan2(D[..., 0, 2] - D[..., 2, 0], D[..., 0, 0] + D[..., 2, 2]))


def common_frames(poses_est: Array, poses_gt: Array) -> tuple[Array, Array, NDArray[np.intp]]:
    """Both paths on the frames that have a truth, each from its own first pose, and those frames' indices."""
    count = min(len(poses_est), len(poses_gt))
    known = np.flatnonzero(
        np.isfinite(poses_gt[:count]).all(axis=(1, 2)) & np.isfinite(poses_est[:count]).all((1, 2))
    )
    if len(known) < 2:
        raise ConfigError("no two frames with a true pose", "evaluation", "give poses of the same drive")
    est, gt = poses_est[known], poses_gt[known]
    return invert_transform(est[0]) @ est, invert_transform(gt[0]) @ gt, known


def kitti_relative_errors(poses_est: Array, poses_gt: Array) -> tuple[float, float] | None:
    """t_rel [percent] and r_rel [rad/m] by the definition of the KITTI odometry benchmark.

    Segments of 100 ... 800 m along the true path start at every tenth frame; a segment ends at the first
    frame beyond its length. None where the path is shorter than 100 m.
    """
    distance = path_lengths(poses_gt)
    starts, ends, lengths = [], [], []
    for first in range(0, len(poses_gt), KITTI_STEP_FRAMES):
        for length in KITTI_LENGTHS_M:
            last = int(np.searchsorted(distance, distance[first] + length, side="right"))
            if last < len(distance):
                starts.append(first)
                ends.append(last)
                lengths.append(length)
    if not starts:
        return None
    size = np.array(lengths)
    moved_gt = invert_transform(poses_gt[starts]) @ poses_gt[ends]
    moved = invert_transform(poses_est[starts]) @ poses_est[ends]
    error = invert_transform(moved) @ moved_gt
    t_rel = float(np.mean(np.linalg.norm(error[:, :3, 3], axis=1) / size))
    return 100.0 * t_rel, float(np.mean(rotation_angle(error[:, :3, :3]) / size))


def evaluate(
    poses_est: Array,
    poses_gt: Array | None,
    heading_reliable: bool = True,
    measured_share: float = 1.0,
    least_share: float = 0.0,
) -> OdometryErrors:
    """Every figure of one variant.

    poses_est, poses_gt: (N, 4, 4); a longer truth is cut, unknown poses are NaN. With `heading_reliable` False only
    path lengths are compared. measured_share: part of the way that was measured on the road; below `least_share`
    the path is a gap, and there are no figures.
    """
    percent = 100.0 * measured_share
    if measured_share < least_share:
        return OdometryErrors(None, measured_percent=percent)
    if poses_gt is None or len(poses_est) < 2:
        length = float(path_lengths(poses_est)[-1]) if len(poses_est) else 0.0
        return OdometryErrors(length, measured_percent=percent)
    est, gt, _ = common_frames(poses_est, poses_gt)
    path, path_gt = float(path_lengths(est)[-1]), float(path_lengths(gt)[-1])
    if not heading_reliable:
        return OdometryErrors(path, path_gt, measured_percent=percent)
    miss = float(np.hypot(*(est[-1, [0, 2], 3] - gt[-1, [0, 2], 3])))
    turn = float(np.rad2deg(abs(heading_between(gt[-1, :3, :3], est[-1, :3, :3]))))
    relative = kitti_relative_errors(est, gt)
    return OdometryErrors(
        path_m=path,
        path_gt_m=path_gt,
        final_translation_m=miss,
        final_translation_percent=100.0 * miss / path_gt if path_gt > 0 else None,
        final_rotation_deg=turn,
        final_rotation_deg_per_m=turn / path_gt if path_gt > 0 else None,
        t_rel_percent=None if relative is None else relative[0],
        r_rel_deg_per_m=None if relative is None else float(np.rad2deg(relative[1])),
        measured_percent=percent,
    )


def errors_along(poses_est: Array, poses_gt: Array) -> tuple[Array, Array, Array]:
    """Distance travelled [m], error in the x-z plane [m] and heading error [rad] of every common frame."""
    est, gt, _ = common_frames(poses_est, poses_gt)
    miss = np.hypot(est[:, 0, 3] - gt[:, 0, 3], est[:, 2, 3] - gt[:, 2, 3])
    return path_lengths(gt), miss, heading_between(gt[:, :3, :3], est[:, :3, :3])


def align(poses_est: Array, poses_gt: Array, alignment: Alignment) -> Array:
    """(N, 4, 4) estimate laid over the truth: as is, by its first pose, or by Umeyama's least squares."""
    if alignment == "none":
        return poses_est
    if alignment == "first_pose":
        return np.asarray(poses_gt[0] @ invert_transform(poses_est[0]) @ poses_est)
    if alignment not in ("se3", "sim3"):
        raise ConfigError(f"alignment {alignment}", "evaluation", "none, first_pose, se3 or sim3")
    x, y = poses_est[:, :3, 3], poses_gt[:, :3, 3]
    mean_x, mean_y = x.mean(axis=0), y.mean(axis=0)
    U, D, Vt = np.linalg.svd((y - mean_y).T @ (x - mean_x) / len(x))
    S = np.array([1.0, 1.0, np.sign(np.linalg.det(U) * np.linalg.det(Vt))])
    R = U @ np.diag(S) @ Vt
    variance = float(np.mean(np.sum((x - mean_x) ** 2, axis=1)))
    scale = float(np.sum(D * S)) / variance if alignment == "sim3" and variance > 0 else 1.0
    result = poses_est.copy()
    result[:, :3, :3] = R @ poses_est[:, :3, :3]
    result[:, :3, 3] = scale * (x - mean_x) @ R.T + mean_y
    return result


def _statistics(errors: Array, unit: str, alignment: str) -> PathError:
    return PathError(
        float(np.sqrt(np.mean(errors**2))),
        float(np.mean(errors)),
        float(np.median(errors)),
        float(np.max(errors)),
        unit,
        alignment,
    )


def absolute_error(poses_est: Array, poses_gt: Array, alignment: Alignment = "first_pose") -> PathError:
    """APE: distance [m] of every pose from its true place after the named alignment."""
    aligned = align(poses_est, poses_gt, alignment)
    return _statistics(np.linalg.norm(aligned[:, :3, 3] - poses_gt[:, :3, 3], axis=1), "m", alignment)


def relative_error(poses_est: Array, poses_gt: Array, step_frames: int = 1) -> tuple[PathError, PathError]:
    """RPE over `step_frames`: translation [m] and rotation [deg]; needs no alignment."""
    if not 0 < step_frames < len(poses_est):
        raise ConfigError(f"step of {step_frames} frames", "evaluation", f"give 1 to {len(poses_est) - 1}")
    moved = invert_transform(poses_est[:-step_frames]) @ poses_est[step_frames:]
    moved_gt = invert_transform(poses_gt[:-step_frames]) @ poses_gt[step_frames:]
    error = invert_transform(moved_gt) @ moved
    translation = _statistics(np.linalg.norm(error[:, :3, 3], axis=1), "m", "none")
    return translation, _statistics(np.rad2deg(rotation_angle(error[:, :3, :3])), "deg", "none")
