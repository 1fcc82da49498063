"""Which left picture belongs to which right one, and which line of a list to which: always by name."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Callable, Collection, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.config.reading import MOST_FRAMES
from stereocalib_core.errors import Failure, FailureReason, SourceError
from stereocalib_core.frames import StereoFrame
from stereocalib_core.sources.pictures import PICTURE_SUFFIXES, PictureFormat, read_side

KITTI_PAIRS = ((0, 1), (2, 3), (0, 3), (2, 1))
"""Left and right of KITTI's four cameras, which look the same way: two grey, two colour, and one of each."""


@dataclass(frozen=True)
class Pairs:
    """The frames of a recording in order.

    stems: file name without suffix, one per frame. rows: the line of times, poses and other lists that
    belongs to each frame. left, right: the picture, None where it is missing.
    """

    stems: tuple[str, ...]
    rows: tuple[int, ...]
    left: tuple[Path | None, ...]
    right: tuple[Path | None, ...]
    notices: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.stems)

    def present(self) -> list[Path]:
        """Every left and right picture there is, left ones first."""
        return [path for side in (self.left, self.right) for path in side if path is not None]


def pictures_in(folder: Path) -> dict[str, Path]:
    """Picture files of a folder by their name without suffix, hidden files left out."""
    try:
        entries = sorted(os.scandir(folder), key=lambda entry: entry.name)
    except OSError:
        return {}
    found = {}
    for entry in entries:  # of an hour's drive there are tens of thousands
        stem, suffix = os.path.splitext(entry.name)
        if suffix.lower() in PICTURE_SUFFIXES and entry.name[0] != "." and entry.is_file():
            found[stem] = folder / entry.name
    return found


def has_pictures(folder: Path) -> bool:
    """Whether `pictures_in` finds any there, without looking at all of them."""
    try:
        with os.scandir(folder) as entries:
            return any(_is_picture(entry) for entry in entries)
    except OSError:
        return False


def _stems_in(folder: Path) -> set[str]:
    """The names of `pictures_in`, and those of links that lead nowhere: following tens of thousands takes seconds."""
    try:
        with os.scandir(folder) as entries:
            pictures = (e.name for e in entries if _is_named(e.name) and not e.is_dir(follow_symlinks=False))
            return {os.path.splitext(name)[0] for name in pictures}
    except OSError:
        return set()


def _is_picture(entry: os.DirEntry[str]) -> bool:
    return _is_named(entry.name) and entry.is_file()


def _is_named(name: str) -> bool:
    return not name.startswith(".") and os.path.splitext(name)[1].lower() in PICTURE_SUFFIXES


def most_whole(folder_of: Callable[[int], Path], known: set[int]) -> tuple[int, int]:
    """Of KITTI's cameras the pair with the most pictures on both sides; alike, grey before colour before one of each.

    folder_of: where a camera's pictures lie. known: cameras with a projection in the calibration.
    """
    present = tuple(camera for camera in range(4) if folder_of(camera).is_dir())
    if present in KITTI_PAIRS[:2]:
        return present  # there is nothing to choose from
    stems = {camera: _stems_in(folder_of(camera)) for camera in range(4)}
    whole = {pair: len(stems[pair[0]] & stems[pair[1]]) for pair in KITTI_PAIRS}
    there = [pair for pair in KITTI_PAIRS if whole[pair] > 0]
    there = [pair for pair in there if set(pair) <= known] or there
    if there:
        return max(there, key=lambda pair: whole[pair])
    # pictures on both sides, no two of one name: what is missing is said when they are paired
    filled = [pair for pair in KITTI_PAIRS if all(stems[camera] for camera in pair)]
    return next(iter([*filled, *(pair for pair in KITTI_PAIRS if folder_of(pair[0]).is_dir())]))


def natural_key(name: str) -> tuple[tuple[int, int | str], ...]:
    """Sort key that puts `frame_10` after `frame_9`."""
    parts = re.findall(r"\d+|\D+", name)
    return tuple((0, int(part)) if part.isdecimal() else (1, part) for part in parts)


def match_pairs(
    left_folder: Path, right_folder: Path, numbered: bool, known: Collection[str] = frozenset()
) -> Pairs:
    """Left and right pictures of two folders, see `match`."""
    return match(
        Sides(pictures_in(left_folder), pictures_in(right_folder), left_folder, right_folder), numbered, known
    )


