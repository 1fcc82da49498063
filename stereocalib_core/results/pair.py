"""What a drive says of its own stereo pair, and how to mend it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from stereocalib_core.config.verdicts import SURE
from stereocalib_core.geometry import Array, road_rotation, rotation_y
from stereocalib_core.results.frame import Measured

Verdict = Literal["good", "suspect", "bad", "not measured"]
VERDICTS: tuple[Verdict, ...] = ("good", "not measured", "suspect", "bad")
"""From best to worst."""


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

    @classmethod
    def of(cls, R_turned_assumed: Array, depth_scale: float) -> PairCorrection:
        """From a (3, 3) rotation, the inverse of `R_turned_assumed`."""
        R = R_turned_assumed
        return cls(
            float(np.arctan2(R[2, 1], R[1, 1])),
            float(-np.arcsin(R[0, 1])),
            float(np.arctan2(R[0, 2], R[0, 0])),
            depth_scale,
        )

    def then(self, found: PairCorrection) -> PairCorrection:
        """This correction and what was `found` in a drive that it was applied to, as one."""
        R = self.R_turned_assumed @ found.R_turned_assumed
        return PairCorrection.of(R, self.depth_scale * found.depth_scale)


@dataclass(frozen=True)
class DepthScale:
    """True depth over measured depth, and whom to believe for that."""

    value: float
    sigma: float
    source: Literal["lidar", "truth", "none"]


@dataclass(frozen=True)
class PairChange:
    """One camera was knocked against the other: from `frame` on the angle about `axis` is larger by `size` [rad]."""

    frame: int
    axis: Literal["pitch", "roll", "yaw"]
    size_rad: float
    sigma_rad: float


@dataclass(frozen=True)
class BendEffects:
    """What the pair's bend does to the numbers of its user, read minus true.

    depth_share: of the depth of a thing `REFERENCE_M` away. pitch_rad: of the road. height_share, path_share: of the
    camera's height and of the path's length.
    """

    depth_share: float
    pitch_rad: float
    height_share: float
    path_share: float


@dataclass(frozen=True)
class Pair:
    """Is the stereo pair itself still calibrated over the drive? None = not measured.

    verdict, why: of all that follows. rows_verdict, rows_why: of the rows alone.
    row_offset_px: right row minus left row at the principal point [px].
    relative_pitch_rad: the same as an angle, > 0: the right camera looks further down.
    relative_roll_rad: > 0: the right picture's rows fall to the right.
    relative_yaw_rad: by the motion of the car; > 0: things lie further right in the right picture than they should, and
        every disparity is too small.
    disparity_offset_px: focal length times that, to be added to measured disparities at the middle of the picture.
    depth_scale: true over measured depth once the rest is mended.
    keystone_rad: the part of the row offset that goes with u v / f, as the relative yaw that it would be.
    frames: how many frames were measured by their rows. first, last: the frames that the row values speak of.
    pairs: how many pairs of frames gave the yaw. yaw_halves: [rad] by the odd and the even ones alone; yaw_thirds: by
        the parts of the drive.
    changes: knocks within the drive; the values are then those after the last one.
    by_lidar_px: the disparity offset that the LiDAR shows, by itself. lidar_halves: disparity offset [px] and depth
        scale by the odd and by the even scans alone; empty where there are too few.
    effects: of the bend, None where none is known. yaw_reason: why there is no yaw.
    yaw_mends: whether the yaw is beyond what a scale of depth that nobody measured could undo: only then it is mended.
    """

    verdict: Verdict = "not measured"
    why: str = "not measured"
    row_offset_px: Measured | None = None
    relative_pitch_rad: Measured | None = None
    relative_roll_rad: Measured | None = None
    relative_yaw_rad: Measured | None = None
    disparity_offset_px: Measured | None = None
    depth_scale: DepthScale | None = None
    keystone_rad: float = float("nan")
    frames: int = 0
    first: int = -1
    last: int = -1
    rows_verdict: Verdict = "suspect"
    rows_why: str = "not measured"
    pairs: int = 0
    yaw_halves: tuple[float, ...] = ()
    yaw_thirds: tuple[float, ...] = ()
    changes: tuple[PairChange, ...] = ()
    by_lidar_px: Measured | None = None
    lidar_halves: tuple[tuple[float, float], ...] = ()
    effects: BendEffects | None = None
    yaw_reason: str | None = None
    yaw_mends: bool = True

    @property
    def correction(self) -> PairCorrection | None:
        """What mends the pair, None where it could not be measured.

        The scale belongs to it where a LiDAR gave it, for certain: a path that the drive is judged by may not mend it
        first. Rows that are good are left alone where there is nothing else to mend, since every mending costs
        sharpness.
        """
        if self.verdict == "not measured" or (
            self.relative_yaw_rad is None and self.relative_roll_rad is None
        ):
            return None
        yaw, scale = _value(self.relative_yaw_rad) if self.yaw_mends else 0.0, 1.0
        by_lidar = self.depth_scale
        if by_lidar is not None and by_lidar.source == "lidar":
            scale = by_lidar.value if abs(by_lidar.value - 1.0) > SURE * by_lidar.sigma else 1.0
        if self.rows_verdict == "good" and yaw == 0.0 and scale == 1.0:
            return PairCorrection()
        return PairCorrection(
            pitch_rad=_value(self.relative_pitch_rad),
            roll_rad=_value(self.relative_roll_rad),
            yaw_rad=yaw,
            depth_scale=scale,
        )


@dataclass(frozen=True)
class Mending:
    """A drive that was run again with its pair mended; all its numbers are for the pair as `correction` has it.

    from_frame: the first frame that was mended; those before a knock were left as they are. before: the pair as it
    was calibrated.
    """

    correction: PairCorrection
    from_frame: int
    before: Pair


def _value(measured: Measured | None) -> float:
    return 0.0 if measured is None else measured.value


def worst(*verdicts: Verdict) -> Verdict:
    """The worst of some verdicts."""
    return max(verdicts, key=VERDICTS.index)
