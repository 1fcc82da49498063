"""A stereo pair as its calibration file describes it: raw lenses, the rectified pair, or both.

Frames: `left`, `right` are the cameras' own optical frames (x right, y down, z forward); `rectified_left`,
`rectified_right` are parallel, with x along the baseline. ``X_right = R X_left + t`` [m] and
``X_rectified_left = R_left X_left``. The projection of a raw camera is OpenCV's: `pinhole` with D in the order
k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tx ty, `fisheye` is Kannala-Brandt with k1 k2 k3 k4.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from stereocalib_core.config.reading import SAME_AXES_RAD
from stereocalib_core.geometry import Array, StereoCamera

Model = Literal["pinhole", "fisheye"]
Size = tuple[int, int]
PINHOLE_LENGTHS = (4, 5, 8, 12, 14)


@dataclass(frozen=True, eq=False)
class Lens:
    """One raw camera. K: (3, 3) [px]; D: (n,) coefficients, none is an ideal lens."""

    K: Array
    D: Array
    model: Model = "pinhole"

    @property
    def ideal(self) -> bool:
        """Whether its pictures are undistorted already."""
        return not np.any(self.D) and self.model == "pinhole"

    def padded(self) -> Array:
        """D in the shortest length that OpenCV knows and that loses nothing: 4, 5, 8, 12 or 14."""
        used = int(np.max(np.nonzero(self.D)[0], initial=-1)) + 1
        lengths = PINHOLE_LENGTHS if self.model == "pinhole" else (4,)
        D = np.zeros(next(length for length in lengths if length >= used))
        D[:used] = self.D[:used]
        return D


@dataclass(frozen=True, eq=False)
class LensPair:
    """Two raw cameras, X_right = R X_left + t. R: (3, 3); t: (3,) [m]; size: (width, height) or unknown."""

    left: Lens
    right: Lens
    R: Array
    t: Array
    size: Size | None = None

    @property
    def baseline_m(self) -> float:
        """The distance of the two centres; exactly -t[0] where that is all of t."""
        return -float(self.t[0]) if not np.any(self.t[1:]) else float(np.linalg.norm(self.t))


@dataclass(frozen=True, eq=False)
class RectifiedPair:
    """The pair after rectification: one focal length, equal rows.

    R_left, R_right: (3, 3) from each raw camera's axes to the rectified ones, as the file states them.
    """

    focal_px: float
    cx_px: float
    cy_px: float
    baseline_m: float
    cx_right_px: float | None = None
    size: Size | None = None
    R_left: Array = field(default_factory=lambda: np.eye(3))
    R_right: Array = field(default_factory=lambda: np.eye(3))

    def projections(self) -> tuple[Array, Array]:
        """(3, 4) P of the left and of the right camera."""
        left = np.array(
            [[self.focal_px, 0, self.cx_px, 0], [0, self.focal_px, self.cy_px, 0], [0, 0, 1, 0]], np.float64
        )
        right = left.copy()
        right[0, 2] = self.cx_px if self.cx_right_px is None else self.cx_right_px
        right[0, 3] = -self.focal_px * self.baseline_m
        return left, right

    def camera(self, size: Size) -> StereoCamera:
        """The camera of rectified pictures of (width, height)."""
        return StereoCamera(
            *size, self.focal_px, self.cx_px, self.cy_px, self.baseline_m, self.cx_right_px
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class StereoCalibration:
    """What is known of a pair; at least one of `lenses` and `rectified`.

    raw_pictures: whether the pictures that go with it are still those of the lenses.
    T_camera_lidar: (4, 4) into the left camera of its pictures, or None. notes: what had to be assumed.
    """

    lenses: LensPair | None
    rectified: RectifiedPair | None
    raw_pictures: bool
    fps: float | None = None
    T_camera_lidar: Array | None = None
    notes: tuple[str, ...] = ()
    dialect: str = ""

    @staticmethod
    def of_camera(camera: StereoCamera) -> StereoCalibration:
        """The calibration of a rectified camera."""
        pair = RectifiedPair(
            camera.focal_px,
            camera.cx_px,
            camera.cy_px,
            camera.baseline_m,
            camera.cx_right_px,
            (camera.width, camera.height),
        )
        return StereoCalibration(None, pair, raw_pictures=False)

    @property
    def size(self) -> Size | None:
        """(width, height) of the pictures that go with it, None where the file does not say."""
        first, second = (self.lenses, self.rectified) if self.raw_pictures else (self.rectified, self.lenses)
        if first is not None:
            return first.size
        return None if second is None else second.size

    def sized(self, size: Size) -> StereoCalibration:
        """The same for pictures of (width, height)."""
        return dataclasses.replace(
            self,
            lenses=None if self.lenses is None else dataclasses.replace(self.lenses, size=size),
            rectified=None if self.rectified is None else dataclasses.replace(self.rectified, size=size),
        )

    def pictured(self) -> LensPair:
        """The lenses of the pictures that go with it: the raw ones, or ideal ones of the rectified pair."""
        if self.raw_pictures and self.lenses is not None:
            return self.lenses
        assert self.rectified is not None
        left, right = self.rectified.projections()
        t = np.array([-self.rectified.baseline_m, 0.0, 0.0])
        lenses = [Lens(P[:, :3].copy(), np.zeros(4)) for P in (left, right)]
        return LensPair(lenses[0], lenses[1], np.eye(3), t, self.rectified.size)

    def mended(self, C_right: Array, scale: float = 1.0) -> StereoCalibration:
        """The same pair once a bend is known, for the same pictures.

        C_right: (3, 3) rotation of the true right camera from where this calibration has it, both in the
        rectified right frame: ``X_true = C_right X_assumed``. scale: true baseline / stated baseline.
        """
        pair = self.pictured()
        R_left, R_right = rectifying_rotations(pair.R, pair.t)
        t_rectified = np.array([-pair.baseline_m * scale, 0.0, 0.0])
        bent = dataclasses.replace(pair, R=R_right.T @ C_right @ R_left, t=R_right.T @ C_right @ t_rectified)
        target = self.rectified
        if target is not None:
            R_left, R_right = rectifying_rotations(bent.R, bent.t)
            target = dataclasses.replace(
                target, baseline_m=bent.baseline_m, cx_right_px=None, R_left=R_left, R_right=R_right
            )
        return dataclasses.replace(
            self, lenses=bent, rectified=target, raw_pictures=True, dialect="", notes=()
        )


def rectifying_rotations(R: Array, t: Array) -> tuple[Array, Array]:
    """(3, 3) rotations of the left and of the right camera into the rectified axes.

    The rectified x axis is the baseline; about it the left camera keeps its own pitch, so that angles against
    the road are those of the left camera itself and not of a mean of both.
    """
    x = -R.T @ t
    x = x / np.linalg.norm(x)
    z = np.array([0.0, 0.0, 1.0]) - x[2] * x
    z = z / np.linalg.norm(z)
    R_left = np.stack([x, np.cross(z, x), z])
    if rotation_angle(R_left) < SAME_AXES_RAD:
        R_left = np.eye(3)
    R_right = R_left @ R.T
    return R_left, np.eye(3) if rotation_angle(R_right) < SAME_AXES_RAD else R_right


def rotation_angle(R: Array) -> float:
    """The angle of a rotation matrix [rad], exact for small ones."""
    axis = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    return float(np.arctan2(np.linalg.norm(axis), np.trace(R) - 1.0))
