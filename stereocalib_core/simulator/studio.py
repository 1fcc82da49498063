"""Turns the number of a frame into what the cameras would have recorded, and into the truth behind it."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.config.scene import (
    BLUR,
    EXPOSURE_DIFFERENCE,
    EXPOSURE_S,
    FRAME_RATE_HZ,
    RECTIFICATION_ERROR_DEG,
    VIGNETTING,
)
from stereocalib_core.geometry import invert_transform, transform
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.simulator.drive import Drive, plan_drive
from stereocalib_core.simulator.effects import noise_factor, spoil
from stereocalib_core.simulator.faults import AXES, any_active, offsets
from stereocalib_core.simulator.furniture import Instance
from stereocalib_core.simulator.lidar import T_CAMERA_LIDAR, SpinningLidar
from stereocalib_core.simulator.plane import right_rotation
from stereocalib_core.simulator.renderer import Renderer, View
from stereocalib_core.simulator.sensor import expose, noise_table
from stereocalib_core.simulator.settings import DriveSettings
from stereocalib_core.simulator.world import World, build_world, moving

Picture = NDArray[np.uint8]


@dataclass(frozen=True)
class FrameTruth:
    """The truth of one left picture, as rendered.

    disparity: (H, W) float32, geometric u_left - u_right [px], NaN = none (sky).
    labels: (H, W) uint8, 0 unknown, sky or ground beside the road, 1 road surface, 2 obstacle.
    """

    disparity: NDArray[np.float32]
    labels: NDArray[np.uint8]


class Studio:
    """Renders frames of one drive; the world is built when the first picture is asked for."""

    def __init__(self, settings: DriveSettings) -> None:
        self.settings = settings
        self.camera = settings.camera
        self._lock = threading.Lock()
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="right-camera")

    @cached_property
    def drive(self) -> Drive:
        """The truth of the whole drive."""
        return plan_drive(self.settings)

    @cached_property
    def world(self) -> World:
        """The town."""
        return build_world(self.drive)

    @cached_property
    def _renderers(self) -> tuple[Renderer, Renderer]:
        return Renderer(self.world, self.camera), Renderer(self.world, self.camera)

    @cached_property
    def _right_turns(self) -> Array:
        """(N, 3) pitch, roll, yaw [deg] of the right camera against the left."""
        turns = np.rad2deg(offsets(self.settings.faults, ("rectification",), len(self.drive)))
        picked = turns[:, [AXES.index(axis) for axis in ("pitch", "roll", "yaw")]]
        picked[:, :2] += self.settings.rectification_error * np.array(RECTIFICATION_ERROR_DEG)
        return picked

    def T_world_right(self, frame: int) -> Array:
        """(4, 4) pose of the right camera, out of rectification where that was asked for."""
        turn = right_rotation(*(float(a) for a in self._right_turns[frame]))
        return self.drive.T_world_camera[frame] @ transform(turn, [self.camera.baseline_m, 0.0, 0.0])

    def drift(self, frame: int, T_world_view: Array) -> Array:
        """(6,) image motion during the exposure, as `shade` takes it."""
        if self.settings.motion_blur == 0 or len(self.drive) < 2:
            return np.array([0.0, 0.0, 0.0, 0.0, self.camera.cx_px, self.camera.cy_px])
        first = min(frame, len(self.drive) - 2)
        poses = self.drive.T_world_camera
        step = (poses[first + 1, :3, 3] - poses[first, :3, 3]) @ T_world_view[:3, :3]
        turn = (poses[first, :3, :3].T @ poses[first + 1, :3, :3])[0, 2]
        share = EXPOSURE_S * FRAME_RATE_HZ * self.settings.motion_blur
        f = self.camera.focal_px
        x, y, z = step * share
        return np.array([-f * turn * share, -f * x, z, -f * y, self.camera.cx_px, self.camera.cy_px])

    def views(self, frame: int) -> tuple[View, View]:
        """What perfect sensors would see, left and right."""
        things, shadows = moving(self.world, frame)
        right = self._pool.submit(self._view, 1, frame, things, shadows)
        return self._view(0, frame, things, shadows), right.result()

    def _view(self, side: int, frame: int, things: list[Instance], shadows: Array) -> View:
        """One camera's view; side 0 is the left."""
        return self._renderers[side].measured(self._grey(side, frame, things, shadows))

    def _grey(self, side: int, frame: int, things: list[Instance], shadows: Array) -> NDArray[np.float32]:
        """(H, W) of one camera's view."""
        T = self.T_world_right(frame) if side else self.drive.T_world_camera[frame]
        cx = self.camera.cx_px
        if side and self.camera.cx_right_px is not None:
            cx = self.camera.cx_right_px
        contrast = 0.03 if any_active(self.settings.faults, "low_texture", frame) else 1.0
        s_m = float(self.drive.s_m[frame])
        return self._renderers[side].grey(T, s_m, things, shadows, cx, self.drift(frame, T), contrast)

    def frame(self, frame: int) -> tuple[Picture, Picture, NDArray[np.float32] | None]:
        """What is recorded: left, right (H, W) uint8, and the LiDAR's scan (N, 4) float32 where there is one."""
        faults = self.settings.faults
        left, right = self.pictures(frame)
        held = next((f for f in faults if f.kind == "freeze" and f.active(frame)), None)
        if held is not None:
            right = self.pictures(max(held.first - 1, 0))[1]
        if any_active(faults, "swap", frame):
            left, right = right, left
        scan = None
        if self.settings.lidar:
            with self._lock:
                scan = self._spinner.scan(frame)
        return left, right, scan

    @cached_property
    def _spinner(self) -> SpinningLidar:
        return SpinningLidar(self.world)

    @property
    def T_camera_lidar(self) -> Array:
        """(4, 4) of the LiDAR as it was calibrated."""
        return T_CAMERA_LIDAR

    def pictures(self, frame: int) -> tuple[Picture, Picture]:
        """The left and right picture, (H, W) uint8, with every fault of light and lens."""
        with self._lock:
            things, shadows = moving(self.world, frame)
            right = self._pool.submit(self._picture, 1, frame, things, shadows)
            return self._picture(0, frame, things, shadows), right.result()

    def _picture(self, side: int, frame: int, things: list[Instance], shadows: Array) -> Picture:
        """One camera's picture."""
        s = self.settings
        grey = spoil(self._grey(side, frame, things, shadows), s.faults, frame, side, s.seed)
        gain = 1.0 + side * EXPOSURE_DIFFERENCE * s.exposure_difference
        noise = s.noise * noise_factor(s.faults, frame)
        picture = np.empty(grey.shape, np.uint8)
        key = (s.seed * 1_000_003 + frame) * 2 + side
        expose(grey, gain, VIGNETTING * s.vignetting, noise, key, noise_table(), BLUR, picture)
        return picture

    def truth(self, frame: int) -> FrameTruth:
        """Dense disparity and labels of the left picture."""
        with self._lock:
            left = self._view(0, frame, *moving(self.world, frame))
        disparity = left.inverse_depth * np.float32(self.camera.focal_px * self.camera.baseline_m)
        disparity[left.inverse_depth == 0] = np.nan
        return FrameTruth(disparity, left.label)

    def poses(self) -> Array:
        """(N, 4, 4) of the left camera in the first left camera's frame."""
        return invert_transform(self.drive.T_world_camera[0]) @ self.drive.T_world_camera
