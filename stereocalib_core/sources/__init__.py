"""Recordings of every kind behind one door: `open_source(spec)`."""

from __future__ import annotations

from enum import Enum
from pathlib import Path

from stereocalib_core.errors import SourceError
from stereocalib_core.frames import FrameSource
from stereocalib_core.sources.prefetch import prefetch

__all__ = ["SourceKind", "absolute", "open_source", "prefetch", "source_kind"]

RUN_FILES = ("report.json", "extrinsics.csv")


class SourceKind(Enum):
    """What a SOURCE turned out to be."""

    KITTI_ODOMETRY = "KITTI odometry sequence"
    KITTI_RAW = "KITTI raw drive"
    FOLDER = "plain folder"
    SYNTHETIC = "synthetic drive"
    VIDEO = "video"
    RUN = "output of an earlier run"


def source_kind(spec: str) -> SourceKind:
    """What `spec` is, by what is in it; raises SourceError for what is none of the kinds."""
    from stereocalib_core.sources.formats import folder as plain
    from stereocalib_core.sources.formats import kitti_odometry, kitti_raw

    if spec == "synthetic" or spec.startswith(("synthetic:", "synthetic?")):
        return SourceKind.SYNTHETIC
    if spec.startswith("video:"):
        return SourceKind.VIDEO
    path = _existing_folder(spec)
    if kitti_odometry.is_sequence(path):
        return SourceKind.KITTI_ODOMETRY
    if kitti_raw.is_drive(path):
        return SourceKind.KITTI_RAW
    if plain.is_plain_folder(path):
        return SourceKind.FOLDER
    if all((path / name).is_file() for name in RUN_FILES):
        return SourceKind.RUN
    raise SourceError("no stereo drive", path, _nearest_remedy(path))


def absolute(spec: str) -> Path:
    """The full path as it was named. What lies beside a link (calibration, poses) comes before what lies beside
    its target, so links stay; but `..` means the folder above the target."""
    path = Path(spec).expanduser()
    return path.resolve() if ".." in path.parts else path.absolute()


def _existing_folder(spec: str) -> Path:
    if not spec or "\0" in spec:
        raise SourceError("empty source", repr(spec), "name a folder, synthetic, or video:FILE")
    try:
        path = absolute(spec)
        if path.is_dir():
            return path
        if path.exists():
            raise SourceError(
                "a file, no folder", path, "name the folder of the drive, or video:FILE?camera=YAML"
            )
    except (OSError, RuntimeError) as error:
        raise SourceError("path cannot be read", spec[:200], str(error)) from error
    raise SourceError("no such folder", spec[:200], "check the path")


def _nearest_remedy(path: Path) -> str:
    """What is missing to the kind of folder this resembles most."""
    names = {entry.name for entry in path.iterdir()}
    if not names:
        return "the folder is empty"
    if names & {"image_0", "image_2"}:
        return "image_0 and image_1 are there but no calib.txt"
    if "calib.txt" in names:
        return "calib.txt is there but no image_0"
    if names & {"image_00", "oxts", "velodyne_points"}:
        return "a raw drive needs image_00/data and image_01/data"
    if names & {"left", "right", "camera.yaml"}:
        return "a plain folder needs left/, right/ and camera.yaml"
    if "sequences" in names:
        return "name one sequence of it, e.g. sequences/00"
    if any("_drive_" in name for name in names):
        return "name one drive of it"
    return "expected image_0 image_1 calib.txt, image_00 image_01, or left right camera.yaml"


def open_source(spec: str) -> FrameSource:
    """Open any SOURCE but the output of an earlier run; raises SourceError in one line."""
    import cv2

    from stereocalib_core.sources.formats import folder as plain
    from stereocalib_core.sources.formats import kitti_odometry, kitti_raw

    kind = source_kind(spec)
    # Damaged pictures are reported as failed frames, not as lines on stderr.
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    if kind is SourceKind.SYNTHETIC:
        from stereocalib_core.sources.formats import synthetic

        return synthetic.SyntheticSource.from_spec(spec)
    if kind is SourceKind.VIDEO:
        from stereocalib_core.sources.formats import video

        return video.open_video(spec)
    path = absolute(spec)
    if kind is SourceKind.KITTI_ODOMETRY:
        return kitti_odometry.open_sequence(path)
    if kind is SourceKind.KITTI_RAW:
        return kitti_raw.open_drive(path)
    if kind is SourceKind.FOLDER:
        return plain.open_folder(path)
    raise SourceError("output of an earlier run", path, "use it with view or compare, or name its source")


def warm_up() -> None:
    """Compile what this package compiles."""
    from stereocalib_core.sources import png

    png.warm_up()
