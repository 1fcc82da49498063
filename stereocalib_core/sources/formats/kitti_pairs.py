"""KITTI stereo 2012 and 2015 and object: single pairs, each with a calibration of its own in `calib/NNNNNN.txt` or
`calib_cam_to_cam/NNNNNN.txt`; object has a scan of each in `velodyne/`."""

from __future__ import annotations

import dataclasses
from collections import Counter
from pathlib import Path

import numpy as np

from stereocalib_core.calibration import Size, StereoCalibration
from stereocalib_core.config.reading import UNSTATED_FPS
from stereocalib_core.errors import Failure, FailureReason, SourceError
from stereocalib_core.frames import Recording, StereoFrame
from stereocalib_core.geometry import StereoCamera
from stereocalib_core.sources.assembly import Load, unit_of
from stereocalib_core.sources.calibrations import kitti, read_calibration
from stereocalib_core.sources.calibrations.rectify import opened
from stereocalib_core.sources.format import Format, SourceKind, Spec
from stereocalib_core.sources.lidar_scans import scans_by_number, with_scan
from stereocalib_core.sources.pairing import PairReader, Pairs, content_key, has_pictures, match_pairs
from stereocalib_core.sources.picture_size import size_of_file
from stereocalib_core.sources.pictures import PictureFormat, survey

FOLDERS = (("image_0", "image_1", 0), ("image_2", "image_3", 2), ("colored_0", "colored_1", 2))
CALIBRATIONS = ("calib", "calib_cam_to_cam")


def _calibrations(folder: Path) -> dict[str, Path]:
    """Number of a pair to its calibration file."""
    for name in CALIBRATIONS:
        found = {path.stem: path for path in sorted((folder / name).glob("*.txt")) if path.stem.isdecimal()}
        if found:
            return found
    return {}


def _accepts(spec: Spec) -> bool:
    folder = spec.folder
    return (
        folder is not None
        and any((folder / left).is_dir() for left, _, _ in FOLDERS)
        and any((folder / name).is_dir() for name in CALIBRATIONS)
        and bool(_calibrations(folder))
    )


def _open(spec: Spec) -> Recording:
    assert spec.folder is not None
    folder = spec.folder
    both = [f for f in FOLDERS if all(has_pictures(folder / name) for name in f[:2])]
    if not both:
        present = [name for f in FOLDERS for name in f[:2] if (folder / name).is_dir()]
        raise SourceError("pictures of one camera only", folder, f"{', '.join(present)} needs its other side")
    left, right, first = both[0]
    pairs = match_pairs(folder / left, folder / right, numbered=False)
    calibrations = _calibrations(folder)
    picture = survey(pairs.present(), folder)
    cameras: list[StereoCamera | Failure] = []
    T_lidar: list[np.ndarray | None] = []
    named = (
        read_calibration(spec.options["calibration"], unit_of(spec.options))
        if spec.options.get("calibration")
        else None
    )
    for i, stem in enumerate(pairs.stems):
        path = calibrations.get(stem) or calibrations.get(stem.partition("_")[0])
        try:
            if named is None and path is None:
                raise SourceError(f"no calibration for {stem}", folder, "add its file")
            found = named.calibration if named is not None else _read(path, first)  # type: ignore[arg-type]
            size = _size(pairs, i) or (picture.width, picture.height)
            cameras.append(opened(found, size, path or folder).camera)
            T_lidar.append(found.T_camera_lidar)
        except SourceError as error:
            cameras.append(Failure(FailureReason.UNREADABLE, f"calibration of {stem}: {error.what}"))
            T_lidar.append(None)
    usable = [camera for camera in cameras if isinstance(camera, StereoCamera)]
    if not usable:
        bad = next(iter(calibrations.values()))
        raise SourceError("no pair has a calibration that can be read", bad, "expected P0 ... P3 in each")
    camera = Counter(usable).most_common(1)[0][0]
    times_s = np.arange(len(pairs)) / UNSTATED_FPS
    load: Load = _Reader(pairs, cameras, camera, picture.bits, times_s)
    notices = [*pairs.notices, "single pairs: no path is driven between them"]
    if (others := len(set(usable)) - 1) > 0:
        notices.append(f"{others + 1} different calibrations: every pair is measured with its own")
    scans = scans_by_number(folder / "velodyne")
    # the LiDAR's place differs from day to day as well; scans are used where it is that of the drive's camera
    T = next((T for T, c in zip(T_lidar, cameras, strict=True) if c == camera and T is not None), None)
    if scans and T is not None:
        rows = [
            int(stem.partition("_")[0]) if stem.partition("_")[0].isdecimal() else -1 for stem in pairs.stems
        ]
        same = [t is not None and np.array_equal(t, T) for t in T_lidar]
        load, notes = with_scan(load, scans, [row if ok else -1 for row, ok in zip(rows, same, strict=True)])
        notices += notes
    files = [*pairs.present(), *calibrations.values(), *scans.values()]
    return Recording(
        name=folder.name,
        camera=camera,
        timestamps_s=times_s,
        load=load,
        notices=tuple(notices),
        T_camera_lidar=T if scans else None,
        content_key=content_key("kitti_pairs", files, pairs.stems),
        calibration=StereoCalibration.of_camera(camera),
    )


def _read(path: Path, first: int) -> StereoCalibration:
    return kitti.read(kitti.read_lines(path), path, (first, first + 1))


def _size(pairs: Pairs, index: int) -> Size | None:
    path = pairs.left[index]
    return None if path is None else size_of_file(path)


class _Reader:
    """Reads each pair at its own size; one that has a camera of its own carries it."""

    def __init__(
        self,
        pairs: Pairs,
        cameras: list[StereoCamera | Failure],
        usual: StereoCamera,
        bits: int,
        times_s: np.ndarray,
    ) -> None:
        self._cameras, self._usual, self._times = cameras, usual, times_s
        self._readers = {
            size: PairReader(pairs, PictureFormat(*size, bits), times_s)
            for size in {(c.width, c.height) for c in cameras if isinstance(c, StereoCamera)}
        }

    def __call__(self, index: int) -> StereoFrame:
        camera = self._cameras[index]
        if isinstance(camera, Failure):
            return StereoFrame(index, float(self._times[index]), None, None, camera)
        frame = self._readers[camera.width, camera.height](index)
        return frame if camera == self._usual else dataclasses.replace(frame, camera=camera)


FORMAT = Format("KITTI stereo or object pairs", _accepts, _open, SourceKind.KITTI_PAIRS)
