"""The result of a calibration: a transform, how good it is, and what became of every pair."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from stereocalib_core.boards.camera import BoardCamera
from stereocalib_core.boards.joint import Noise
from stereocalib_core.boards.observability import Observability
from stereocalib_core.boards.refine import Iteration
from stereocalib_core.boards.rotations import roll_pitch_yaw
from stereocalib_core.boards.second_opinion import BoardScale, Doubt, Solved
from stereocalib_core.geometry import invert_transform, ros2_static_transform
from stereocalib_core.numeric.arrays import Array


@dataclass(frozen=True)
class PairResult:
    """One pair against the final result; NaN where there is nothing to say.

    plane_rms_m: cloud points to the board as refined. reprojection_rms_px: corners. normal_error_deg: angle
    between the two sensors' own normals. offset_m: distance of the LiDAR's plane from the camera's board
    centre. aside_m: how far the two board centres lie apart along the board.
    """

    name: str
    status: str
    reason: str
    plane_rms_m: float = float("nan")
    reprojection_rms_px: float = float("nan")
    normal_error_deg: float = float("nan")
    offset_m: float = float("nan")
    aside_m: float = float("nan")
    T_camera_board: Array | None = None

    @property
    def ok(self) -> bool:
        """Whether the pair took part."""
        return self.status == "ok"


@dataclass(frozen=True)
class HeldOut:
    """Errors of each pair under the transform that the other pairs give, over all pairs; NaN below four pairs.

    plane_rms_m: cloud points to the board where the picture alone sees it. reprojection_rms_px: corners, when
    the board must please cloud and picture together.
    """

    plane_rms_m: float
    reprojection_rms_px: float


@dataclass(frozen=True)
class Calibration:
    """T_camera_lidar (4, 4) maps LiDAR points into the camera's optical frame.

    covariance: (6, 6) of the rotation vector about the camera's axes [rad] and of the translation [m].
    linear: the dual-space solution before refinement; unnikrishnan_hebert, points_on_plane: the baselines.
    scatter: how much more the planes disagree than their own noise explains; the covariance includes it.
    scale: the boards' size in the LiDAR over the stated one. doubt: what the boards say of a camera that was given.
    solved: what the covariance rests on; None where nothing could be solved.
    """

    T_camera_lidar: Array
    covariance: Array
    linear: Array
    unnikrishnan_hebert: Array
    points_on_plane: Array
    pairs: tuple[PairResult, ...]
    observability: Observability
    iterations: tuple[Iteration, ...]
    held_out: HeldOut
    plane_rms_m: float
    reprojection_rms_px: float
    noise: Noise
    scatter: float
    camera: BoardCamera
    intrinsic_sigma: Array | None = None
    scale: BoardScale = field(default_factory=lambda: BoardScale(1.0, float("nan")))
    doubt: Doubt | None = None
    solved: Solved | None = None

    @property
    def plane_sigma(self) -> tuple[float, float]:
        """How far LiDAR planes as a whole are off, tilt [rad] and offset [m], 1 sigma."""
        return (0.0, 0.0) if self.solved is None else self.solved.problem.plane_sigma

    @property
    def beam_sigma_m(self) -> float:
        """Range errors of the LiDAR's beams, each its own; 0: none seen, or no beams."""
        return 0.0 if self.solved is None or self.solved.beams is None else self.solved.beams.sigma_m

    @property
    def verdict(self) -> str:
        """good, weak or degenerate."""
        return self.observability.verdict

    @property
    def degenerate(self) -> bool:
        """Whether the result must not be trusted (exit code 3)."""
        return self.verdict == "degenerate"

    @cached_property
    def T_lidar_camera(self) -> Array:
        """(4, 4) the inverse: camera points into the LiDAR frame."""
        return invert_transform(self.T_camera_lidar)

    @property
    def sigma_rotation_rad(self) -> Array:
        """(3,) about the camera's x, y, z [rad]."""
        return np.sqrt(np.maximum(np.diag(self.covariance)[:3], 0.0))

    @property
    def sigma_translation_m(self) -> Array:
        """(3,) along the camera's x, y, z [m]."""
        return np.sqrt(np.maximum(np.diag(self.covariance)[3:], 0.0))

    @property
    def rotation_rpy_rad(self) -> Array:
        """(3,) roll, pitch, yaw of T_camera_lidar, R = Rz(yaw) Ry(pitch) Rx(roll)."""
        return roll_pitch_yaw(self.T_camera_lidar[:3, :3])

    def ros2_static_transform(self, camera: str = "camera_optical_frame", lidar: str = "lidar") -> str:
        """The command that publishes it: parent camera, child LiDAR, so it carries T_camera_lidar as it stands."""
        return ros2_static_transform(self.T_camera_lidar, camera, lidar)
