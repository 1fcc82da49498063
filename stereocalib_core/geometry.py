"""Axes, signs and the projection of a road into a stereo pair. Written once, here.

Frames (all right-handed, x right, y down, z forward):

- ``camera``: the left camera's optical frame.
- ``road``: origin on the road under the left camera, Y = 0 is the road, Z along the camera's own
  azimuth. ``P_camera = Rx(pitch) Rz(roll) (X, Y + h, Z)_road`` (eq. 3-4).
- ``vehicle``: the road frame turned by the mounting yaw, so that Z is the direction of straight travel:
  ``P_road = Ry(yaw) P_vehicle`` (eq. 15).

Signs: pitch > 0 looks down (the horizon moves up in the image); roll > 0 lets the horizon fall to the
right (v grows with u); yaw > 0 puts the vanishing point of straight travel right of the principal point.

Transforms are 4x4 and named ``T_a_b``: they map coordinates in frame b to coordinates in frame a.
Lengths are metres, angles radians, image coordinates pixels with (0, 0) at the centre of the first pixel.
Equation numbers are those of Musleh et al., "Autocalibracion de parametros extrinsecos de sistemas
estereo para aplicaciones de trafico".
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from stereocalib_core.errors import ConfigError
from stereocalib_core.numeric.arrays import Array


def rotation_x(angle_rad: float) -> Array:
    """Rotation about x, eq. 4."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def rotation_y(angle_rad: float) -> Array:
    """Rotation about y: maps the forward axis to (sin, 0, cos); the inverse of eq. 15."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def rotation_z(angle_rad: float) -> Array:
    """Rotation about z, eq. 4."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def road_rotation(pitch_rad: ArrayLike, roll_rad: ArrayLike) -> Array:
    """(..., 3, 3) R_camera_road = Rx(pitch) Rz(roll), eq. 4, of (...) angles; its second column points down."""
    pitch, roll = np.broadcast_arrays(np.asarray(pitch_rad, np.float64), np.asarray(roll_rad, np.float64))
    cp, sp, cr, sr = np.cos(pitch), np.sin(pitch), np.cos(roll), np.sin(roll)
    rows = [[cr, -sr, np.zeros_like(cr)], [cp * sr, cp * cr, -sp], [sp * sr, sp * cr, cp]]
    return np.ascontiguousarray(np.moveaxis(np.array(rows), (0, 1), (-2, -1)))


def transform(rotation: Array, translation: ArrayLike) -> Array:
    """(3, 3) and (3,) to a (4, 4) rigid transform."""
    result = np.eye(4)
    result[:3, :3] = rotation
    result[:3, 3] = translation
    return result


def invert_transform(T_a_b: Array) -> Array:
    """(..., 4, 4) rigid ``T_a_b`` to ``T_b_a``."""
    rotation = np.swapaxes(T_a_b[..., :3, :3], -1, -2)
    result = np.zeros_like(T_a_b)
    result[..., :3, :3] = rotation
    result[..., :3, 3] = -np.einsum("...ij,...j->...i", rotation, T_a_b[..., :3, 3])
    result[..., 3, 3] = 1.0
    return result


def quaternion_xyzw(R: Array) -> Array:
    """(3, 3) rotation to (4,) unit quaternion x, y, z, w with w >= 0."""
    K = np.array(
        [
            [R[0, 0] - R[1, 1] - R[2, 2], R[1, 0] + R[0, 1], R[2, 0] + R[0, 2], R[2, 1] - R[1, 2]],
            [R[1, 0] + R[0, 1], R[1, 1] - R[0, 0] - R[2, 2], R[2, 1] + R[1, 2], R[0, 2] - R[2, 0]],
            [R[2, 0] + R[0, 2], R[2, 1] + R[1, 2], R[2, 2] - R[0, 0] - R[1, 1], R[1, 0] - R[0, 1]],
            [R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], R[0, 0] + R[1, 1] + R[2, 2]],
        ]
    )
    q = np.linalg.eigh(K)[1][:, -1]
    return q if q[3] >= 0 else -q


def ros2_static_transform(T_parent_child: Array, parent: str, child: str) -> str:
    """The command that publishes a (4, 4) transform: ROS has the child's pose in the parent, as it stands."""
    x, y, z = T_parent_child[:3, 3]
    qx, qy, qz, qw = quaternion_xyzw(T_parent_child[:3, :3])
    return (
        f"ros2 run tf2_ros static_transform_publisher --x {x:.6f} --y {y:.6f} --z {z:.6f} "
        f"--qx {qx:.8f} --qy {qy:.8f} --qz {qz:.8f} --qw {qw:.8f} --frame-id {parent} --child-frame-id {child}"
    )


