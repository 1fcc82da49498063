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

from stereocalib_core.calibration import StereoCalibration
from stereocalib_core.frames import FrameSource, GroundTruth, StereoFrame
from stereocalib_core.geometry import StereoCamera
from stereocalib_core.results import PairCorrection


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
    """`source` with its pair mended from frame `first` on; everything else is the source's own."""

    source: FrameSource
    correction: PairCorrection
    first: int = 0

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
    def epoch_s(self) -> float:
        """The source's."""
        return self.source.epoch_s

    @property
    def ground_truth(self) -> GroundTruth | None:
        """The source's."""
        return self.source.ground_truth

    @property
    def notices(self) -> tuple[str, ...]:
        """The source's, and that its pair is mended."""
        c = self.correction
        yaw, roll, pitch = np.rad2deg([c.yaw_rad, c.roll_rad, c.pitch_rad])
        turned = f"yaw {yaw:+.4f}, roll {roll:+.4f}, pitch {pitch:+.4f} deg"
        line = f"the pair is mended: the right camera turned back by {turned}"
        if c.depth_scale != 1.0:
            line += f", depths scaled by {100.0 * (c.depth_scale - 1.0):+.2f} %"
        if self.first:
            line += f", from frame {self.first} on; frames before it are as they were calibrated"
        return (*self.source.notices, line)

    @property
    def T_camera_lidar(self) -> NDArray[np.float64] | None:
        """The source's: the left camera has not moved."""
        return self.source.T_camera_lidar

    @property
    def content_key(self) -> str:
        """Of the source and the correction."""
        return f"{self.source.content_key} mended from frame {self.first} by {self.correction!r}"

    @property
    def live(self) -> bool:
        """The source's."""
        return self.source.live

    @cached_property
    def calibration(self) -> StereoCalibration:
        """What describes the pair mended, for the same pictures."""
        return mended_calibration(self.source, self.correction)

    def __len__(self) -> int:
        return len(self.source)

    @cached_property
    def _maps(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        return maps_of(self.source.camera, self.correction)

    def __getitem__(self, index: int) -> StereoFrame:
        frame = self.source[index]
        if frame.right is None or index < self.first:
            return frame
        # A short kernel shifts fine texture by some hundredths of a pixel towards the pixel grid: the road of a
        # rendered drive, mended by 1.25 px, then reads 0.011 deg of pitch high by a cubic one, 0.003 deg by this.
        right = cv2.remap(frame.right, *self._maps, cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REPLICATE)
        return dataclasses.replace(frame, right=np.asarray(right, dtype=np.uint8))


def mended_calibration(source: FrameSource, correction: PairCorrection) -> StereoCalibration:
    """The calibration of the source's own pictures with the right camera where it truly is, its lenses kept."""
    own: StereoCalibration | None = getattr(source, "calibration", None)
    if own is None:
        own = StereoCalibration.of_camera(source.camera)
    size = source.camera.width, source.camera.height
    if own.rectified is not None and own.rectified.size is None:
        own = dataclasses.replace(own, rectified=dataclasses.replace(own.rectified, size=size))
    if own.lenses is not None and own.lenses.size is None:
        own = dataclasses.replace(own, lenses=dataclasses.replace(own.lenses, size=size))
    return own.mended(correction.R_turned_assumed, correction.depth_scale)


def mended(source: FrameSource, correction: PairCorrection, first: int = 0) -> FrameSource:
    """The source with its pair mended from frame `first` on, or itself where there is nothing to mend."""
    return source if correction.nothing else MendedSource(source, correction, first)
