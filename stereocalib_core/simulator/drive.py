"""Where the camera is in every frame, and what its extrinsics truly are."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stereocalib_core.config.scene import AHEAD_M, PLANE_M, RAMP_AHEAD_M, STRAIGHT_M, TRACK_M, WHEELBASE_M
from stereocalib_core.geometry import Extrinsics, Plane, invert_transform
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.simulator import path as paths
from stereocalib_core.simulator.body import ride
from stereocalib_core.simulator.faults import AXES, Fault, offsets
from stereocalib_core.simulator.ground import Ground, Ramp, build_ground
from stereocalib_core.simulator.path import Course, Motion
from stereocalib_core.simulator.pose_path import course_from_poses
from stereocalib_core.simulator.settings import DriveSettings


@dataclass(frozen=True)
class Drive:
    """The truth of a whole drive.

    timestamps_s: (N,). T_world_camera: (N, 4, 4) of the left camera. T_world_rig: (N, 4, 4) where it were had nothing
    knocked it: what else is bolted to the car goes by this. mount_yaw_rad: (N,) against the car. s_m: (N,) where on
    the course the camera is.
    """

    settings: DriveSettings
    course: Course
    ground: Ground
    motion: Motion
    timestamps_s: Array
    T_world_camera: Array
    T_world_rig: Array
    mount_yaw_rad: Array
    s_m: Array

    @cached_property
    def extrinsics(self) -> Array:
        """(N, 4) height [m], pitch, roll, yaw [rad] over the plane of the own lane ahead."""
        lever_arm_m = self.settings.lever_arm_m
        return _truth(self.ground, self.s_m, self.T_world_camera, self.mount_yaw_rad, lever_arm_m)

    def __len__(self) -> int:
        return len(self.timestamps_s)


def plan_drive(settings: DriveSettings) -> Drive:
    """The course, the ground, and the camera over it in every frame."""
    poses: Array | None = None
    if settings.path is not None:
        course, s_camera, poses = course_from_poses(settings.path, settings.mount)
        times = np.arange(len(s_camera)) / paths.FRAME_RATE_HZ
        zero = np.zeros(len(s_camera))
        motion = Motion(times, s_camera - settings.lever_arm_m, zero, zero, zero)
    else:
        course, motion = _built_in(settings.name)
    frames = len(motion.time_s) if settings.frames is None else min(settings.frames, len(motion.time_s))
    flat = settings.name == "plane" and settings.path is None
    ramps = tuple(_ramp(f, motion, course, frames) for f in settings.faults if f.kind == "ramp")
    bumpy = settings.body_motion > 0 and settings.path is None and not flat
    humps = (0.30 * course.length_m, 0.865 * course.length_m) if bumpy else ()
    ground = build_ground(course, settings.camber, humps, ramps, flat)
    steady = _mounts(settings, motion)[:frames]
    mount = steady + offsets(settings.faults, ("knock", "drift"), frames)
    s_camera = (motion.s_m + settings.lever_arm_m)[:frames]
    if poses is None:
        T_world_vehicle = _vehicle_poses(ground, motion.s_m[:frames], settings)
        T_world_camera, T_world_rig = (
            T_world_vehicle @ np.stack([_camera_in_vehicle(row) for row in rows]) for rows in (mount, steady)
        )
    else:
        T_world_camera, T_world_rig = (
            _moved(poses[:frames], rows, settings.mount) for rows in (mount, steady)
        )
    times = motion.time_s[:frames]
    return Drive(settings, course, ground, motion, times, T_world_camera, T_world_rig, mount[:, 3], s_camera)


def _built_in(name: str) -> tuple[Course, Motion]:
    if name == "town":
        course = paths.town_course()
        return course, paths.drive_along(course, 8.0, 322.0)
    if name == "curves":
        course = paths.curves_course()
        return course, _until(paths.constant_speed(course, 7.5, 1.0), course)
    length = STRAIGHT_M if name == "straight" else PLANE_M
    course = paths.straight_course(length + AHEAD_M + 20.0)
    return course, _until(paths.constant_speed(course, 9.0, 1.5), course)


def _until(motion: Motion, course: Course) -> Motion:
    """Stop where the drawn road would end."""
    keep = motion.s_m < course.length_m - AHEAD_M - 10.0
    return Motion(*(getattr(motion, f)[keep] for f in ("time_s", "s_m", "speed", "acceleration", "lateral")))


def _ramp(fault: Fault, motion: Motion, course: Course, frames: int) -> Ramp:
    start = float(motion.s_m[min(fault.first, len(motion.s_m) - 1)]) + RAMP_AHEAD_M
    last = frames - 1 if fault.last is None else min(fault.last, len(motion.s_m) - 1)
    return Ramp(start, max(float(motion.s_m[last]) + RAMP_AHEAD_M, start + 34.0))


def _mounts(settings: DriveSettings, motion: Motion) -> Array:
    """(N, 6) height, pitch, roll, yaw, x, z of the camera over the car's own wheels, knocks left out."""
    body = ride(motion, settings.body_motion, settings.load, settings.seed)
    m = settings.mount
    total = np.zeros((len(motion.time_s), len(AXES)))
    total[:, 0] = m.height_m + body.height_m
    total[:, 1] = m.pitch_rad + body.pitch_rad
    total[:, 2] = m.roll_rad + body.roll_rad
    total[:, 3] = m.yaw_rad
    return total


