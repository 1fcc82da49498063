"""Calibrations of every dialect behind one reader, `read_calibration`, and one writer, `write_calibration`."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Iterable
from pathlib import Path

from stereocalib_core.calibration import Size, StereoCalibration
from stereocalib_core.config.reading import MOST_BYTES_OF_A_CALIBRATION, MOST_CALIBRATIONS_IN_A_FOLDER
from stereocalib_core.errors import OutputError, SourceError
from stereocalib_core.sources.calibrations import kalibr, kitti, opencv, own_yaml, ros
from stereocalib_core.sources.calibrations.rectify import plain
from stereocalib_core.sources.calibrations.trees import Tree, read_tree
from stereocalib_core.sources.sides import side_of

SUFFIXES = (".yaml", ".yml", ".xml", ".json", ".txt", ".calib", ".cfg")
MENDED = "calibration_mended.yaml"
"""What a run writes beside its report once the pair could be measured."""
WRITERS: dict[str, tuple[Callable[[StereoCalibration, Path], dict[Path, str]], str]] = {
    "yaml": (own_yaml.write, "camera.yaml"),
    "opencv": (opencv.write, "stereo.yml"),
    "ros": (ros.write, ""),
    "kalibr": (kalibr.write, "camchain.yaml"),
    "kitti": (kitti.write, "calib.txt"),
}
"""Dialect: its writer, and the file's name where a folder is given; none where the dialect has several files."""

__all__ = [
    "MENDED",
    "WRITERS",
    "Converted",
    "Found",
    "convert",
    "find_calibration",
    "read_calibration",
    "write_calibration",
]


@dataclasses.dataclass(frozen=True)
class Found:
    """A calibration together with the files that it was read from."""

    calibration: StereoCalibration
    files: tuple[Path, ...]


def read_calibration(spec: str | Path, unit: str | None = None, size: Size | None = None) -> Found:
    """A file, two files `a.yml,b.yml`, a folder that holds one, or the output of a run; SourceError in one line.

    unit: of lengths, m, cm or mm, where the file leaves that open. size: of the pictures, where known.
    """
    path = Path(spec).expanduser()
    if path.is_dir():
        mended = path / MENDED
        if (path / "report.json").is_file() and not mended.is_file():
            raise SourceError("run without a mended calibration", path, "its pair could not be measured")
        if mended.is_file():
            return from_files([mended], unit, size)
        found = find_calibration(path, unit, size)
        if found is None:
            known = "camera.yaml, OpenCV, ROS, Kalibr, EuRoC or KITTI"
            raise SourceError("no calibration in the folder", path, f"name a file of {known}")
        return found
    if path.is_file():
        return from_files([path], unit, size)
    parts = [Path(part).expanduser() for part in str(spec).split(",")]
    sides = [path.with_name(f"{path.stem}_{side}{path.suffix}") for side in ("left", "right")]
    for files in (parts if len(parts) > 1 else [], sides):
        if files and all(file.is_file() for file in files):
            return from_files(files, unit, size)
    raise SourceError("no such calibration", path, "check the path")


def find_calibration(folder: Path, unit: str | None = None, size: Size | None = None) -> Found | None:
    """The calibration beside pictures, found by what files hold; None where there is none.

    `camera.yaml` comes first. Raises SourceError for a file that is one, and damaged.
    """
    own = folder / "camera.yaml"
    places = [folder, *_places(folder)]
    first: SourceError | None = None
    if own.is_file():
        try:
            return from_files([own], unit, size)
        except SourceError as error:
            if own_yaml.is_ours(_tree_or_nothing(own)) or not _others(folder):
                raise
            first = error
    files = [path for place in places for path in _candidates(place)][:MOST_CALIBRATIONS_IN_A_FOLDER]
    trees = {path: tree for path in files if (tree := _tree_or_nothing(path))}
    found = _from_trees(trees, folder, unit, size)
    if found is None and first is not None:
        raise first
    return found


