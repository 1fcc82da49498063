"""A plain folder: `left/` `right/` with equal names, `camera.yaml`, optional `times.txt`, `poses.txt`."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

from stereocalib_core.errors import SourceError
from stereocalib_core.frames import Recording, StereoFrame
from stereocalib_core.sources.calibrations.own_yaml import read_camera_file
from stereocalib_core.sources.calibrations.rectify import Rectifier
from stereocalib_core.sources.lists import KITTI_FPS, frame_times, read_ground_truth, read_times
from stereocalib_core.sources.pairing import PairReader, check_usable, content_key, match_pairs
from stereocalib_core.sources.pictures import PictureFormat, survey


def is_plain_folder(folder: Path) -> bool:
    """Whether a folder looks like one."""
    return (folder / "left").is_dir() and (folder / "right").is_dir()


def open_folder(folder: Path) -> Recording:
    """A plain folder as a recording; raises SourceError."""
    camera_file = folder / "camera.yaml"
    if not camera_file.is_file():
        remedy = "write width height focal_px cx_px cy_px baseline_m into it"
        raise SourceError("no camera.yaml beside left/ and right/", folder, remedy)
    described = read_camera_file(camera_file)
    camera = described.camera
    pairs = match_pairs(folder / "left", folder / "right", numbered=False)
    found = survey(pairs.present(), folder)
    if (found.width, found.height) != (camera.width, camera.height):
        sizes = f"pictures are {found.width}x{found.height}, camera.yaml says {camera.width}x{camera.height}"
        raise SourceError("pictures do not fit the camera", folder, sizes)
    picture = PictureFormat(camera.width, camera.height, found.bits)
    check_usable(pairs, picture, folder)
    times_s, time_notices = frame_times(
        read_times(folder / "times.txt"), pairs.rows, described.fps or KITTI_FPS, "times.txt"
    )
    truth, truth_notices = read_ground_truth(folder / "poses.txt", folder / "extrinsics_gt.csv", pairs.rows)
    read_pair = PairReader(pairs, picture, times_s)
    files = [camera_file, *(folder / name for name in ("times.txt", "poses.txt", "extrinsics_gt.csv"))]
    return Recording(
        name=folder.name,
        camera=camera,
        timestamps_s=times_s,
        load=read_pair if described.rectifier is None else rectifying(read_pair, described.rectifier),
        ground_truth=truth,
        notices=(*pairs.notices, *time_notices, *truth_notices),
        content_key=content_key("folder", [*pairs.present(), *files], pairs.stems),
    )


def rectifying(load: Callable[[int], StereoFrame], rectifier: Rectifier) -> Callable[[int], StereoFrame]:
    """The same reader with both pictures rectified."""

    def load_rectified(index: int) -> StereoFrame:
        frame = load(index)
        if frame.left is None or frame.right is None:
            return frame
        left, right = rectifier.apply(frame.left, frame.right)
        return dataclasses.replace(frame, left=left, right=right)

    return load_rectified
