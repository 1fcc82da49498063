"""The folder of a run: a `Drive` to its files and back."""

from __future__ import annotations

import contextlib
import dataclasses
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stereocalib_core import config as settings
from stereocalib_core.errors import ConfigError, SourceError
from stereocalib_core.files import io
from stereocalib_core.files.extrinsics import read_extrinsics_csv, write_extrinsics_csv
from stereocalib_core.files.lidar_mended import write_lidar_mended
from stereocalib_core.files.report import report_of
from stereocalib_core.files.report_read import drive_of
from stereocalib_core.results import Drive
from stereocalib_core.system import whole_file

CONFIG, RIG, REPORT, EXTRINSICS = "config.json", "rig.yaml", "report.json", "extrinsics.csv"
KITTI, TUM = "trajectory.txt", "trajectory.tum"
LIDAR = "lidar_mended.yaml"
RESULT_FILES = (CONFIG, RIG, EXTRINSICS, KITTI, TUM, LIDAR, REPORT)


def write_run(drive: Drive, folder: str | Path) -> None:
    """The files of a run, in a folder that is there; report.json last, so that it means that the others are there.

    Raises OutputError.
    """
    folder = Path(folder)
    if drive.config is not None:
        whole_file.write_json(folder / CONFIG, settings.to_dict(drive.config))
    write_extrinsics_csv(folder / EXTRINSICS, drive.frames)
    if drive.paths:
        io.write_rig(folder / RIG, drive.mount)
    if drive.poses is not None:
        io.write_kitti(folder / KITTI, drive.poses)
        io.write_tum(folder / TUM, drive.frames.timestamp_s, without_gaps(drive, drive.poses))
    if drive.lidar is not None and drive.lidar.pose is not None:
        write_lidar_mended(folder / LIDAR, drive.lidar.pose)
    whole_file.write_json(folder / REPORT, report_of(drive))


def without_gaps(drive: Drive, poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 4, 4) with NaN in gaps: TUM has a time in every line and needs none for a pose that the road does not bear
    out. KITTI's format has one line a frame, whatever is known of it; there the report's gaps say which ones."""
    known = poses.copy()
    for first, last in drive.gaps:
        known[(drive.frames.frame >= first) & (drive.frames.frame <= last)] = np.nan
    return known


def load_run(folder: str | Path) -> Drive:
    """What a run wrote, as a `Drive`; raises SourceError.

    Numbers are as exact as the files have them; poses are those of the best path, NaN for the other ones.
    """
    folder = Path(folder)
    report = folder / REPORT
    if not report.is_file():
        raise SourceError("no run there", folder, "name the output folder of an earlier `stereocalib run`")
    kitti, rig = folder / KITTI, folder / RIG
    frames = read_extrinsics_csv(folder / EXTRINSICS)
    if len(frames) == 0:
        raise SourceError("run without frames", folder, "run the drive again")
    poses = io.read_kitti(kitti) if kitti.is_file() else None
    drive = drive_of(whole_file.read_json(report), report, frames, poses)
    if rig.is_file():
        mount = dataclasses.replace(drive.mount, lever_arm_m=io.read_rig(rig).lever_arm_m)
        drive = dataclasses.replace(drive, mount=mount)
    with contextlib.suppress(ConfigError):  # of another version: what it was run with is not known
        if (folder / CONFIG).is_file():
            drive = dataclasses.replace(drive, config=settings.load(folder / CONFIG))
    return drive