@dataclass(frozen=True)
class StereoCamera:
    """A rectified stereo pair: equal focal lengths, parallel axes, rows aligned.

    `cx_right_px` differs from `cx_px` when the rectification put the principal points apart; the
    measured disparity u_left - u_right then exceeds the geometric one by `disparity_offset_px`.
    """

    width: int
    height: int
    focal_px: float
    cx_px: float
    cy_px: float
    baseline_m: float
    cx_right_px: float | None = None

    def __post_init__(self) -> None:
        numbers = (self.width, self.height, self.focal_px, self.cx_px, self.cy_px, self.baseline_m)
        if not all(np.isfinite(n) for n in numbers):
            raise ConfigError(
                "camera has a value that is not a number", numbers, "check its calibration file"
            )
        if self.width < 32 or self.height < 32 or self.focal_px <= 0 or self.baseline_m <= 0:
            raise ConfigError(
                "camera makes no stereo pair",
                f"size {self.width}x{self.height}, focal {self.focal_px:g} px, baseline {self.baseline_m:g} m",
                "size must be at least 32x32, focal length and baseline positive",
            )

    @property
    def disparity_offset_px(self) -> float:
        """What u_left - u_right shows for a point at infinity [px]."""
        return 0.0 if self.cx_right_px is None else self.cx_px - self.cx_right_px

    @cached_property
    def K(self) -> Array:
        """(3, 3) intrinsic matrix of the left camera, px."""
        return np.array([[self.focal_px, 0.0, self.cx_px], [0.0, self.focal_px, self.cy_px], [0.0, 0.0, 1.0]])

    @cached_property
    def K_inv(self) -> Array:
        """(3, 3) inverse of `K`."""
        f, cx, cy = self.focal_px, self.cx_px, self.cy_px
        return np.array([[1 / f, 0.0, -cx / f], [0.0, 1 / f, -cy / f], [0.0, 0.0, 1.0]])

    def shrunk(self, by: int) -> StereoCamera:
        """The camera of pictures that are means of `by` x `by` pixels, what is left over at right and bottom cut."""
        right = None if self.cx_right_px is None else (self.cx_right_px + 0.5) / by - 0.5
        return StereoCamera(
            self.width // by, self.height // by, self.focal_px / by, (self.cx_px + 0.5) / by - 0.5,
            (self.cy_px + 0.5) / by - 0.5, self.baseline_m, right,
        )  # fmt: skip

    def project(self, points_camera: ArrayLike) -> Array:
        """(..., 3) points in the camera frame [m] to (..., 3) left u, v and geometric disparity [px]."""
        p = np.asarray(points_camera, dtype=np.float64)
        x, y, z = p[..., 0], p[..., 1], p[..., 2]
        f = self.focal_px
        return np.stack([f * x / z + self.cx_px, f * y / z + self.cy_px, f * self.baseline_m / z], axis=-1)

    def back_project(self, u: ArrayLike, v: ArrayLike, disparity: ArrayLike) -> Array:
        """Left u, v and geometric disparity [px], broadcast, to (..., 3) points in the camera frame [m]."""
        u, v, d = np.broadcast_arrays(*(np.asarray(a, dtype=np.float64) for a in (u, v, disparity)))
        s = self.baseline_m / d
        return np.stack([s * (u - self.cx_px), s * (v - self.cy_px), s * self.focal_px], axis=-1)


@dataclass(frozen=True)
class Plane:
    """The plane ``normal . X = offset_m`` in some frame; `normal` (3,) is a unit vector, `offset_m` >= 0."""

    normal: Array
    offset_m: float

    def transformed(self, T_a_b: Array) -> Plane:
        """This plane of frame b in frame a: n_a = R n_b, d_a = d_b + n_a . t."""
        normal = T_a_b[:3, :3] @ self.normal
        offset = self.offset_m + float(normal @ T_a_b[:3, 3])
        return Plane(-normal, -offset) if offset < 0 else Plane(normal, offset)

    def signed_distance(self, points: ArrayLike) -> Array:
        """(..., 3) points [m] to (...) distances [m], negative on the origin's side."""
        return np.asarray(points, dtype=np.float64) @ self.normal - self.offset_m


@dataclass(frozen=True)
class DisparityPlane:
    """The road in disparity space, Delta = A (v - v0) + B (u - u0) + C; A, B in px/px, C in px."""

    a: float
    b: float
    c_px: float

    def disparity(self, camera: StereoCamera, u: ArrayLike, v: ArrayLike) -> Array:
        """Geometric road disparity [px] at image points u, v [px], broadcast."""
        u, v = np.asarray(u, dtype=np.float64), np.asarray(v, dtype=np.float64)
        return self.a * (v - camera.cy_px) + self.b * (u - camera.cx_px) + self.c_px

    def extrinsics(self, camera: StereoCamera, yaw_rad: float = 0.0) -> Extrinsics:
        """The inverse of eq. 16: theta = atan(C / (alpha A)), rho = atan(-B cos(theta) / A)."""
        pitch = np.arctan2(self.c_px, camera.focal_px * self.a)
        roll = np.arctan2(-self.b * np.cos(pitch), self.a)
        height = camera.baseline_m * np.cos(roll) * np.cos(pitch) / self.a
        return Extrinsics(float(height), float(pitch), float(roll), yaw_rad)


