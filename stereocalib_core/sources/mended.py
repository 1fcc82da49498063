"""A drive seen with a pair whose bend is known: the right pictures turned back, the depths to scale.

Only the right picture changes. The left camera's axes, and with them every angle against the road and against a
LiDAR, stay what they were.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from stereocalib_core.frames import FrameSource, GroundTruth, StereoFrame
from stereocalib_core.geometry import StereoCamera, road_rotation, rotation_y
from stereocalib_core.numeric.arrays import Array


@dataclass(frozen=True)
class PairCorrection:
    """How the right camera truly stands, and the scale of depths.

    pitch_rad, roll_rad, yaw_rad: P_right = Rx(pitch) Rz(roll) Ry(yaw) P, by which it is turned out of the pair that
    the calibration describes. depth_scale: true depth over the depth by focal length and baseline as calibrated.
    """

    pitch_rad: float = 0.0
    roll_rad: float = 0.0
    yaw_rad: float = 0.0
    depth_scale: float = 1.0

    @property
    def R_turned_assumed(self) -> Array:
        """(3, 3) from where the calibration has the right camera to where it is."""
        return road_rotation(self.pitch_rad, self.roll_rad) @ rotation_y(self.yaw_rad)

    @property
    def nothing(self) -> bool:
        """Whether it changes nothing."""
        return self == PairCorrection()


def maps_of(
    camera: StereoCamera, correction: PairCorrection
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(H, W) float32 u and v of the recorded right picture for every pixel of the one turned back."""
    cx = camera.cx_px if camera.cx_right_px is None else camera.cx_right_px
    u, v = np.meshgrid(np.arange(camera.width, dtype=np.float64), np.arange(camera.height, dtype=np.float64))
    f = camera.focal_px
    rays = (
        np.stack([(u - cx) / f, (v - camera.cy_px) / f, np.ones_like(u)], axis=-1)
        @ correction.R_turned_assumed.T
    )
    seen = rays[..., :2] / rays[..., 2:]
    return (seen[..., 0] * f + cx).astype(np.float32), (seen[..., 1] * f + camera.cy_px).astype(np.float32)


@dataclass(frozen=True)
class MendedSource:
    """`source` with its pair mended; everything else is the source's own."""

    source: FrameSource
    correction: PairCorrection

    @property
    def name(self) -> str:
        """The source's."""
        return self.source.name

    @cached_property
    def camera(self) -> StereoCamera:
        """The source's, its baseline to scale."""
        camera = self.source.camera
        return dataclasses.replace(camera, baseline_m=camera.baseline_m * self.correction.depth_scale)

    @property
    def timestamps_s(self) -> NDArray[np.float64]:
        """(N,) the source's."""
        return self.source.timestamps_s

    @property
    def ground_truth(self) -> GroundTruth | None:
        """The source's."""
        return self.source.ground_truth

    @property
    def notices(self) -> tuple[str, ...]:
        """The source's."""
        return self.source.notices

    @property
    def T_camera_lidar(self) -> NDArray[np.float64] | None:
        """The source's: the left camera has not moved."""
        return self.source.T_camera_lidar

    @property
    def content_key(self) -> str:
        """Of the source and the correction."""
        return f"{self.source.content_key} mended by {self.correction!r}"

    @property
    def live(self) -> bool:
        """The source's."""
        return self.source.live

    def __len__(self) -> int:
        return len(self.source)

    @cached_property
    def _maps(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        return maps_of(self.source.camera, self.correction)

    def __getitem__(self, index: int) -> StereoFrame:
        frame = self.source[index]
        if frame.right is None:
            return frame
        # cubic: a blurred picture beside a sharp one would match worse
        right = cv2.remap(frame.right, *self._maps, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        return dataclasses.replace(frame, right=np.asarray(right, dtype=np.uint8))


def mended(source: FrameSource, correction: PairCorrection) -> FrameSource:
    """The source with its pair mended, or itself where there is nothing to mend."""
    return source if correction.nothing else MendedSource(source, correction)
