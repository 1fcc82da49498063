"""A KITTI-360 drive: `data_2d_raw/DRIVE/image_00/data_rect`, with `calibration/`, `data_poses/` and `data_3d_raw/`
beside data_2d_raw."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from stereocalib_core.errors import SourceError
from stereocalib_core.frames import Recording
from stereocalib_core.geometry import Array, invert_transform
from stereocalib_core.sources.assembly import Parts, calibration_for, recording
from stereocalib_core.sources.calibrations import Found, kitti
from stereocalib_core.sources.format import Format, SourceKind, Spec
from stereocalib_core.sources.lidar_scans import scans_by_number
from stereocalib_core.sources.lists import read_ground_truth, times_or_note
from stereocalib_core.sources.pairing import match_pairs
from stereocalib_core.system.text_file import read_text, to_numbers

CALIBRATION = "perspective.txt"


def _accepts(spec: Spec) -> bool:
    return spec.folder is not None and all(
        (spec.folder / f"image_0{camera}" / "data_rect").is_dir() for camera in (0, 1)
    )


def _roots(folder: Path) -> list[Path]:
    """Where the other archives were unpacked: two folders up, of the link or of its target, or inside."""
    return [folder.parent.parent, folder.resolve().parent.parent, folder.parent, folder]


def _first(folder: Path, *names: str) -> Path | None:
    places = (root / name for root in _roots(folder) for name in names)
    return next((path for path in places if path.is_file()), None)


def _open(spec: Spec) -> Recording:
    assert spec.folder is not None
    folder = spec.folder
    file = _first(folder, f"calibration/{CALIBRATION}", CALIBRATION)
    if file is None or spec.options.get("calibration"):
        found = calibration_for(spec.options, folder, what="image_00/ and image_01/")
    else:
        found = Found(kitti.read(kitti.read_lines(file), file, (0, 1)), (file,))
    pairs = match_pairs(folder / "image_00" / "data_rect", folder / "image_01" / "data_rect", numbered=True)
    poses_file = _first(
        folder,
        *(f"data_poses/{folder.name}/{name}" for name in ("cam0_to_world.txt", "poses.txt")),
        "cam0_to_world.txt",
    )
    places = (root / "data_3d_raw" / folder.name for root in _roots(folder))
    scans = next((s for p in (*places, folder) if (s := scans_by_number(p / "velodyne_points" / "data"))), {})
    notices: list[str] = []
    T_camera_lidar = _lidar(folder, file, notices) if scans else None
    # poses.txt is of the IMU; the camera's own list needs nothing
    T_body_camera = None
    if poses_file is not None and poses_file.name == "poses.txt":
        T_body_camera = _camera_in_body(folder, file, notices)
    times_file = next(
        (path for name in ("image_00", "image_01") if (path := folder / name / "timestamps.txt").is_file()),
        None,
    )
    return recording(
        Parts(
            kind="kitti_360",
            folder=folder,
            pairs=pairs,
            found=found,
            times=times_or_note(times_file),
            times_name="image_00/timestamps.txt",
            truth=lambda times_s: read_ground_truth(poses_file, None, pairs.rows, times_s, T_body_camera),
            scans=scans if T_camera_lidar is not None else {},
            T_camera_lidar=T_camera_lidar,
            notices=notices,
            files=[path for path in (poses_file, times_file) if path is not None],
        )
    )


def _rectifying(file: Path | None) -> Array:
    """(4, 4) the raw camera 0 to the rectified one."""
    R = np.eye(4)
    if file is not None:
        tree = kitti.read_lines(file)
        if "R_rect_00" in tree:
            R[:3, :3] = kitti.values(tree, "R_rect_00", 9, file).reshape(3, 3)
    return R


def _lidar(folder: Path, file: Path | None, notices: list[str]) -> Array | None:
    """(4, 4) Velodyne into the rectified camera 0; the file maps the other way, camera to Velodyne."""
    path = _first(folder, "calibration/calib_cam_to_velo.txt", "calib_cam_to_velo.txt")
    if path is None:
        notices.append("velodyne scans without calib_cam_to_velo.txt: left unused")
        return None
    return _inverse_of(path, "", file, notices)


def _camera_in_body(folder: Path, file: Path | None, notices: list[str]) -> Array | None:
    """(4, 4) T_imu_camera of the rectified camera 0, from calib_cam_to_pose.txt."""
    path = _first(folder, "calibration/calib_cam_to_pose.txt", "calib_cam_to_pose.txt")
    T = None if path is None else _inverse_of(path, "image_00", file, notices)
    return None if T is None else invert_transform(T)


def _inverse_of(path: Path, key: str, file: Path | None, notices: list[str]) -> Array | None:
    try:
        text = str(kitti.read_lines(path).get(key, "")) if key else read_text(path, 4096, "calibration")
        values = to_numbers(text)
        if values is None or len(values) != 12:
            raise SourceError(f"bad calibration of {path.name}", path, "expected 12 finite numbers")
        T = np.vstack([np.array(values).reshape(3, 4), [0.0, 0.0, 0.0, 1.0]])
        return _rectifying(file) @ invert_transform(T)
    except SourceError as error:
        notices.append(f"{path.name} is not used: {error.what}")
        return None


FORMAT = Format("KITTI-360 drive", _accepts, _open, SourceKind.KITTI_360)