@dataclass(frozen=True, slots=True)
class Extrinsics:
    """How the left camera stands over the road: height [m], pitch, roll, yaw [rad]; signs as in the module."""

    height_m: float
    pitch_rad: float
    roll_rad: float
    yaw_rad: float = 0.0

    @property
    def pitch_deg(self) -> float:
        """Pitch in degrees, > 0 looks down."""
        return float(np.rad2deg(self.pitch_rad))

    @property
    def roll_deg(self) -> float:
        """Roll in degrees, > 0: the horizon falls to the right."""
        return float(np.rad2deg(self.roll_rad))

    @property
    def yaw_deg(self) -> float:
        """Yaw in degrees, > 0: straight travel leads right of the principal point."""
        return float(np.rad2deg(self.yaw_rad))

    @classmethod
    def from_degrees(
        cls, height_m: float, pitch_deg: float, roll_deg: float, yaw_deg: float = 0.0
    ) -> Extrinsics:
        """The same from degrees."""
        pitch, roll, yaw = np.deg2rad([pitch_deg, roll_deg, yaw_deg])
        return cls(float(height_m), float(pitch), float(roll), float(yaw))

    @property
    def R_camera_road(self) -> Array:
        """(3, 3) rotation from road to camera axes, eq. 4."""
        return road_rotation(self.pitch_rad, self.roll_rad)

    @property
    def T_camera_road(self) -> Array:
        """(4, 4), eq. 3-4 without yaw."""
        rotation = self.R_camera_road
        return transform(rotation, rotation @ [0.0, self.height_m, 0.0])

    @property
    def T_road_vehicle(self) -> Array:
        """(4, 4), the inverse of eq. 15."""
        return transform(rotation_y(self.yaw_rad), np.zeros(3))

    @property
    def T_camera_vehicle(self) -> Array:
        """(4, 4), P_cam = Rx Rz Ry (X, Y + h, Z)_vehicle."""
        return self.T_camera_road @ self.T_road_vehicle

    @property
    def T_vehicle_camera(self) -> Array:
        """(4, 4), the inverse of `T_camera_vehicle`."""
        return invert_transform(self.T_camera_vehicle)

    def plane(self) -> Plane:
        """The road in the camera frame; its normal points down."""
        cp, sp = np.cos(self.pitch_rad), np.sin(self.pitch_rad)
        cr, sr = np.cos(self.roll_rad), np.sin(self.roll_rad)
        return Plane(np.array([-sr, cp * cr, sp * cr]), self.height_m)

    @classmethod
    def from_plane(cls, plane: Plane, yaw_rad: float = 0.0) -> Extrinsics:
        """From a plane in the camera frame: n = (-sin rho, cos theta cos rho, sin theta cos rho)."""
        n = plane.normal
        return cls(
            plane.offset_m,
            float(np.arctan2(n[2], n[1])),
            float(-np.arcsin(min(max(n[0], -1.0), 1.0))),
            yaw_rad,
        )

    def disparity_plane(self, camera: StereoCamera) -> DisparityPlane:
        """Eq. 16."""
        s = camera.baseline_m / self.height_m
        cp, sp = np.cos(self.pitch_rad), np.sin(self.pitch_rad)
        cr, sr = np.cos(self.roll_rad), np.sin(self.roll_rad)
        return DisparityPlane(float(s * cr * cp), float(-s * sr), float(s * camera.focal_px * cr * sp))

    def disparity_plane_jacobian(self, camera: StereoCamera) -> Array:
        """(3, 3) d(A, B, C) / d(height, pitch, roll), for covariance transport."""
        h, f = self.height_m, camera.focal_px
        s = camera.baseline_m / h
        cp, sp = np.cos(self.pitch_rad), np.sin(self.pitch_rad)
        cr, sr = np.cos(self.roll_rad), np.sin(self.roll_rad)
        return np.array(
            [
                [-s * cr * cp / h, -s * cr * sp, -s * sr * cp],
                [s * sr / h, 0.0, -s * cr],
                [-s * f * cr * sp / h, s * f * cr * cp, -s * f * sr * sp],
            ]
        )