@dataclass(frozen=True)
class Sides:
    """The pictures of both cameras by what a pair has in common, and how each camera is called in messages."""

    left: dict[str, Path]
    right: dict[str, Path]
    left_place: Path
    right_place: Path
    said: str = ""


def match(sides: Sides, numbered: bool, known: Collection[str] = frozenset()) -> Pairs:
    """Left and right pictures of equal name, else of equal number, else of nearly the same time.

    numbered: names are frame numbers as in KITTI, which also number the lines of lists; else pictures and
        lines are counted through.
    known: names that are frames even where both their pictures are missing.
    Pictures without a partner before the first or after the last whole pair are left out, with a notice.
    Between them, a name that lacks a side, and a number that lacks both, is a frame of its own, so that
    nothing shifts. Raises SourceError when not one pair is whole.
    """
    left, right = sides.left, sides.right
    left_folder, right_folder = sides.left_place, sides.right_place
    for folder, found in ((left_folder, left), (right_folder, right)):
        if not found:
            raise SourceError("no pictures", folder, "expected left and right picture files of equal names")
    stems = sorted(left.keys() | right.keys() | set(known), key=natural_key)
    how: list[str] = []
    if not left.keys() & right.keys():
        right, text = _other_names(left, right)
        if not left.keys() & right.keys():
            where = f"{left_folder} and {right_folder}"
            raise SourceError(
                "no left picture has a right one of the same name", where, "give both the same names"
            )
        how = [text]
        stems = sorted(left.keys() | right.keys() | set(known), key=natural_key)
    whole = [i for i, stem in enumerate(stems) if stem in known or (stem in left and stem in right)]
    used = stems[whole[0] : whole[-1] + 1]
    rows = list(range(whole[0], whole[-1] + 1))
    notices = how + _unused(stems, used, left, right, left_folder, right_folder)
    if numbered and all(stem.isdecimal() for stem in stems):
        used, rows = _number_every_frame(used)
    if len(used) > MOST_FRAMES:
        raise SourceError(f"{len(used)} frames", left_folder, f"split it, at most {MOST_FRAMES} are read")
    lone = [stem for stem in used if (stem in left) != (stem in right)]
    lost = [stem for stem in used if stem not in left and stem not in right]
    for names, text in ((lone, "lack one side"), (lost, "are missing on both sides")):
        if names:
            notices.append(f"{len(names)} pictures inside the list {text}: {_some(names)}")
    return Pairs(
        tuple(used), tuple(rows), tuple(map(left.get, used)), tuple(map(right.get, used)), tuple(notices)
    )


_LAST_NUMBER = re.compile(r"(\d+)(?!.*\d)")
_STAMP = re.compile(r"\d{9,19}(?:\.\d{1,9})?")


def _other_names(left: dict[str, Path], right: dict[str, Path]) -> tuple[dict[str, Path], str]:
    """The right pictures under the names of the left ones that they belong to, and how that was told."""
    stamps = [_stamps(found) for found in (left, right)]
    if stamps[0] is not None and stamps[1] is not None:
        return _nearest(stamps[0], stamps[1], right)
    numbers = [_numbers(found) for found in (left, right)]
    if numbers[0] is None or numbers[1] is None:
        return right, ""
    names = {number: stem for stem, number in numbers[0].items()}
    renamed = {names.get(number, stem): right[stem] for stem, number in numbers[1].items()}
    return renamed, "names of left and right pictures differ: paired by their numbers"


def _numbers(found: dict[str, Path]) -> dict[str, int] | None:
    """The last number in every name; None where one has none or two have the same."""
    out = {}
    for stem in found:
        match = _LAST_NUMBER.search(stem)
        if match is None:
            return None
        out[stem] = int(match.group(1))
    return out if len(set(out.values())) == len(out) else None


def _stamps(found: dict[str, Path]) -> dict[str, float] | None:
    """The time in every name, in units of its own from the first; None where one has none."""
    out: dict[str, float] = {}
    first: int | None = None
    for stem in found:
        match = _STAMP.search(stem)
        if match is None:
            return None
        whole, _, fraction = match.group(0).partition(".")
        first = int(whole) if first is None else first
        out[stem] = (int(whole) - first) + float(f"0.{fraction or '0'}")
    base = float(first or 0)
    return {stem: value + base for stem, value in out.items()}


