"""What lies below the root and can be opened: drives, runs, folders of boards, zips; found in bounded time."""

from __future__ import annotations

import os
import time
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from stereocalib_core.errors import StereoCalibError
from stereocalib_core.files.run_folder import REPORT
from stereocalib_core.sources import SourceKind, source_kind

DEEPEST = 6
MOST = 300
LONGEST_S = 4.0
"""A root with a million folders must not keep anybody waiting."""
PICTURES = (".png", ".jpg", ".jpeg", ".pgm", ".bmp", ".tif", ".tiff")
THUMB_PX = 160
LARGEST_PICTURE = 60_000_000
"""Bytes of a file that is made a thumbnail of."""


@dataclass(frozen=True)
class Entry:
    """Something to open. path: below the root. frames: 0 where not known without reading it."""

    path: str
    kind: str
    frames: int
    changed_s: float


def kind_of(folder: Path) -> str:
    """What a folder is, empty where it is nothing that can be opened."""
    if (folder / "board.yaml").is_file() and (folder / "images").is_dir():
        return "boards"
    if (folder / REPORT).is_file() and (folder / "extrinsics.csv").is_file():
        return "run"
    try:
        kind = source_kind(str(folder))
    except (StereoCalibError, OSError, ValueError):
        return ""
    return "run" if kind is SourceKind.RUN else str(kind.value).replace("_", " ")


def pictures_of(folder: Path) -> list[Path]:
    """The pictures of one camera of a drive: those of the first folder below it that has any, in order."""
    pending = [folder]
    for _ in range(60):
        if not pending:
            return []
        here = pending.pop(0)
        try:
            inside = sorted(os.scandir(here), key=lambda e: e.name)
        except OSError:
            continue
        found = [Path(e.path) for e in inside if e.name.lower().endswith(PICTURES)]
        if found:
            return found
        pending += [Path(e.path) for e in inside if e.is_dir()]
    return []


def _frames(folder: Path, kind: str) -> int:
    if kind == "run":
        with (folder / "extrinsics.csv").open("rb") as lines:
            return max(0, sum(1 for _ in lines) - 1)
    return len(pictures_of(folder))


def _folders(folder: Path) -> list[Path]:
    """The folders in a folder, in order; links are not followed."""
    try:
        inside = sorted(os.scandir(folder), key=lambda e: e.name)
    except OSError:
        return []
    return [Path(e.path) for e in inside if e.is_dir(follow_symlinks=False) and not e.name.startswith(".")]


def _walk(root: Path, until_s: float) -> Iterator[tuple[Path, str]]:
    """Every folder and what it is, from the outside in. What a reader would find in the only drive inside counts as
    that drive, and what is a drive is not looked into."""
    pending = [(root, 0, kind_of(root))]
    while pending and time.monotonic() < until_s:
        folder, depth, kind = pending.pop(0)
        inside = [] if depth >= DEEPEST else [(child, kind_of(child)) for child in _folders(folder)]
        if kind and not any(other for _, other in inside):
            yield folder, kind
            continue
        yield folder, ""
        pending += [(child, depth + 1, other) for child, other in inside]


def shelf(root: Path) -> list[Entry]:
    """Everything below the root that can be opened, the latest first."""
    found: list[Entry] = []
    for folder, kind in _walk(root, time.monotonic() + LONGEST_S):
        try:
            if kind:
                name = str(folder.relative_to(root))
                found.append(Entry(name, kind, _frames(folder, kind), folder.stat().st_mtime))
            else:
                found += [
                    Entry(str(path.relative_to(root)), "zip", 0, path.stat().st_mtime)
                    for path in sorted(folder.glob("*.zip"))[:50]
                    if path.is_file() and zipfile.is_zipfile(path)
                ]
        except OSError:
            continue
        if len(found) >= MOST:
            break
    return sorted(found, key=lambda entry: -entry.changed_s)


def thumbnail(folder: Path) -> bytes | None:
    """The first picture of a drive, small, as JPEG; None where there is none."""
    pictures = pictures_of(folder)
    if not pictures or pictures[0].stat().st_size > LARGEST_PICTURE:
        return None
    picture = cv2.imdecode(np.fromfile(pictures[0], np.uint8), cv2.IMREAD_GRAYSCALE)
    if picture is None:
        return None
    height = max(1, round(picture.shape[0] * THUMB_PX / picture.shape[1]))
    small = cv2.resize(picture, (THUMB_PX, height), interpolation=cv2.INTER_AREA)
    ok, data = cv2.imencode(".jpg", small, [int(cv2.IMWRITE_JPEG_QUALITY), 75])
    return data.tobytes() if ok else None
