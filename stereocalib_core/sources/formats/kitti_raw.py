"""A KITTI raw drive folder, grey or colour, its calibration beside it, inside it or named.

pykitti reads OXTS; it matches nothing: a missing right image shifts all later pairs, and a missing file ends it. So
names and numbers are matched here.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.errors import SourceError
from stereocalib_core.frames import GroundTruth, Recording
from stereocalib_core.geometry import Array, invert_transform, transform
from stereocalib_core.sources.assembly import Parts, recording, unit_of
from stereocalib_core.sources.calibrations import Found, kitti, read_calibration
from stereocalib_core.sources.calibrations.trees import Tree
from stereocalib_core.sources.format import Format, SourceKind, Spec
from stereocalib_core.sources.lidar_scans import scans_by_number
from stereocalib_core.sources.lists import from_first, times_or_note
from stereocalib_core.sources.pairing import KITTI_PAIRS, Pairs, match_pairs, most_whole, pictures_in
from stereocalib_core.sources.picture_size import Size, size_of_file
from stereocalib_core.system.text_file import read_text, to_numbers

CALIB_FILES = ("calib_cam_to_cam.txt", "calib_velo_to_cam.txt", "calib_imu_to_velo.txt")
OTHER_CALIB = ("calib.txt",)
OXTS_COLUMNS = 30
VELODYNE_SWEEP = -1.0
"""The Velodyne turns once a frame and triggers the cameras when it faces ahead; its scans are stored as they were taken
(readme of the raw recordings). The sense: descriptions of the recordings say counter-clockwise, the reader of KISS-ICP
undoes a clockwise turn, and so fit the edges of raw 0009. It is told as likely, not as known (`sweep_belief`)."""
OXTS_BYTES = 4096


def _data(folder: Path, camera: int) -> Path:
    return folder / f"image_{camera:02d}" / "data"


def _accepts(spec: Spec) -> bool:
    return spec.folder is not None and any(_data(spec.folder, pair[0]).is_dir() for pair in KITTI_PAIRS)


def _open(spec: Spec) -> Recording:
    """A synchronised and rectified raw drive as a recording; raises SourceError."""
    assert spec.folder is not None
    folder = spec.folder
    named = spec.options.get("calibration")
    home, file = _calibration_home(folder)
    if file is None and not named:
        where = home / CALIB_FILES[0]
        raise SourceError(
            "no calibration of the drive's date", where, "download and unpack the calibration archive"
        )
    tree = {} if file is None else kitti.read_lines(file)
    cameras = most_whole(lambda camera: _data(folder, camera), kitti.camera_numbers(tree))
    if named:
        found = read_calibration(named, unit_of(spec.options))
    else:
        assert file is not None
        found = Found(kitti.read(tree, file, cameras, _size(folder, cameras[0])), (file,))
    pairs = match_pairs(_data(folder, cameras[0]), _data(folder, cameras[1]), numbered=True)
    times_file = _data(folder, cameras[0]).parent / "timestamps.txt"
    notices: list[str] = []
    # pictures that are not rectified yet (`_extract`) are turned together with what is seen from them
    turns = {} if found.calibration.raw_pictures else tree
    T_cam0_velo, T_cam0_imu = _sensors(home, turns, notices)
    scans = scans_by_number(folder / "velodyne_points" / "data")
    T_camera_lidar = None
    if scans and T_cam0_velo is not None:
        T_camera_lidar = _seen_from(T_cam0_velo, tree, cameras[0], file, notices)
    elif scans:
        notices.append(f"velodyne scans without {CALIB_FILES[1]}: left unused")
    else:
        notices.append("no velodyne scans")
    if cameras != KITTI_PAIRS[0]:
        notices.append(f"pictures of image_{cameras[0]:02d} and image_{cameras[1]:02d}")
    T_camera_imu = None if T_cam0_imu is None else _seen_from(T_cam0_imu, tree, cameras[0], file, notices)
    return recording(
        Parts(
            kind="kitti_raw",
            folder=folder,
            pairs=pairs,
            found=found,
            times=times_or_note(times_file),
            times_name=f"{times_file.parent.name}/timestamps.txt",
            truth=lambda _times: _ground_truth(folder, pairs, T_camera_imu),
            scans=scans if T_camera_lidar is not None else {},
            T_camera_lidar=T_camera_lidar,
            lidar_sweep=VELODYNE_SWEEP,
            notices=notices,
            files=[*(home / name for name in (*CALIB_FILES, *OTHER_CALIB)), times_file],
            key=[cameras],
        )
    )


def _size(folder: Path, camera: int) -> Size | None:
    """(width, height) of the first picture, which tells rectified pictures from raw ones."""
    first = next(iter(pictures_in(_data(folder, camera)).values()), None)
    return None if first is None else size_of_file(first)


def _calibration_home(folder: Path) -> tuple[Path, Path | None]:
    """Where the calibration of the drive lies and its file of cameras: beside it or what it links to, or inside."""
    places = [folder.parent, folder.resolve().parent, folder, folder / "calib", folder.parent / "calib"]
    for names in (CALIB_FILES[:1], OTHER_CALIB):
        for place in places:
            for name in names:
                if (place / name).is_file():
                    return place, place / name
    return folder.parent, None


def _sensors(home: Path, tree: Tree, notices: list[str]) -> tuple[Array | None, Array | None]:
    """T_camera0_velodyne and T_camera0_imu, (4, 4), into the rectified camera 0; None where a file is missing."""
    velo, imu = (_rigid(home / name, notices) for name in CALIB_FILES[1:])
    if velo is None:
        return None, None
    R_rect = np.eye(4)
    key = next((key for key in ("R_rect_00", "R_rect_0", "R0_rect") if key in tree), None)
    if key is not None:
        R_rect[:3, :3] = kitti.values(tree, key, 9, home).reshape(3, 3)
    T_cam0_velo = R_rect.dot(velo)
    return T_cam0_velo, None if imu is None else T_cam0_velo.dot(imu)


def _rigid(path: Path, notices: list[str]) -> Array | None:
    """(4, 4) of a file with R and T; None, and a note where it is damaged."""
    if not path.is_file():
        return None
    try:
        tree = kitti.read_lines(path)
        return transform(kitti.values(tree, "R", 9, path).reshape(3, 3), kitti.values(tree, "T", 3, path))
    except SourceError as error:
        notices.append(f"{path.name} is not used: {error.what}, {error.remedy}")
        return None


def _seen_from(
    T_cam0_sensor: Array, tree: Tree, camera: int, where: Path | None, notices: list[str]
) -> Array | None:
    """The sensor seen from a camera that stands beside camera 0, as the last column of its P says; None without it."""
    if camera == 0:
        return T_cam0_sensor
    try:
        return kitti.shifted(T_cam0_sensor, kitti.projection(tree, camera, where))
    except SourceError as error:
        notices.append(f"LiDAR and OXTS are not used: {error.what}, {error.remedy}")
        return None


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
        if path.is_file() and _is_packet(path):
            frames.append(frame)
            files.append(str(path))
    if not files:
        return None, ["no OXTS packet for any picture: no ground truth, errors are not computed"]
    try:
        T_world_imu = np.array([packet.T_w_imu for packet in load_oxts_packets_and_poses(files)])
    except (ValueError, TypeError, IndexError, OverflowError) as error:
        return None, [f"OXTS cannot be read ({str(error)[:80]}): no ground truth, errors are not computed"]
    poses = np.full((len(pairs), 4, 4), np.nan)
    poses[frames] = T_world_imu @ invert_transform(T_camera_imu)
    notices = ["ground truth from OXTS: judged by path length, its heading is not reliable"]
    if len(files) < len(pairs):
        notices.append(f"OXTS packets for {len(files)} of {len(pairs)} frames")
    return GroundTruth(poses=from_first(poses), heading_reliable=False), notices


def _is_packet(path: Path) -> bool:
    try:
        values = to_numbers(read_text(path, OXTS_BYTES, "OXTS packet"))
    except SourceError:
        return False
    # pykitti converts the last five columns to whole numbers
    return values is not None and len(values) == OXTS_COLUMNS and all(v == int(v) for v in values[-5:])


FORMAT = Format("KITTI raw drive", _accepts, _open, SourceKind.KITTI_RAW)