def _nearest(
    left: dict[str, float], right: dict[str, float], pictures: dict[str, Path]
) -> tuple[dict[str, Path], str]:
    """Every right picture under the name of the left one nearest in time, within half a period."""
    ordered = sorted(left.items(), key=lambda item: item[1])
    times = np.array([value for _, value in ordered])
    period = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    renamed: dict[str, Path] = {}
    distances: dict[str, float] = {}
    for stem, value in right.items():
        spot = int(np.searchsorted(times, value))
        best = min((i for i in (spot - 1, spot) if 0 <= i < len(times)), key=lambda i: abs(times[i] - value))
        distance, name = abs(float(times[best]) - value), ordered[best][0]
        if distance <= period / 2 and distance < distances.get(name, np.inf):
            if name in renamed:
                renamed[renamed[name].stem] = renamed[name]
            renamed[name], distances[name] = pictures[stem], distance
        else:
            renamed[stem] = pictures[stem]
    share = max(distances.values(), default=0.0) / period if period else 0.0
    return renamed, f"names are times: paired with the nearest, at most {100 * share:.2g} % of a period apart"


def _unused(
    stems: Sequence[str],
    used: Sequence[str],
    left: dict[str, Path],
    right: dict[str, Path],
    left_folder: Path,
    right_folder: Path,
) -> list[str]:
    kept = set(used)
    out = []
    for found, folder in ((left, left_folder), (right, right_folder)):
        extra = [stem for stem in stems if stem in found and stem not in kept]
        if extra:
            out.append(
                f"{len(extra)} pictures of {folder.name} have no partner and are left out: {_some(extra)}"
            )
    return out


def _number_every_frame(stems: Sequence[str]) -> tuple[list[str], list[int]]:
    """Numbered pictures: the numbers in between that have no picture become frames too."""
    numbers = [int(stem) for stem in stems]
    if numbers[-1] - numbers[0] > 2 * len(numbers) + 100:
        return list(stems), list(range(len(stems)))
    by_number = dict(zip(numbers, stems, strict=True))
    width = len(stems[0])
    every = range(numbers[0], numbers[-1] + 1)
    return [by_number.get(n, f"{n:0{width}d}") for n in every], list(every)


def _some(names: Sequence[str]) -> str:
    return ", ".join(names[:3]) + (f" ... {names[-1]}" if len(names) > 3 else "")


class PairReader:
    """Reads frame i of matched pairs; the two sides are decoded at the same time."""

    def __init__(self, pairs: Pairs, picture: PictureFormat, timestamps_s: NDArray[np.float64]) -> None:
        self._pairs, self._picture, self._times = pairs, picture, timestamps_s
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="right-picture")

    def __call__(self, index: int) -> StereoFrame:
        """The stereo frame; a damaged or missing side becomes its `failure`."""
        right_job = self._pool.submit(read_side, self._pairs.right[index], self._picture, "right")
        left = read_side(self._pairs.left[index], self._picture, "left")
        right = right_job.result()
        time_s = float(self._times[index])
        for side in (left, right):
            if isinstance(side, Failure):
                return StereoFrame(index, time_s, None, None, side)
        return StereoFrame(index, time_s, left, right)  # type: ignore[arg-type]


def check_usable(pairs: Pairs, picture: PictureFormat, where: Path) -> None:
    """Refuse a recording none of whose first pairs has the camera's size; one odd picture is no reason."""
    whole = [i for i in range(len(pairs)) if pairs.left[i] is not None and pairs.right[i] is not None]
    picks = sorted({whole[int(i)] for i in np.linspace(0, len(whole) - 1, 5).round()})
    last: Failure | None = None
    for i in picks:
        sides = [
            read_side(path, picture, name)
            for path, name in ((pairs.left[i], "left"), (pairs.right[i], "right"))
        ]
        failure = next((side for side in sides if isinstance(side, Failure)), None)
        if failure is None:
            return
        last = failure
    if last is not None and last.reason is FailureReason.SIZE_MISMATCH:
        raise SourceError("pictures do not fit the camera", where, last.detail)


def content_key(kind: str, files: Iterable[Path], *parts: object) -> str:
    """A name for the content: kind, settings, and the name, size and time of change of every file."""
    digest = hashlib.sha256(repr((kind, *parts)).encode())
    for path in files:
        try:
            status = path.stat()
            digest.update(f"{path.name} {status.st_size} {status.st_mtime_ns}\n".encode())
        except OSError:
            digest.update(f"{path.name} missing\n".encode())
    return f"{kind}-{digest.hexdigest()[:24]}"
