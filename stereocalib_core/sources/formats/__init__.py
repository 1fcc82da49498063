"""One file a format. A new one is a file here and a line in `FORMATS`; the first that accepts a SOURCE opens it."""

from __future__ import annotations

from stereocalib_core.sources.format import Format
from stereocalib_core.sources.formats import (
    archive,
    bag,
    euroc,
    folder,
    kitti_360,
    kitti_odometry,
    kitti_pairs,
    kitti_raw,
    run_output,
    synthetic_drive,
    video,
)

FORMATS: tuple[Format, ...] = (
    synthetic_drive.FORMAT,
    video.FORMAT,
    bag.FORMAT,
    archive.FORMAT,
    kitti_pairs.FORMAT,
    kitti_odometry.FORMAT,
    kitti_360.FORMAT,
    kitti_raw.FORMAT,
    euroc.FORMAT,
    run_output.FORMAT,
    folder.FORMAT,
)
