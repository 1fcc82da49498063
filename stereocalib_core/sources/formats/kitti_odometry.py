"""A KITTI odometry sequence folder: `image_0 image_1 calib.txt times.txt`, poses two folders up."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.errors import SourceError
from stereocalib_core.frames import Recording, StereoFrame
from stereocalib_core.geometry import StereoCamera
from stereocalib_core.sources.lidar_scans import scans_by_number, with_scan
from stereocalib_core.sources.lists import KITTI_FPS, frame_times, read_ground_truth, read_times
from stereocalib_core.sources.pairing import PairReader, check_usable, content_key, match_pairs
from stereocalib_core.sources.pictures import survey
from stereocalib_core.system.tables import parse_numbers


def is_sequence(folder: Path) -> bool:
    """Whether a folder looks like a sequence."""
    return (folder / "calib.txt").is_file() and any((folder / f"image_{i}").is_dir() for i in (0, 2))


def read_calib(path: Path) -> dict[str, NDArray[np.float64]]:
    """The `P0: ... P3: ... Tr: ...` lines of a calib.txt as (3, 4) matrices; others are passed over.

    Raises SourceError for one of these that is not twelve finite numbers.
    """
    matrices = {}
    try:
        lines = path.read_text(encoding="ascii", errors="replace").splitlines()
    except OSError as error:
        raise SourceError("calibration cannot be read", path, error.strerror or "check the file") from error
    for number, line in enumerate(lines, start=1):
        key, _, rest = line.partition(":")
        if key.strip() not in ("P0", "P1", "P2", "P3", "Tr"):
            continue
        values = parse_numbers(rest.split())
        if values is None or len(values) != 12:
            where = f"{path}, line {number}"
            raise SourceError(f"bad calibration of {key.strip()}", where, "expected 12 finite numbers")
        matrices[key.strip()] = np.array(values).reshape(3, 4)
    return matrices


def stereo_camera(
    P_left: NDArray[np.float64], P_right: NDArray[np.float64], size: tuple[int, int], where: object
) -> StereoCamera:
    """Two (3, 4) rectified projection matrices and (width, height) to a camera; raises SourceError."""
    focal, cx, cy = P_left[0, 0], P_left[0, 2], P_left[1, 2]
    if not (focal > 0 and P_left[1, 1] > 0 and P_right[0, 0] > 0):
        raise SourceError(
            "calibration without a focal length", where, "P must be [f 0 cx fb; 0 f cy 0; 0 0 1 0]"
        )
    if abs(P_left[1, 1] / focal - 1) > 1e-3 or abs(P_right[0, 0] / focal - 1) > 1e-3:
        raise SourceError("focal lengths differ", where, "the pictures must be rectified to one camera")
    baseline = float(P_left[0, 3] / focal - P_right[0, 3] / P_right[0, 0])
    if not 1e-3 < baseline < 100:
        raise SourceError(
            f"baseline of {baseline:g} m", where, "the right camera must lie to the right of the left one"
        )
    width, height = size
    if not (-width < cx < 2 * width and -height < cy < 2 * height):
        raise SourceError(
            f"principal point ({cx:g}, {cy:g}) px", where, f"does not fit pictures of {width}x{height}"
        )
    cx_right = float(P_right[0, 2])
    return StereoCamera(
        width, height, float(focal), float(cx), float(cy), baseline, None if cx_right == cx else cx_right
    )


def _poses_file(folder: Path) -> Path:
    """Where the truth of a sequence lies: two folders up from it, or from what it links to."""
    files = [f.parent.parent / "poses" / f"{f.name}.txt" for f in (folder, folder.resolve())]
    return next((file for file in files if file.is_file()), files[0])


def open_sequence(folder: Path) -> Recording:
    """A sequence folder as a recording; raises SourceError."""
    grey = (folder / "image_0").is_dir()
    left, right = ("0", "1") if grey else ("2", "3")
    calib_file = folder / "calib.txt"
    calib = read_calib(calib_file)
    for name in (f"P{left}", f"P{right}"):
        if name not in calib:
            raise SourceError(f"calibration has no {name}", calib_file, "it needs the line of both cameras")
    # a synthetic drive that was written has truth for dropped frames as well, the first and the last included
    known = {path.stem for path in (folder / "disparity_gt").glob("*.png")}
    pairs = match_pairs(folder / f"image_{left}", folder / f"image_{right}", True, known)
    picture = survey(pairs.present(), folder)
    camera = stereo_camera(calib[f"P{left}"], calib[f"P{right}"], (picture.width, picture.height), calib_file)
    check_usable(pairs, picture, folder)

    times_s, time_notices = frame_times(read_times(folder / "times.txt"), pairs.rows, KITTI_FPS, "times.txt")
    poses_file = _poses_file(folder)
    truth_file = folder / "extrinsics_gt.csv"
    truth, truth_notices = read_ground_truth(poses_file, truth_file, pairs.rows)
    notices = [*pairs.notices, *time_notices, *truth_notices]

    scans = scans_by_number(folder / "velodyne")
    T_camera_lidar = None
    read_pair = PairReader(pairs, picture, times_s)
    load: Callable[[int], StereoFrame] = read_pair
    if scans and "Tr" not in calib:
        notices.append("velodyne scans without Tr in calib.txt: left unused")
    elif scans:
        T_camera_lidar = np.vstack([calib["Tr"], [0.0, 0.0, 0.0, 1.0]])
        T_camera_lidar[:3, 3] += np.linalg.inv(calib[f"P{left}"][:, :3]) @ calib[f"P{left}"][:, 3]
        load, note = with_scan(read_pair, scans, pairs.rows)
        notices += note
    files = [*pairs.present(), calib_file, folder / "times.txt", poses_file, truth_file]
    return Recording(
        name=folder.name,
        camera=camera,
        timestamps_s=times_s,
        load=load,
        ground_truth=truth,
        notices=tuple(notices),
        T_camera_lidar=T_camera_lidar,
        content_key=content_key("kitti_odometry", [*files, *scans.values()], pairs.stems),
    )
