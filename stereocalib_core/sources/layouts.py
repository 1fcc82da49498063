"""Where the pictures of both cameras lie in a folder, whatever the folders or files are called."""

from __future__ import annotations

import os
from collections import defaultdict
from pathlib import Path

from stereocalib_core.config.reading import MOST_FOLDERS_OF_A_DRIVE
from stereocalib_core.sources.pairing import Sides, pictures_in
from stereocalib_core.sources.sides import camera_number, side_of

INSIDE = ("data", "images", "image", "data_rect", "image_rect", "rect", "frames", "imgs", "rgb")
"""Folders of pictures inside a camera's own folder."""
HOMES = (
    *("images", "image", "imgs", "pictures", "frames", "data", "cameras", "camera", "stereo", "rgb", "raw"),
    *("rect", "rectified"),
)
"""Folders of a drive that hold both cameras. Not any: a folder of many drives is none of them."""
PAIRS = ((0, 1), (2, 3), (1, 2), (3, 4), (4, 5))


def find_sides(folder: Path) -> Sides | None:
    """The pictures of both cameras: in two folders or in one by their names, here or in a folder for pictures."""
    for place in (folder, *(path for path in _folders(folder) if path.name.lower() in HOMES)):
        found = in_two_folders(place)
        if found is not None:
            return found
        if (found := in_one_folder(place)) is not None:
            return found
    return None


def _folders(folder: Path) -> list[Path]:
    try:
        names = sorted(e.name for e in os.scandir(folder) if e.is_dir() and not e.name.startswith("."))
    except OSError:
        return []
    return [folder / name for name in names[:MOST_FOLDERS_OF_A_DRIVE]]


def pictures_of(folder: Path) -> tuple[dict[str, Path], Path]:
    """The pictures of a camera's folder, which may lie in a folder within, and where they do."""
    found = pictures_in(folder)
    if found:
        return found, folder
    for name in INSIDE:
        if found := pictures_in(folder / name):
            return found, folder / name
    return {}, folder


def in_two_folders(folder: Path) -> Sides | None:
    """Two folders whose names differ in the side only: left and right, cam0 and cam1, image_02 and image_03."""
    words: dict[str, dict[int, Path]] = defaultdict(dict)
    numbers: dict[str, dict[int, Path]] = defaultdict(dict)
    for path in _folders(folder):
        side = side_of(path.name)
        if side is not None and side.token == "word":
            words[side.rest].setdefault(side.index, path)
        elif (camera := camera_number(path.name)) is not None:
            numbers[camera[1]].setdefault(camera[0], path)
    candidates = [(group[0], group[1]) for group in words.values() if len(group) == 2]
    candidates += [
        (group[a], group[b]) for group in numbers.values() for a, b in PAIRS if a in group and b in group
    ]
    for left, right in candidates:
        (left_pictures, left_place), (right_pictures, right_place) = pictures_of(left), pictures_of(right)
        if left_pictures and right_pictures:
            return Sides(
                _without_side(left_pictures), _without_side(right_pictures), left_place, right_place,
                f"{left.name}/ and {right.name}/",
            )  # fmt: skip
    for left, right in candidates:
        if (left.name, right.name) == ("left", "right"):
            return Sides({}, {}, left, right) if not pictures_of(left)[0] else Sides(
                pictures_of(left)[0], {}, left, right
            )  # fmt: skip
    return None


def _without_side(pictures: dict[str, Path]) -> dict[str, Path]:
    """By what is left of a name without its side, where every name has one: left01 and right01 are a pair."""
    sides = {stem: side_of(stem) for stem in pictures}
    if not all(side is not None and side.token == "word" for side in sides.values()):
        return pictures
    by_rest = {side.rest.replace("*", ""): pictures[stem] for stem, side in sides.items() if side is not None}
    return by_rest if len(by_rest) == len(pictures) else pictures


def in_one_folder(folder: Path) -> Sides | None:
    """Pictures of both cameras in one folder, told apart by their names: left01 right01, 0_L 0_R, cam0_7 cam1_7."""
    pictures = pictures_in(folder)
    sides: tuple[dict[str, Path], dict[str, Path]] = {}, {}
    for stem, path in pictures.items():
        side = side_of(stem)
        if side is not None:
            sides[side.index].setdefault(side.rest.replace("*", ""), path)
    if not sides[0].keys() & sides[1].keys() or 2 * sum(map(len, sides)) < len(pictures):
        return None
    left, right = (next(iter(found.values())).name for found in sides)
    return Sides(*sides, folder, folder, f"{left} and {right} ... in {folder.name}/")
