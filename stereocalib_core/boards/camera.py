"""Pinhole and fisheye cameras: projection with derivatives, its inverse, and `camera.yaml`.

Pinhole: OpenCV's model with 0, 4, 5, 8 or 12 coefficients (k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4).
Fisheye: Kannala-Brandt with 4 coefficients, theta_d = theta (1 + k1 theta^2 + ... + k4 theta^8).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from stereocalib_core.errors import ConfigError
from stereocalib_core.numeric.arrays import Array

COEFFICIENTS = {"pinhole": (0, 4, 5, 8, 12), "fisheye": (0, 4)}


@dataclass(frozen=True)
class BoardCamera:
    """A camera that looks at boards: size [px], K (3, 3) [px] and distortion D (n,)."""

    model: Literal["pinhole", "fisheye"]
    width: int
    height: int
    K: Array
    D: Array

    def __post_init__(self) -> None:
        K = np.asarray(self.K, dtype=np.float64)
        D = np.asarray(self.D, dtype=np.float64).reshape(-1)
        object.__setattr__(self, "K", K)
        object.__setattr__(self, "D", D)
        if self.model not in COEFFICIENTS:
            raise ConfigError("camera model is unknown", self.model, "use pinhole, fisheye or estimate")
        if K.shape != (3, 3) or not np.isfinite(K).all() or K[0, 0] <= 0 or K[1, 1] <= 0:
            raise ConfigError(
                "camera K is no intrinsic matrix", K.tolist(), "give fx 0 cx / 0 fy cy / 0 0 1 in pixels"
            )
        if len(D) not in COEFFICIENTS[self.model] or not np.isfinite(D).all():
            raise ConfigError(
                f"{self.model} distortion has {len(D)} numbers",
                D.tolist(),
                f"give one of {COEFFICIENTS[self.model]}",
            )
        if not 16 <= self.width <= 100_000 or not 16 <= self.height <= 100_000:
            raise ConfigError(
                "camera size is none", f"{self.width} x {self.height}", "give width and height in pixels"
            )

    @cached_property
    def _coefficients(self) -> Array:
        padded = np.zeros(12 if self.model == "pinhole" else 4)
        padded[: len(self.D)] = self.D
        return padded

    def project(self, points_camera: Array) -> Array:
        """(..., 3) points in the camera frame [m] to (..., 2) [px]; NaN behind the camera (z <= 0)."""
        p = np.asarray(points_camera, dtype=np.float64)
        z = np.where(p[..., 2] > 1e-9, p[..., 2], np.nan)
        xy, _ = self._distort(p[..., 0] / z, p[..., 1] / z)
        return xy @ self.K[:2, :2].T + self.K[:2, 2]

    def project_with_jacobian(self, points_camera: Array) -> tuple[Array, Array]:
        """(..., 3) points [m] to (..., 2) pixels and their (..., 2, 3) derivatives [px/m]."""
        p = np.asarray(points_camera, dtype=np.float64)
        z = np.where(p[..., 2] > 1e-9, p[..., 2], np.nan)
        x, y = p[..., 0] / z, p[..., 1] / z
        xy, d_xy = self._distort(x, y)
        zero = np.zeros_like(x)
        d_normalised = np.stack(
            [np.stack([1 / z, zero, -x / z], axis=-1), np.stack([zero, 1 / z, -y / z], axis=-1)], axis=-2
        )
        A = self.K[:2, :2]
        return xy @ A.T + self.K[:2, 2], A @ d_xy @ d_normalised

    def _distort(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Normalised coordinates to distorted ones (..., 2) and their (..., 2, 2) derivatives."""
        k = self._coefficients
        if self.model == "pinhole" and not k.any():
            return np.stack([x, y], axis=-1), np.broadcast_to(np.eye(2), (*x.shape, 2, 2))
        r2 = x * x + y * y
        if self.model == "fisheye":
            g, dg = _fisheye_gain(r2, k)
            row_x = np.stack([g + 2 * x * x * dg, 2 * x * y * dg], axis=-1)
            row_y = np.stack([2 * x * y * dg, g + 2 * y * y * dg], axis=-1)
            return np.stack([x * g, y * g], axis=-1), np.stack([row_x, row_y], axis=-2)
        top = 1 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]))
        bottom = 1 + r2 * (k[5] + r2 * (k[6] + r2 * k[7]))
        g = top / bottom
        dg = (k[0] + r2 * (2 * k[1] + 3 * k[4] * r2) - g * (k[5] + r2 * (2 * k[6] + 3 * k[7] * r2))) / bottom
        p1, p2 = k[2], k[3]
        xd = x * g + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) + r2 * (k[8] + k[9] * r2)
        yd = y * g + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y + r2 * (k[10] + k[11] * r2)
        thin_x, thin_y = k[8] + 2 * k[9] * r2, k[10] + 2 * k[11] * r2
        cross = 2 * x * y * dg + 2 * p1 * x + 2 * p2 * y
        row_x = np.stack(
            [g + 2 * x * x * dg + 2 * p1 * y + 6 * p2 * x + 2 * x * thin_x, cross + 2 * y * thin_x], axis=-1
        )
        row_y = np.stack(
            [cross + 2 * x * thin_y, g + 2 * y * y * dg + 6 * p1 * y + 2 * p2 * x + 2 * y * thin_y], axis=-1
        )
        return np.stack([xd, yd], axis=-1), np.stack([row_x, row_y], axis=-2)

    def intrinsic_jacobian(self, points_camera: Array) -> Array:
        """(..., 3) points [m] to (..., 2, 4 + n): derivatives [px] by fx, fy, cx, cy and the n given coefficients."""
        p = np.asarray(points_camera, dtype=np.float64)
        x, y = p[..., 0] / p[..., 2], p[..., 1] / p[..., 2]
        xy, _ = self._distort(x, y)
        result = np.zeros((*x.shape, 2, 4 + len(self.D)))
        result[..., 0, 0], result[..., 1, 1] = xy[..., 0], xy[..., 1]
        result[..., 0, 2], result[..., 1, 3] = 1.0, 1.0
        for index in range(len(self.D)):
            step = 1e-6
            D = self.D.copy()
            D[index] += step
            moved, _ = BoardCamera(self.model, self.width, self.height, self.K, D)._distort(x, y)
            result[..., 4 + index] = (moved - xy) / step @ self.K[:2, :2].T
        return result

    def with_intrinsic_step(self, step: Array) -> BoardCamera:
        """This camera after adding a (4 + n,) step to fx, fy, cx, cy and the coefficients."""
        K = self.K.copy()
        K[0, 0] += step[0]
        K[1, 1] += step[1]
        K[:2, 2] += step[2:4]
        return BoardCamera(self.model, self.width, self.height, K, self.D + step[4:])

    def normalise(self, pixels: Array) -> Array:
        """(N, 2) pixels to (N, 2) undistorted x/z, y/z, by Newton's method."""
        target = (np.asarray(pixels, dtype=np.float64).reshape(-1, 2) - self.K[:2, 2]) @ np.linalg.inv(
            self.K[:2, :2]
        ).T
        xy = target.copy()
        if self.model == "fisheye":
            radius = np.linalg.norm(target, axis=-1, keepdims=True)
            xy = target * np.where(
                radius > 1e-9, np.tan(np.minimum(radius, 1.5)) / np.maximum(radius, 1e-9), 1.0
            )
        for _ in range(30):
            distorted, slope = self._distort(xy[:, 0], xy[:, 1])
            step = np.linalg.solve(slope, (target - distorted)[..., None])[..., 0]
            length = np.linalg.norm(step, axis=-1, keepdims=True)
            xy = xy + step * np.minimum(1.0, 0.5 / np.maximum(length, 1e-12))
            if float(np.max(length, initial=0.0)) < 1e-13:
                break
        return xy


def _fisheye_gain(r2: Array, k: Array) -> tuple[Array, Array]:
    """theta_d / r and its derivative by r^2, with their series near the axis."""
    r = np.sqrt(r2)
    theta = np.arctan(r)
    t2 = theta * theta
    poly = 1 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3])))
    d_theta_d = 1 + t2 * (3 * k[0] + t2 * (5 * k[1] + t2 * (7 * k[2] + t2 * 9 * k[3])))
    small = r < 1e-4
    safe = np.where(small, 1.0, r)
    gain = np.where(small, 1.0 + (k[0] - 1.0 / 3.0) * r2, theta * poly / safe)
    slope = (d_theta_d / (1 + r2) - theta * poly / safe) / (2 * safe * safe)
    return gain, np.where(small, k[0] - 1.0 / 3.0, slope)
