"""From the parts of a recording, found by its format, to the recording: what every format does in the same way."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from stereocalib_core.config.reading import UNSTATED_FPS
from stereocalib_core.errors import SourceError
from stereocalib_core.frames import GroundTruth, Recording, StereoFrame
from stereocalib_core.geometry import Array, transform
from stereocalib_core.sources.calibrations import Found, find_calibration, read_calibration
from stereocalib_core.sources.calibrations.rectify import Opened, Rectifier, opened
from stereocalib_core.sources.lidar_scans import with_scan
from stereocalib_core.sources.lists import frame_times, from_first
from stereocalib_core.sources.pairing import PairReader, Pairs, check_usable, content_key
from stereocalib_core.sources.pictures import PictureFormat, survey
from stereocalib_core.sources.times import Times

Load = Callable[[int], StereoFrame]
Truth = Callable[[Array], tuple[GroundTruth | None, list[str]]]
"""From the (N,) times of the frames to their truth and its notes."""


@dataclass(frozen=True)
class Parts:
    """What a format finds in its folder.

    found: the calibration of the pictures. times, times_name: the list of times, one a row, and its file's name.
    truth: gives the truth once the times of the frames are known. scans: number to LiDAR file.
    T_camera_lidar: (4, 4) into the left camera of the pictures. lidar_sweep: as in `StereoFrame`.
    files: all that the numbers depend on beside the pictures. size_matters: whether a calibration without a size is
    checked against the pictures by its centre.
    """

    kind: str
    folder: Path
    pairs: Pairs
    found: Found
    times: Times | None = None
    times_name: str = "times.txt"
    fps: float | None = None
    truth: Truth | None = None
    scans: Mapping[int, Path] = field(default_factory=dict)
    T_camera_lidar: Array | None = None
    lidar_sweep: float | None = None
    notices: Sequence[str] = ()
    files: Iterable[Path] = ()
    key: Sequence[object] = ()
    name: str | None = None


def recording(parts: Parts) -> Recording:
    """The recording; raises SourceError in one line where pictures and calibration do not make one."""
    pairs, folder = parts.pairs, parts.folder
    found = survey(pairs.present(), folder)
    size = found.width, found.height
    where = parts.found.files[0] if parts.found.files else folder
    ready = opened(parts.found.calibration, size, where)
    check_usable(pairs, found, folder)
    fps = parts.fps or parts.found.calibration.fps or UNSTATED_FPS
    times_s, epoch_s, time_notices = frame_times(parts.times, pairs.rows, fps, parts.times_name)
    truth, truth_notices = (None, []) if parts.truth is None else parts.truth(epoch_s + times_s)
    notices = [*pairs.notices, *time_notices, *truth_notices, *parts.notices, *ready.notes]
    load: Load = PairReader(pairs, PictureFormat(*size, found.bits), times_s)
    if ready.rectifier is not None:
        load = rectifying(load, ready.rectifier)
    T_camera_lidar = None
    if parts.scans and parts.T_camera_lidar is not None:
        T_camera_lidar = turned(parts.T_camera_lidar, ready)
        load, notes = with_scan(load, dict(parts.scans), pairs.rows, parts.lidar_sweep)
        notices += notes
    files = [*pairs.present(), *parts.files, *parts.found.files, *parts.scans.values()]
    return Recording(
        name=parts.name or folder.name,
        camera=ready.camera,
        timestamps_s=times_s,
        load=load,
        ground_truth=truth_of_rectified(truth, ready),
        notices=tuple(notices),
        T_camera_lidar=T_camera_lidar,
        content_key=content_key(parts.kind, files, pairs.stems, *parts.key),
        calibration=parts.found.calibration,
        epoch_s=epoch_s,
    )


def turned(T_camera_lidar: Array, ready: Opened) -> Array:
    """The LiDAR seen from the rectified left camera instead of the raw one."""
    if ready.rectifier is None:
        return T_camera_lidar
    return transform(ready.R_left, np.zeros(3)) @ T_camera_lidar


def truth_of_rectified(truth: GroundTruth | None, ready: Opened) -> GroundTruth | None:
    """Poses of the left camera as poses of the rectified one, which may look a little elsewhere."""
    if (
        truth is None
        or truth.poses is None
        or ready.rectifier is None
        or np.array_equal(ready.R_left, np.eye(3))
    ):
        return truth
    poses = truth.poses @ transform(ready.R_left.T, np.zeros(3))
    return dataclasses.replace(truth, poses=from_first(poses))


def rectifying(load: Load, rectifier: Rectifier) -> Load:
    """The same reader with both pictures rectified."""

    def load_rectified(index: int) -> StereoFrame:
        frame = load(index)
        if frame.left is None or frame.right is None:
            return frame
        left, right = rectifier.apply(frame.left, frame.right)
        return dataclasses.replace(frame, left=left, right=right)

    return load_rectified


def unit_of(options: Mapping[str, str]) -> str | None:
    """The unit of a calibration's lengths that the user states, `unit=mm`; raises SourceError for what is none."""
    unit = options.get("unit")
    if unit not in (None, "m", "cm", "mm"):
        raise SourceError(f"unit {str(unit)[:20]}", "the source's options", "use unit=m, unit=cm or unit=mm")
    return unit


def calibration_for(options: Mapping[str, str], *folders: Path, what: str = "") -> Found:
    """The calibration that the user named, else the first that lies in one of the folders; SourceError without."""
    named, unit = options.get("calibration"), unit_of(options)
    if named:
        return read_calibration(named, unit)
    for folder in folders:
        found = find_calibration(folder, unit)
        if found is not None:
            return found
    remedy = (
        "write width height focal_px cx_px cy_px baseline_m into camera.yaml there, put a calibration of "
    )
    remedy += "OpenCV, ROS or Kalibr there, or name one by --calibration"
    raise SourceError(f"no camera.yaml beside {what or 'the pictures'}", folders[0], remedy)
