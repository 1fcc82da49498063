"""What a recording gives: stereo frames with a time, a camera, and the truth where there is one."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.calibration import StereoCalibration
from stereocalib_core.config.reading import LATE_S
from stereocalib_core.errors import Failure
from stereocalib_core.geometry import StereoCamera


def epoch_of(first_s: float) -> float:
    """The whole second that a recording's times are counted from: that of its first, 0 for one that starts near 0."""
    return float(math.floor(first_s)) if abs(first_s) >= LATE_S else 0.0


@dataclass(frozen=True)
class StereoFrame:
    """One stereo pair.

    left, right: (H, W) uint8 grey images, or None where `failure` says why.
    lidar: (N, 4) float32 points x y z [m] and intensity in the LiDAR's frame, or None.
    camera: the pair's own where it differs from the recording's, as in sets of single pairs.
    timestamp_s: since the recording's `epoch_s`.
    lidar_sweep: turns of the LiDAR from frame to frame, > 0 counter-clockwise seen from above, with the shutter when it
        faces ahead; 0: a scan of one moment, or made one; None: not known.
    """

    index: int
    timestamp_s: float
    left: NDArray[np.uint8] | None
    right: NDArray[np.uint8] | None
    failure: Failure | None = None
    lidar: NDArray[np.float32] | None = None
    camera: StereoCamera | None = None
    lidar_sweep: float | None = None


@dataclass(frozen=True)
class GroundTruth:
    """The truth as far as a recording has it; every array has one entry per frame, NaN = unknown.

    poses: (N, 4, 4) T_world_camera of the left camera, world = first left camera; or None.
    extrinsics: (N, 4) height [m], pitch, roll, yaw [rad]; or None.
    heading_reliable: False where only path length may be compared.
    """

    poses: NDArray[np.float64] | None = None
    extrinsics: NDArray[np.float64] | None = None
    heading_reliable: bool = True


class FrameSource(Protocol):
    """A drive: `len`, `[i]`, one camera, times, and what is known of the truth.

    `[i]` never raises for a damaged frame: it gives a `StereoFrame` with a `failure`.
    `notices` says in one line each what the recording lacks or what was left unused.
    `T_camera_lidar` (4, 4) is given where frames carry LiDAR scans.
    `content_key` changes when the content changes (names a cache).
    `timestamps_s`: (N,) since `epoch_s`, the whole second since 1970 at which a recording that counts from there
    begins, else 0: seconds since 1970 in one float resolve a quarter of a microsecond only.
    `live`: frames come as they happen, `[i]` gives the newest one and raises IndexError when there are no more.
    """

    @property
    def name(self) -> str: ...

    @property
    def camera(self) -> StereoCamera: ...

    @property
    def timestamps_s(self) -> NDArray[np.float64]: ...

    @property
    def epoch_s(self) -> float: ...

    @property
    def ground_truth(self) -> GroundTruth | None: ...

    @property
    def notices(self) -> tuple[str, ...]: ...

    @property
    def T_camera_lidar(self) -> NDArray[np.float64] | None: ...

    @property
    def content_key(self) -> str: ...

    @property
    def live(self) -> bool: ...

    def __len__(self) -> int: ...

    def __getitem__(self, index: int) -> StereoFrame: ...


@dataclass(frozen=True)
class Recording:
    """A `FrameSource` made of parts; the loaders build these.

    `load(i)` reads frame i. `calibration` is what its files say of the pair, raw lenses included. Everything
    else is as in `FrameSource`.
    """

    name: str
    camera: StereoCamera
    timestamps_s: NDArray[np.float64]
    load: Callable[[int], StereoFrame]
    ground_truth: GroundTruth | None = None
    notices: tuple[str, ...] = ()
    T_camera_lidar: NDArray[np.float64] | None = field(default=None)
    content_key: str = ""
    live: bool = False
    calibration: StereoCalibration | None = None
    epoch_s: float = 0.0

    def __len__(self) -> int:
        return len(self.timestamps_s)

    def __getitem__(self, index: int) -> StereoFrame:
        if not 0 <= index < len(self):
            raise IndexError(index)
        return self.load(index)
