"""A plain folder: the pictures of two cameras in two folders or in one, under any of the usual names, a calibration
of any dialect beside them, optional times, poses and scans."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from pathlib import Path

from stereocalib_core.errors import SourceError
from stereocalib_core.frames import Recording
from stereocalib_core.sources.assembly import Parts, calibration_for, recording
from stereocalib_core.sources.format import Format, Spec
from stereocalib_core.sources.layouts import find_sides
from stereocalib_core.sources.lidar_scans import scans_by_number
from stereocalib_core.sources.lists import read_ground_truth, times_or_note
from stereocalib_core.sources.pairing import Pairs, Sides, match
from stereocalib_core.sources.times import Times, times_in_names

TIMES = tuple(
    f"{name}{suffix}"
    for name in ("times", "timestamps", "timestamp", "time", "stamps", "frames")
    for suffix in (".txt", ".csv")
)
POSES = tuple(
    f"{name}{suffix}"
    for name in (
        *("poses", "pose", "groundtruth", "ground_truth", "gt", "gt_poses", "poses_gt", "trajectory_gt"),
        *("stamped_groundtruth", "traj_gt", "odometry_gt", "trajectory", "traj"),
    )
    for suffix in (".txt", ".csv", ".tum", ".kitti")
)
SCANS = ("velodyne", "velodyne_points/data", "velodyne_points", "lidar", "scans", "clouds", "points")


def first_file(folders: Iterable[Path], names: Iterable[str]) -> Path | None:
    """The first of these files, any capitals, in the first folder that has one."""
    wanted = list(names)
    for folder in folders:
        try:
            present = {entry.name.lower(): entry for entry in folder.iterdir() if entry.is_file()}
        except OSError:
            continue
        for name in wanted:
            if name in present:
                return present[name]
    return None


def times_of(places: Iterable[Path], stems: Iterable[str]) -> tuple[Times | None, str, Path | None]:
    """The times of the frames from a list, else from the pictures' names; their file's name; the file."""
    path = first_file(places, TIMES)
    times = times_or_note(path)
    if times is None or len(times.seconds) == 0:
        in_names = times_in_names(list(stems))
        if in_names is not None:
            notes = () if times is None else times.notes
            return (
                dataclasses.replace(in_names, notes=(*notes, "times are taken from the pictures' names")),
                "names",
                path,
            )
    return times, "times.txt" if path is None else path.name, path


def scans_in(folder: Path) -> dict[int, Path]:
    """The numbered LiDAR files of a folder's usual places."""
    for name in SCANS:
        if found := scans_by_number(folder / name):
            return found
    return {}


def _accepts(spec: Spec) -> bool:
    return spec.folder is not None and find_sides(spec.folder) is not None


def _open(spec: Spec) -> Recording:
    assert spec.folder is not None
    sides = find_sides(spec.folder)
    if sides is None:
        raise SourceError("no pictures of two cameras", spec.folder, "expected left/ and right/")
    return open_sides(spec, sides, spec.folder)


def open_sides(spec: Spec, sides: Sides, folder: Path, kind: str = "folder") -> Recording:
    """The pictures of two cameras with all that lies beside them."""
    homes = tuple(dict.fromkeys((folder, sides.left_place.parent, sides.left_place)))
    what = sides.said or "left/ and right/"
    found = calibration_for(spec.options, *homes, what=what)
    pairs = match(sides, numbered=False)
    times, times_name, times_file = times_of(homes, pairs.stems)
    if times is not None and times_name == "names":
        # one time a picture that is there: each frame has its own row
        pairs = Pairs(pairs.stems, tuple(range(len(pairs))), pairs.left, pairs.right, pairs.notices)
    poses_file = first_file(homes, POSES)
    extrinsics_file = first_file(homes, ("extrinsics_gt.csv",)) or folder / "extrinsics_gt.csv"
    notices = []
    if sides.said and (sides.left_place.name, sides.right_place.name) != ("left", "right"):
        notices.append(f"left and right pictures: {sides.said}")
    if found.files[0].name != "camera.yaml":
        names = ", ".join(path.name for path in found.files)
        notices.append(f"calibration from {names} ({found.calibration.dialect})")
    T = found.calibration.T_camera_lidar
    scans = next((scans for home in homes if (scans := scans_in(home))), {})
    if scans and T is None:
        notices.append("LiDAR scans without T_camera_lidar in the calibration: left unused")
    files = [path for path in (times_file, poses_file) if path is not None]
    return recording(
        Parts(
            kind=kind,
            folder=folder,
            pairs=pairs,
            found=found,
            times=times,
            times_name=times_name,
            truth=lambda times_s: read_ground_truth(poses_file, extrinsics_file, pairs.rows, times_s),
            scans=scans if T is not None else {},
            T_camera_lidar=T,
            notices=notices,
            files=[*files, extrinsics_file],
        )
    )


FORMAT = Format("plain folder", _accepts, _open)