def road_profile(camera: StereoCamera, extrinsics: Extrinsics) -> tuple[float, float]:
    """Eq. 8 at u = u0: slope C_r [px/px] and intercept v_0 [px] of v = C_r Delta + v_0 (eq. 9 for roll 0)."""
    e = extrinsics
    slope = e.height_m / (camera.baseline_m * np.cos(e.roll_rad) * np.cos(e.pitch_rad))
    return float(slope), float(camera.cy_px - camera.focal_px * np.tan(e.pitch_rad))


def extrinsics_from_profile(
    camera: StereoCamera, slope: float, intercept_px: float, roll_rad: float = 0.0
) -> Extrinsics:
    """Eq. 10 and 11, with the cos(roll) of eq. 8."""
    pitch = np.arctan((camera.cy_px - intercept_px) / camera.focal_px)
    height = slope * camera.baseline_m * np.cos(pitch) * np.cos(roll_rad)
    return Extrinsics(float(height), float(pitch), float(roll_rad))


def roll_from_slope(slope: float, pitch_rad: float) -> float:
    """Eq. 12: the slope of road pixels v = C u + d at one fixed disparity to roll [rad]."""
    return float(np.arctan(slope * np.cos(pitch_rad)))


def slope_from_roll(roll_rad: float, pitch_rad: float) -> float:
    """The inverse of eq. 12."""
    return float(np.tan(roll_rad) / np.cos(pitch_rad))


def road_to_image(camera: StereoCamera, extrinsics: Extrinsics, points_road: ArrayLike) -> Array:
    """Eq. 3: (..., 3) points in the road frame [m] to (..., 3) left u, v and geometric disparity [px]."""
    T = extrinsics.T_camera_road
    return camera.project(np.asarray(points_road, dtype=np.float64) @ T[:3, :3].T + T[:3, 3])


def image_to_road(
    camera: StereoCamera, extrinsics: Extrinsics, u: ArrayLike, v: ArrayLike, disparity: ArrayLike
) -> Array:
    """Eq. 6 (eq. 13, 7 and 14): image points with geometric disparity [px] to (..., 3) X, Y, Z [m]."""
    u, v, d = (np.asarray(a, dtype=np.float64) for a in (u, v, disparity))
    e, f = extrinsics, camera.focal_px
    cp, sp = np.cos(e.pitch_rad), np.sin(e.pitch_rad)
    cr, sr = np.cos(e.roll_rad), np.sin(e.roll_rad)
    du, dv, s = u - camera.cx_px, v - camera.cy_px, camera.baseline_m / d
    x = s * (cr * du + cp * sr * dv + f * sp * sr)
    y = s * (cr * cp * dv - sr * du + f * cr * sp) - e.height_m
    z = s * (f * cp - sp * dv) + np.zeros_like(du)
    return np.stack(np.broadcast_arrays(x, y, z), axis=-1)


def image_to_road_plane(camera: StereoCamera, extrinsics: Extrinsics, u: ArrayLike, v: ArrayLike) -> Array:
    """Image points [px] that lie on the road to (..., 2) X, Z [m]: eq. 13-14 with eq. 16.

    Points on or above the horizon have no place on the road and give NaN.
    """
    d = extrinsics.disparity_plane(camera).disparity(camera, u, v)
    d = np.where(d > 0, d, np.nan)
    return image_to_road(camera, extrinsics, u, v, d)[..., [0, 2]]


def horizon(camera: StereoCamera, extrinsics: Extrinsics) -> tuple[float, float]:
    """Slope [px/px] and row [px] at u0 of the horizon line v = row + slope (u - u0): eq. 8 at Delta = 0."""
    return slope_from_roll(extrinsics.roll_rad, extrinsics.pitch_rad), road_profile(camera, extrinsics)[1]


def yaw_from_vanishing_point(camera: StereoCamera, u_px: float, v_px: float, extrinsics: Extrinsics) -> float:
    """The exact form of eq. 1 under pitch and roll: yaw [rad] of the direction K^-1 (u, v, 1)."""
    direction = extrinsics.R_camera_road.T @ (camera.K_inv @ np.array([u_px, v_px, 1.0]))
    return float(np.arctan2(direction[0], direction[2]))


def vanishing_point_of_travel(camera: StereoCamera, extrinsics: Extrinsics) -> tuple[float, float]:
    """Where straight travel (the vehicle's Z axis) leads in the image: u, v [px]."""
    direction = camera.K @ (extrinsics.T_camera_vehicle[:3, :3] @ np.array([0.0, 0.0, 1.0]))
    return float(direction[0] / direction[2]), float(direction[1] / direction[2])


def planar_motion(x_m: float, z_m: float, heading_rad: float) -> Array:
    """(4, 4) T_road0_road1 of a camera that moves on the plane; heading > 0 turns right (z towards x)."""
    return transform(rotation_y(heading_rad), [x_m, 0.0, z_m])
