"""A KITTI odometry sequence folder: `image_0 image_1` or `image_2 image_3`, `calib.txt`, `times.txt`, poses two
folders up."""

from __future__ import annotations

from pathlib import Path

from stereocalib_core.errors import SourceError
from stereocalib_core.frames import Recording
from stereocalib_core.sources.assembly import Parts, recording, unit_of
from stereocalib_core.sources.calibrations import Found, kitti, read_calibration
from stereocalib_core.sources.format import Format, SourceKind, Spec
from stereocalib_core.sources.lidar_scans import scans_by_number
from stereocalib_core.sources.lists import read_ground_truth, times_or_note
from stereocalib_core.sources.pairing import KITTI_PAIRS, match_pairs, most_whole


def _pictures(folder: Path, camera: int) -> Path:
    """The folder of a camera's pictures, image_0 or image_00."""
    one, two = folder / f"image_{camera}", folder / f"image_{camera:02d}"
    return two if two.is_dir() and not one.is_dir() else one


def _accepts(spec: Spec) -> bool:
    folder = spec.folder
    return (
        folder is not None
        and (folder / "calib.txt").is_file()
        and any(_pictures(folder, pair[0]).is_dir() for pair in KITTI_PAIRS)
        and not any((_pictures(folder, pair[0]) / "data").is_dir() for pair in KITTI_PAIRS)
    )


def _poses_file(folder: Path) -> Path:
    """Where the truth of a sequence lies: two folders up from it, or from what it links to, else inside."""
    files = [f.parent.parent / "poses" / f"{f.name}.txt" for f in (folder, folder.resolve())]
    return next((file for file in (*files, folder / "poses.txt") if file.is_file()), files[0])


def _open(spec: Spec) -> Recording:
    assert spec.folder is not None
    folder = spec.folder
    calib_file = folder / "calib.txt"
    tree = kitti.read_lines(calib_file)
    cameras = most_whole(lambda camera: _pictures(folder, camera), kitti.camera_numbers(tree))
    left, right = (_pictures(folder, camera) for camera in cameras)
    # a synthetic drive that was written has truth for dropped frames as well, the first and the last included
    known = {path.stem for path in (folder / "disparity_gt").glob("*.png")}
    named = spec.options.get("calibration")
    own = None if named else kitti.read(tree, calib_file, cameras)
    found = read_calibration(named, unit_of(spec.options)) if named else Found(own, (calib_file,))  # type: ignore[arg-type]
    pairs = match_pairs(left, right, True, known)
    poses_file, truth_file = _poses_file(folder), folder / "extrinsics_gt.csv"
    scans = scans_by_number(folder / "velodyne")
    notices = []
    T = None
    if scans:
        try:
            T = kitti.lidar_of(tree, cameras[0], calib_file)
        except SourceError as error:
            notices.append(f"LiDAR is not used: {error.what}, {error.remedy}")
    if cameras != KITTI_PAIRS[0]:
        notices.append(f"pictures of {left.name} and {right.name}")
    if scans and T is None and not any("LiDAR" in note for note in notices):
        notices.append("velodyne scans without Tr in calib.txt: left unused")
    return recording(
        Parts(
            kind="kitti_odometry",
            folder=folder,
            pairs=pairs,
            found=found,
            times=times_or_note(folder / "times.txt"),
            truth=lambda times_s: read_ground_truth(poses_file, truth_file, pairs.rows, times_s),
            scans=scans if T is not None else {},
            T_camera_lidar=T,
            notices=notices,
            files=[calib_file, folder / "times.txt", poses_file, truth_file],
        )
    )


FORMAT = Format("KITTI odometry sequence", _accepts, _open, SourceKind.KITTI_ODOMETRY)