def _others(folder: Path) -> bool:
    return any(path.name != "camera.yaml" for path in _candidates(folder))


def _places(folder: Path) -> list[Path]:
    """Folders beside the pictures in which calibrations are kept."""
    try:
        names = sorted(entry.name for entry in os.scandir(folder) if entry.is_dir())
    except OSError:
        return []
    kept = [
        n for n in names if any(word in n.lower() for word in ("calib", "param", "camera_info", "config"))
    ]
    kept += [n for n in names if side_of(n) is not None]
    return [folder / name for name in kept]


def _candidates(folder: Path) -> list[Path]:
    try:
        entries = sorted(os.scandir(folder), key=lambda entry: entry.name)
    except OSError:
        return []
    found = []
    for entry in entries:
        path = Path(entry.path)
        if path.suffix.lower() not in SUFFIXES or entry.name.startswith("."):
            continue
        try:
            if entry.is_file() and 0 < entry.stat().st_size <= MOST_BYTES_OF_A_CALIBRATION:
                found.append(path)
        except OSError:
            continue
    # a folder of numbered text files, one a frame, holds no calibration of the whole drive
    return [] if len(found) > MOST_CALIBRATIONS_IN_A_FOLDER else found


def _tree_or_nothing(path: Path) -> Tree:
    try:
        return read_tree(path)
    except SourceError:
        return {}


def from_files(files: Iterable[Path], unit: str | None = None, size: Size | None = None) -> Found:
    """The calibration that these files hold together; raises SourceError in one line."""
    files = list(files)
    trees = {path: read_tree(path) for path in files}
    if len(files) == 1 and ros.is_side(trees[files[0]]):
        trees |= _partner(files[0])
    elif len(files) == 1 and opencv.is_part(trees[files[0]]) and not opencv.is_whole(trees[files[0]]):
        beside = {path: tree for path in _candidates(files[0].parent) if (tree := _tree_or_nothing(path))}
        trees |= {path: tree for path, tree in beside.items() if opencv.is_part(tree)}
    found = _from_trees(trees, files[0], unit, size)
    if found is None and len(files) == 1:
        trees |= {path: tree for path in _candidates(files[0].parent) if (tree := _tree_or_nothing(path))}
        found = _from_trees({files[0]: trees.pop(files[0]), **trees}, files[0], unit, size, files[0])
    if found is None:
        known = "known are camera.yaml, OpenCV, ROS camera_info, Kalibr, EuRoC and KITTI, of both cameras"
        raise SourceError("no stereo calibration", files[0], known)
    return found


def _partner(path: Path) -> dict[Path, Tree]:
    """The other side's camera_info beside a file."""
    side = side_of(path.stem)
    for other in _candidates(path.parent):
        found = side_of(other.stem)
        if side and found and found.index != side.index and found.rest == side.rest:
            tree = _tree_or_nothing(other)
            if ros.is_side(tree):
                return {other: tree}
    return {}


def _from_trees(
    trees: dict[Path, Tree], where: Path, unit: str | None, size: Size | None, must_use: Path | None = None
) -> Found | None:
    """The first whole calibration among files; `must_use` has to be one of its files."""

    def done(calibration: StereoCalibration, *files: Path) -> Found | None:
        if must_use is not None and must_use not in files:
            return None
        return Found(plain(calibration), files)

    for path, tree in trees.items():
        if own_yaml.is_ours(tree):
            return done(own_yaml.read(tree, path, unit), path)
        if kalibr.is_chain(tree):
            return done(kalibr.read_chain(tree, path, unit), path)
    sensors = [path for path, tree in trees.items() if kalibr.is_sensor(tree) and "camera" in _kind(tree)]
    if len(sensors) >= 2:
        left, right = sorted(sensors)[:2]
        return done(kalibr.read_sensors(trees[left], trees[right], where, unit), left, right)
    infos = [path for path, tree in trees.items() if ros.is_side(tree)]
    if len(infos) >= 2:
        left, right = _ordered(infos, trees)
        return done(ros.read(trees[left], trees[right], where, unit), left, right)
    for path, tree in trees.items():
        if kitti.is_ours(tree):
            return done(kitti.read(tree, path, None, size), path)
    found = _opencv(trees, where, unit)
    if found is not None:
        return done(*found)
    return None


