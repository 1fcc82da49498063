"""The paths of a drive by variant and under the page's corrections; everything is computed by the core."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from stereocalib_app.drive.settings import Corrections
from stereocalib_core.back.odometry.packing import pack
from stereocalib_core.back.odometry.trajectory import (
    VARIANTS,
    Trajectory,
    TrajectorySettings,
    apply_settings,
    fill_missing,
    trajectory,
)
from stereocalib_core.geometry import Extrinsics, StereoCamera
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.results import Drive, FrameResult, Rig, estimates


def core_settings(corrections: Corrections, lever_arm_m: float | None) -> TrajectorySettings:
    """The page's corrections in the core's units."""
    pitch, roll, yaw = np.deg2rad(
        [corrections.pitch_error_deg, corrections.roll_error_deg, corrections.yaw_error_deg]
    )
    more = {} if lever_arm_m is None else {"lever_arm_m": lever_arm_m}
    return TrajectorySettings(
        model=corrections.model,  # type: ignore[arg-type]
        yaw_strength=corrections.yaw_strength,
        pitch_strength=corrections.pitch_strength,
        roll_strength=corrections.roll_strength,
        height_strength=corrections.height_strength,
        yaw_error_rad=float(yaw),
        pitch_error_rad=float(pitch),
        roll_error_rad=float(roll),
        height_error_m=corrections.height_error_m,
        **more,
    )


class DrivePaths:
    """Tracks and extrinsics of the frames computed so far, ready for any correction. Safe from any thread."""

    def __init__(self, camera: StereoCamera, results: Sequence[FrameResult], drive: Drive | None) -> None:
        rig = Rig() if drive is None else drive.mount
        yaw = 0.0 if rig.yaw_rad is None else rig.yaw_rad.value
        self.lever_arm_m = None if rig.lever_arm_m is None else rig.lever_arm_m.value
        raw = estimates(results)
        column = np.full((len(raw), 1), yaw)
        self._raw = np.hstack([raw, column])
        self._filtered = self._raw if drive is None else np.hstack([drive.frames.smoothed, column])
        self._sigma = None if drive is None else drive.frames.smoothed_sigma
        self._tracks = pack(camera, results)
        self._lock = threading.Lock()
        self._variant = lru_cache(maxsize=24)(self._compute_variant)

    def __len__(self) -> int:
        return len(self._raw)

    def extrinsics(self, source: str) -> Array:
        """(N, 4) height [m], pitch, roll, yaw [rad], `filtered` or `raw`."""
        return self._filtered if source == "filtered" else self._raw

    def live(self, corrections: Corrections) -> Trajectory:
        """The path under the page's corrections."""
        settings = core_settings(corrections, self.lever_arm_m)
        with self._lock:
            return trajectory(self._tracks, self.extrinsics(corrections.source), settings, self._sigma)

    def _compute_variant(self, name: str, source: str, model: str) -> Trajectory:
        values: dict[str, Any] = {**VARIANTS[name].__dict__, "model": model}
        if self.lever_arm_m is not None:
            values["lever_arm_m"] = self.lever_arm_m
        with self._lock:
            settings = TrajectorySettings(**values)
            return trajectory(self._tracks, self.extrinsics(source), settings, self._sigma)

    def variants(self, source: str, model: str) -> dict[str, Trajectory]:
        """The paper's variants with a motion model."""
        return {name: self._variant(name, source, model) for name in VARIANTS}

    def road_at(self, frame: int, corrections: Corrections) -> Extrinsics | None:
        """The extrinsics that the corrections make of a frame."""
        values = self.extrinsics(corrections.source)
        if frame >= len(values):
            return None
        used = apply_settings(fill_missing(values), core_settings(corrections, self.lever_arm_m))
        return Extrinsics(*(float(v) for v in used[frame]))
