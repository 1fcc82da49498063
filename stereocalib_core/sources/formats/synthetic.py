"""The synthetic drive as a recording like any other."""

from __future__ import annotations

import hashlib
from functools import cache, cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stereocalib_core import simulator as synthetic
from stereocalib_core.config import scene
from stereocalib_core.errors import Failure, FailureReason
from stereocalib_core.frames import GroundTruth, StereoFrame
from stereocalib_core.geometry import StereoCamera
from stereocalib_core.numeric import wide
from stereocalib_core.simulator.cache import FrameCache, Pictures
from stereocalib_core.simulator.faults import any_active
from stereocalib_core.simulator.lookahead import Lookahead
from stereocalib_core.simulator.settings import DriveSettings, parse_spec
from stereocalib_core.simulator.studio import FrameTruth, Studio
from stereocalib_core.sources.formats.kept_world import keep_painted, keep_town, open_town


@cache
def renderer_version() -> str:
    """Changes with the code of the renderer: the digest of its own sources, and of its arithmetic."""
    digest = hashlib.sha256()
    for path in [*sorted(Path(synthetic.__file__).parent.glob("*.py")), Path(wide.__file__)]:
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


@cache
def town_version() -> str:
    """Changes with all that the town is painted by: the renderer, and what was chosen for its scene."""
    digest = hashlib.sha256(renderer_version().encode())
    digest.update(Path(scene.__file__).read_bytes())
    return digest.hexdigest()[:16]


def keep_town_of_this_version() -> None:
    """Paint the town of the embedded drive where that has not been done for this version."""
    keep_town(town_version())


class SyntheticSource:
    """A `FrameSource` that renders ahead of its reader and keeps what it rendered on disk.

    Frames may be read in any order, from any thread.
    """

    live = False
    epoch_s = 0.0

    def __init__(self, settings: DriveSettings, cache: FrameCache | None = None) -> None:
        self.settings = settings
        self.studio = Studio(settings)
        open_town(self.studio, town_version())
        self._town_kept = False
        self._cache = FrameCache(self.content_key) if cache is None else cache

    @classmethod
    def from_spec(cls, spec: str) -> SyntheticSource:
        """From `synthetic[:NAME][?key=value&...]`; ConfigError where that is not understood."""
        return cls(parse_spec(spec))

    @property
    def name(self) -> str:
        """The line that gives this drive."""
        return self.settings.spec()

    @property
    def camera(self) -> StereoCamera:
        """KITTI's unless told otherwise."""
        return self.settings.camera

    @property
    def timestamps_s(self) -> NDArray[np.float64]:
        """(N,) ten frames a second."""
        return self.studio.drive.timestamps_s

    @cached_property
    def ground_truth(self) -> GroundTruth:
        """Exact poses and extrinsics."""
        return GroundTruth(self.studio.poses(), self.studio.drive.extrinsics)

    @property
    def notices(self) -> tuple[str, ...]:
        """Nothing is lacking."""
        return ()

    @property
    def T_camera_lidar(self) -> NDArray[np.float64] | None:
        """(4, 4) as calibrated, with `lidar=1`; a `lidar_knock` moves the sensor, not this."""
        return self.studio.T_camera_lidar if self.settings.lidar else None

    @cached_property
    def content_key(self) -> str:
        """Names everything that the frames depend on, the pose file's content included."""
        text = f"{renderer_version()} {self.settings!r}"
        digest = hashlib.sha256(text.encode())
        if self.settings.path is not None:
            with open(self.settings.path, "rb") as file:
                digest.update(file.read())
        return digest.hexdigest()[:24]

    @cached_property
    def _lookahead(self) -> Lookahead[Pictures]:
        return Lookahead(self._make, len(self))

    def __len__(self) -> int:
        return len(self.studio.drive)

    def __getitem__(self, index: int) -> StereoFrame:
        if not 0 <= index < len(self):
            raise IndexError(index)
        time_s = float(self.timestamps_s[index])
        left, right, scan = self._lookahead.get(index)
        if any_active(self.settings.faults, "drop", index):
            return StereoFrame(
                index, time_s, None, None, Failure(FailureReason.MISSING_PAIR, "frame dropped"), scan
            )
        return StereoFrame(index, time_s, left, right, None, scan, lidar_sweep=0.0)

    def _make(self, index: int) -> Pictures:
        """One frame from the disk or from the studio."""
        kept = self._cache.read(index)
        if kept is not None:
            return kept
        pictures = self.studio.frame(index)
        if not self._town_kept:
            self._town_kept = True
            keep_painted(self.studio, town_version())
        self._cache.write(index, pictures)
        return pictures

    def truth(self, index: int) -> FrameTruth:
        """Dense true disparity and labels of the left picture."""
        if not 0 <= index < len(self):
            raise IndexError(index)
        return self.studio.truth(index)
