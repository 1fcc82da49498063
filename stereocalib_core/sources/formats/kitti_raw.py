"""A KITTI raw drive folder, read with pykitti.

pykitti lists files and calibration but matches nothing: a missing right image shifts all later pairs, and
a missing file of OXTS, velodyne or calibration ends it. So names and numbers are matched here.
"""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.errors import SourceError
from stereocalib_core.frames import GroundTruth, Recording
from stereocalib_core.geometry import invert_transform
from stereocalib_core.sources.formats.kitti_odometry import stereo_camera
from stereocalib_core.sources.lidar_scans import scans_by_number, with_scan
from stereocalib_core.sources.lists import KITTI_FPS, frame_times, from_first
from stereocalib_core.sources.pairing import (
    PairReader,
    Pairs,
    check_usable,
    content_key,
    match_pairs,
)
from stereocalib_core.sources.pictures import survey
from stereocalib_core.system.tables import parse_numbers

CALIB_FILES = ("calib_cam_to_cam.txt", "calib_velo_to_cam.txt", "calib_imu_to_velo.txt")
OXTS_COLUMNS = 30


def is_drive(folder: Path) -> bool:
    """Whether a folder looks like a raw drive."""
    return (folder / "image_00" / "data").is_dir()


def open_drive(folder: Path) -> Recording:
    """A synchronised and rectified raw drive as a recording; raises SourceError."""
    if folder.name.endswith("_extract"):
        raise SourceError("unrectified raw drive", folder, "use the `_sync` download of the same drive")
    date_folder = _date_folder(folder)
    calib = _read_calib(date_folder)
    pairs = match_pairs(folder / "image_00" / "data", folder / "image_01" / "data", numbered=True)
    picture = survey(pairs.present(), folder)
    cam_file = date_folder / CALIB_FILES[0]
    camera = stereo_camera(calib["P_rect_00"], calib["P_rect_10"], (picture.width, picture.height), cam_file)
    check_usable(pairs, picture, folder)

    times_file = folder / "image_00" / "timestamps.txt"
    times_s, notices = frame_times(
        _read_timestamps(times_file), pairs.rows, KITTI_FPS, "image_00/timestamps.txt"
    )
    notices = [*pairs.notices, *notices]
    truth, truth_notices = _ground_truth(folder, pairs, calib.get("T_cam0_imu"))
    notices += truth_notices

    scans = scans_by_number(folder / "velodyne_points" / "data")
    T_camera_lidar = calib.get("T_cam0_velo") if scans else None
    load: Any = PairReader(pairs, picture, times_s)
    if T_camera_lidar is not None:
        load, note = with_scan(load, scans, pairs.rows)
        notices += note
    elif scans:
        notices.append(f"velodyne scans without {CALIB_FILES[1]}: left unused")
    else:
        notices.append("no velodyne scans")
    files = [*pairs.present(), *scans.values(), *(date_folder / name for name in CALIB_FILES), times_file]
    return Recording(
        name=folder.name,
        camera=camera,
        timestamps_s=times_s,
        load=load,
        ground_truth=truth,
        notices=tuple(notices),
        T_camera_lidar=T_camera_lidar,
        content_key=content_key("kitti_raw", files, pairs.stems, truth is not None),
    )


def _date_folder(folder: Path) -> Path:
    """Where the calibration of the drive lies: beside its folder, or beside what that links to."""
    beside = folder.parent, folder.resolve().parent
    return next((place for place in beside if (place / CALIB_FILES[0]).is_file()), folder.parent)


def _read_calib(date_folder: Path) -> dict[str, Any]:
    """pykitti's calibration of the date folder; only the camera's part is indispensable."""
    import pykitti

    class Calibration(pykitti.raw):
        """pykitti's readers without its demand that every file be there."""

        def __init__(self) -> None:
            self.calib_path = str(date_folder)

        def read(self) -> dict[str, Any]:
            has_velo, has_imu = ((date_folder / name).is_file() for name in CALIB_FILES[1:])
            if not has_velo:
                cam = pykitti.utils.read_calib_file(str(date_folder / CALIB_FILES[0]))
                return {
                    "P_rect_00": cam["P_rect_00"].reshape(3, 4),
                    "P_rect_10": cam["P_rect_01"].reshape(3, 4),
                }
            data: dict[str, Any] = self._load_calib_cam_to_cam(CALIB_FILES[1], CALIB_FILES[0])
            if has_imu:
                data["T_cam0_imu"] = data["T_cam0_velo"] @ self._load_calib_rigid(CALIB_FILES[2])
            return data

    where = date_folder / CALIB_FILES[0]
    if not where.is_file():
        raise SourceError(
            "no calibration of the drive's date", where, "download and unpack the calibration archive"
        )
    try:
        calib = Calibration().read()
    except (KeyError, ValueError, OSError) as error:
        raise SourceError(
            "bad calibration", date_folder, f"one of its calib files is damaged ({error})"
        ) from error
    for name, value in calib.items():
        if not np.isfinite(value).all():
            raise SourceError(
                f"calibration {name} is not finite", date_folder, "unpack the calibration again"
            )
    return calib


def _read_timestamps(path: Path) -> NDArray[np.float64] | None:
    """Seconds since the first line of a list of `date time` with nanoseconds; None where it is missing."""
    if not path.is_file():
        return None
    nanoseconds: list[int] = []
    for number, line in enumerate(path.read_text(encoding="ascii", errors="replace").splitlines(), start=1):
        if not line.strip():
            continue
        head, _, fraction = line.strip().partition(".")
        try:
            start = datetime.strptime(head, "%Y-%m-%d %H:%M:%S")
            nanoseconds.append(
                int((start - datetime(2000, 1, 1)).total_seconds()) * 10**9 + int(f"{fraction:0<9.9}")
            )
        except ValueError as error:
            raise SourceError("bad time", f"{path}, line {number}", "expected `date time`") from error
    return np.array([n - nanoseconds[0] for n in nanoseconds], dtype=np.float64) / 1e9


def _ground_truth(
    folder: Path, pairs: Pairs, T_camera_imu: NDArray[np.float64] | None
) -> tuple[GroundTruth | None, list[str]]:
    """Left-camera poses from OXTS. Its heading is not good enough to judge a heading by."""
    from pykitti.utils import load_oxts_packets_and_poses

    data = folder / "oxts" / "data"
    if T_camera_imu is None or not data.is_dir():
        missing = "OXTS" if T_camera_imu is not None else f"{CALIB_FILES[2]} or {CALIB_FILES[1]}"
        return None, [f"no {missing}: no ground truth, errors are not computed"]
    frames, files = [], []
    for frame, stem in enumerate(pairs.stems):
        path = data / f"{stem}.txt"
        values = (
            parse_numbers(path.read_text(encoding="ascii", errors="replace").split())
            if path.is_file()
            else None
        )
        if values is not None and len(values) == OXTS_COLUMNS:
            frames.append(frame)
            files.append(str(path))
    if not files:
        return None, ["no OXTS packet for any picture: no ground truth, errors are not computed"]
    T_world_imu = np.array([packet.T_w_imu for packet in load_oxts_packets_and_poses(files)])
    poses = np.full((len(pairs), 4, 4), np.nan)
    poses[frames] = T_world_imu @ invert_transform(T_camera_imu)
    notices = ["ground truth from OXTS: judged by path length, its heading is not reliable"]
    if len(files) < len(pairs):
        notices.append(f"OXTS packets for {len(files)} of {len(pairs)} frames")
    return GroundTruth(poses=from_first(poses), heading_reliable=False), notices