def _kind(tree: Tree) -> str:
    return str(tree.get("sensor_type", "camera"))


def _ordered(infos: list[Path], trees: dict[Path, Tree]) -> tuple[Path, Path]:
    """Left and right camera_info: by name, else by the baseline in the right one's P."""
    sided = [(side_of(path.stem) or side_of(path.parent.name), path) for path in infos]
    left = next((path for side, path in sided if side and side.index == 0), None)
    right = next((path for side, path in sided if side and side.index == 1), None)
    if left is not None and right is not None:
        return left, right
    rights = [path for path in infos if ros.is_right(trees[path])]
    second = rights[0] if rights else infos[1]
    return next(path for path in infos if path != second), second


def _opencv(
    trees: dict[Path, Tree], where: Path, unit: str | None
) -> tuple[StereoCalibration, *tuple[Path, ...]] | None:
    """OpenCV's matrices from one file, or from several that hold a part each."""
    renamed = {path: opencv.with_side(tree, side_of(path.stem)) for path, tree in trees.items()}
    alone = [path for path, tree in renamed.items() if opencv.is_ours(tree)]
    for path in alone:
        if opencv.is_whole(renamed[path]):
            return opencv.read(renamed[path], path, unit), path
    merged: Tree = {}
    used = [path for path, tree in renamed.items() if opencv.is_part(tree)]
    for path in used:
        merged = {**renamed[path], **merged}
    if not opencv.is_ours(merged):
        return None
    return opencv.read(merged, where, unit), *used


@dataclasses.dataclass(frozen=True)
class Converted:
    """What `convert` read and wrote, and what it had to assume."""

    read: tuple[Path, ...]
    written: tuple[Path, ...]
    dialect: str
    notes: tuple[str, ...]


def convert(
    spec: str,
    dialect: str,
    out: Path,
    unit: str | None = None,
    size: Size | None = None,
    overwrite: bool = False,
) -> Converted:
    """Read a calibration and write it in another dialect; raises SourceError or OutputError in one line.

    size: (width, height) of the pictures, where the file does not say.
    """
    found = read_calibration(spec, unit, size)
    calibration = found.calibration
    if size is not None:
        if calibration.size not in (None, size):
            raise SourceError(f"calibration for {calibration.size}", found.files[0], f"not for {size}")
        calibration = calibration.sized(size)
    written = write_calibration(calibration, dialect, out, overwrite)
    return Converted(found.files, tuple(written), calibration.dialect, calibration.notes)


def write_calibration(
    calibration: StereoCalibration, dialect: str, out: Path, overwrite: bool = True
) -> list[Path]:
    """Write a calibration in one of `WRITERS`; the files, which is one but for ROS.

    out: the file, or a folder for the dialect's own name. Raises SourceError where the dialect cannot say it,
    OutputError where it cannot be written.
    """
    writer, name = WRITERS[dialect]
    path = out / name if name and (out.is_dir() or not out.suffix) else out
    if out.is_dir() and not name:
        path = out
    texts = writer(calibration, path)
    there = next((file for file in texts if file.exists()), None)
    if there is not None and not overwrite:
        raise OutputError("file exists", there, "name a new one, or add --overwrite")
    try:
        for file, text in texts.items():
            file.parent.mkdir(parents=True, exist_ok=True)
            part = file.with_name(f".{file.name}.tmp")
            part.write_text(text, encoding="utf-8")
            part.replace(file)
    except OSError as error:
        raise OutputError("calibration cannot be written", out, error.strerror or "check the path") from error
    return list(texts)