def _vehicle_poses(ground: Ground, s_m: Array, settings: DriveSettings) -> Array:
    """(N, 4, 4) T_world_vehicle with the rear axle at s; the origin is on the wheels' plane under the camera."""
    half = TRACK_M / 2
    rear, front = s_m[:, None], s_m[:, None] + WHEELBASE_M
    y = ground.surface(
        np.concatenate([rear, rear, front, front], axis=1), np.array([-half, half, -half, half])
    )[..., 1]
    heading = ground.course.at(ground.course.heading_rad, s_m)
    rise = 0.5 * (y[:, 2] + y[:, 3] - y[:, 0] - y[:, 1]) / WHEELBASE_M
    tilt = 0.5 * (y[:, 1] + y[:, 3] - y[:, 0] - y[:, 2]) / TRACK_M
    forward = np.stack([np.sin(heading), rise, np.cos(heading)], axis=1)
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    right = np.stack([np.cos(heading), tilt, -np.sin(heading)], axis=1)
    right -= forward * np.sum(right * forward, axis=1, keepdims=True)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    axle = ground.course.points(s_m)
    axle[:, 1] = 0.5 * (y[:, 0] + y[:, 1])
    poses = np.tile(np.eye(4), (len(s_m), 1, 1))
    poses[:, :3, :3] = np.stack([right, np.cross(forward, right), forward], axis=2)
    poses[:, :3, 3] = axle + settings.lever_arm_m * forward
    return poses


def _camera_in_vehicle(mount: Array) -> Array:
    """(6,) over `AXES` to T_vehicle_camera."""
    T = Extrinsics(float(mount[0]), float(mount[1]), float(mount[2]), float(mount[3])).T_vehicle_camera
    T[0, 3] += mount[4]
    T[2, 3] += mount[5]
    return T


def _moved(poses: Array, mount: Array, planned: Extrinsics) -> Array:
    """(N, 4, 4) poses of a camera, planned for one mount, with the (N, 6) mounts over `AXES` that it has."""
    row = np.array([planned.height_m, planned.pitch_rad, planned.roll_rad, planned.yaw_rad, 0.0, 0.0])
    moved = np.any(mount != row, axis=1)
    result = poses.copy()
    if moved.any():
        to_vehicle = np.linalg.inv(_camera_in_vehicle(row))
        result[moved] = poses[moved] @ np.stack([to_vehicle @ _camera_in_vehicle(m) for m in mount[moved]])
    return result


def _truth(ground: Ground, s_m: Array, T_world_camera: Array, yaw_rad: Array, lever_arm_m: float) -> Array:
    """(N, 4) height, pitch, roll, yaw over the own lane's plane ahead of cameras at s."""
    heading = ground.course.at(ground.course.heading_rad, s_m - lever_arm_m)
    planes = ground.lane_planes(T_world_camera[:, [0, 2], 3], heading, s_m)
    rows = []
    for normal, offset, T, yaw in zip(*planes, T_world_camera, yaw_rad, strict=True):
        e = Extrinsics.from_plane(Plane(normal, offset).transformed(invert_transform(T)), float(yaw))
        rows.append((e.height_m, e.pitch_rad, e.roll_rad, e.yaw_rad))
    return np.array(rows)
