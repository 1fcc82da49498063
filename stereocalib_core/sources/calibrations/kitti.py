"""KITTI's calibrations in all their spellings: `P0: ... P3:`, `P_rect_02:`, raw's calib_cam_to_cam.txt, stereo 2012
and 2015, object, KITTI-360's perspective.txt."""

from __future__ import annotations

import contextlib
import re
from pathlib import Path

import numpy as np

from stereocalib_core.calibration import LensPair, RectifiedPair, Size, StereoCalibration
from stereocalib_core.config.reading import MOST_BYTES_OF_A_CALIBRATION, MOST_PIXELS_ASIDE
from stereocalib_core.errors import SourceError
from stereocalib_core.geometry import Array, transform
from stereocalib_core.sources.calibrations.parts import lens, lens_pair, metres, rectified_or_lenses
from stereocalib_core.sources.calibrations.trees import Tree
from stereocalib_core.system.text_file import read_text, to_numbers

_PROJECTION = re.compile(r"P_?(?:rect)?_?0?([0-3])$", re.IGNORECASE)
_LIDAR = ("Tr", "Tr_velo_to_cam", "Tr_velo_cam", "Tr_cam_velo")
_KEY = re.compile(r"^\s*([A-Za-z]\w*)\s*[:=]?\s+(.*)$|^\s*([A-Za-z]\w*)\s*[:=]\s*(.*)$")


def read_lines(path: Path) -> Tree:
    """`KEY: words` lines of a file; others are passed over."""
    found: Tree = {}
    for line in read_text(path, MOST_BYTES_OF_A_CALIBRATION, "calibration").splitlines():
        match = _KEY.match(line)
        if match is not None:
            key, rest = match.group(1) or match.group(3), match.group(2) or match.group(4) or ""
            found[key] = rest
    return found


def is_ours(tree: Tree) -> bool:
    """Whether a file holds the projections of two cameras or more."""
    return len(_numbers(tree)) >= 2


def _numbers(tree: Tree) -> dict[int, str]:
    """Camera number to the key of its rectified projection."""
    matches = ((key, _PROJECTION.match(key)) for key in tree if isinstance(tree[key], str))
    return {int(match.group(1)): key for key, match in matches if match is not None}


def camera_numbers(tree: Tree) -> set[int]:
    """The cameras whose projections a file holds."""
    return set(_numbers(tree))


def projection(tree: Tree, camera: int, where: object) -> Array:
    """(3, 4) P of a camera; raises SourceError where there is none."""
    key = _numbers(tree).get(camera, f"P{camera}")
    return values(tree, key, 12, where).reshape(3, 4)


def lidar_of(tree: Tree, camera: int, where: object) -> Array | None:
    """(4, 4) LiDAR into a rectified camera from the file's own `Tr`; None where it has none."""
    return _lidar(tree, projection(tree, camera, where), where)


def values(tree: Tree, key: str, count: int, where: object) -> Array:
    """(count,) numbers of a line; raises SourceError that names it."""
    given = tree.get(key)
    found = to_numbers(given) if isinstance(given, str) else None
    if found is None or len(found) != count:
        raise SourceError(f"bad calibration of {key}", where, f"expected {count} finite numbers")
    return np.array(found)


def whole_pairs(tree: Tree) -> list[tuple[int, int]]:
    """The pairs, grey first, whose two projections are there."""
    numbers = _numbers(tree)
    return [pair for pair in ((0, 1), (2, 3)) if all(number in numbers for number in pair)]


def read(
    tree: Tree, where: Path, cameras: tuple[int, int] | None = None, size: Size | None = None
) -> StereoCalibration:
    """The pair of two camera numbers, by default the first that is whole; raises SourceError in one line.

    size: that of the pictures where it is known; it tells raw pictures from rectified ones.
    """
    keys = _numbers(tree)
    left, right = cameras or next(iter(whole_pairs(tree)), (0, 1))
    P = []
    for number in (left, right):
        if number not in keys:
            raise SourceError(f"calibration has no P{number}", where, "it needs the line of both cameras")
        P.append(values(tree, keys[number], 12, where).reshape(3, 4))
    rect_size, raw_size = (_size(tree, f"{name}_{left:02d}", where) for name in ("S_rect", "S"))
    if f"K_{left:02d}" not in tree and rect_size is None:
        rect_size, raw_size = raw_size, None
    T, notes = None, []
    try:
        T = _lidar(tree, P[0], where)
    except SourceError as error:
        notes.append(f"LiDAR is not used: {error.what}, {error.remedy}")
    stated = float(P[0][0, 3] - P[1][0, 3]) / float(P[1][0, 0]) if P[1][0, 0] > 0 else 0.0
    factor, changed = metres(stated, where)
    if changed is not None:
        notes.append(changed)
        for one in P:
            one[:, 3] *= factor
    target = rectified_or_lenses(P[0], P[1], rect_size, where)
    if isinstance(target, LensPair):
        return StereoCalibration(target, None, True, None, T, tuple(notes), "KITTI")
    lenses = None
    names = [f"{name}_{number:02d}" for name in ("K", "D", "R", "T", "R_rect") for number in (left, right)]
    if all(name in tree for name in names):
        # the lenses are only needed for pictures of their own size: what is wrong with them ends nothing else
        with contextlib.suppress(SourceError):
            lenses, target = _lenses(tree, (left, right), target, raw_size, where)
    raw = lenses is not None and size is not None and size == raw_size and size != rect_size
    return StereoCalibration(lenses, target, raw, None, T, tuple(notes), "KITTI")


def _size(tree: Tree, key: str, where: object) -> Size | None:
    if key not in tree:
        return None
    width, height = values(tree, key, 2, where)
    if not (32 <= width <= MOST_PIXELS_ASIDE and 32 <= height <= MOST_PIXELS_ASIDE):
        raise SourceError(f"bad calibration of {key}", where, "expected width and height in pixels")
    return int(width), int(height)


def _lenses(
    tree: Tree, cameras: tuple[int, int], target: RectifiedPair, size: Size | None, where: object
) -> tuple[LensPair, RectifiedPair]:
    sides, poses, rotations = [], [], []
    for number in cameras:
        name = f"{number:02d}"
        D = to_numbers(str(tree[f"D_{name}"]))
        if D is None:
            raise SourceError(f"bad calibration of D_{name}", where, "expected 5 finite numbers")
        sides.append(lens(values(tree, f"K_{name}", 9, where), np.array(D), "pinhole", where))
        R = values(tree, f"R_{name}", 9, where).reshape(3, 3)
        poses.append((R, values(tree, f"T_{name}", 3, where)))
        rotations.append(values(tree, f"R_rect_{name}", 9, where).reshape(3, 3))
    (R_left, t_left), (R_right, t_right) = poses
    R = R_right @ R_left.T if np.any(R_left != np.eye(3)) else R_right
    pair = lens_pair(sides[0], sides[1], R, t_right - R @ t_left, size, where)
    turned = RectifiedPair(
        *(target.focal_px, target.cx_px, target.cy_px, target.baseline_m, target.cx_right_px, target.size),
        *rotations,
    )
    return pair, turned


def _lidar(tree: Tree, P_left: Array, where: object) -> Array | None:
    """(4, 4) LiDAR into the rectified left camera, from `Tr` and, in the object set, `R0_rect`; None without."""
    key = next((name for name in _LIDAR if name in tree and str(tree[name]).strip()), None)
    if key is None:
        return None
    found = to_numbers(str(tree[key]))
    if found is None or len(found) != 12:
        raise SourceError(f"bad calibration of {key}", where, "expected 12 finite numbers")
    T = np.vstack([np.array(found).reshape(3, 4), [0.0, 0.0, 0.0, 1.0]])
    rect = next((name for name in ("R0_rect", "R_rect") if name in tree), None)
    if rect is not None:
        T = transform(values(tree, rect, 9, where).reshape(3, 3), np.zeros(3)) @ T
    return shifted(T, P_left)


def shifted(T_camera0_lidar: Array, P_left: Array) -> Array:
    """The LiDAR seen from the left camera of a pair, where P's last column sets that apart from camera 0."""
    T = T_camera0_lidar.copy()
    try:
        T[:3, 3] += np.linalg.inv(P_left[:, :3]) @ P_left[:, 3]
    except np.linalg.LinAlgError:
        raise SourceError(
            "bad calibration of P", P_left[:, :3].tolist(), "expected [f 0 cx; 0 f cy; 0 0 1]"
        ) from None
    return T


def write(calibration: StereoCalibration, path: Path) -> dict[Path, str]:
    """The text of a calib.txt of a rectified pair, or of a calib_cam_to_cam.txt of a raw one."""
    from stereocalib_core.sources.calibrations.rectify import completed

    whole = completed(calibration, path) if calibration.rectified is None else calibration
    target = whole.rectified
    assert target is not None
    lines = []
    sides = list(zip(target.projections(), (target.R_left, target.R_right), strict=True))
    if whole.lenses is not None:
        pair = whole.lenses
        for number, one in ((0, pair.left), (1, pair.right)):
            if one.model != "pinhole" or len(one.D) > 5:
                remedy = "it has pinhole lenses of k1 k2 p1 p2 k3 only; write --to opencv or ros"
                raise SourceError("KITTI has no place for this lens", path, remedy)
            name, (P, R_rect) = f"{number:02d}", sides[number]
            R, t = (np.eye(3), np.zeros(3)) if number == 0 else (pair.R, pair.t)
            D = np.append(one.D, np.zeros(5 - len(one.D)))
            entries: list[tuple[str, object]] = [("K", one.K), ("D", D), ("R", R), ("T", t)]
            if pair.size is not None:
                entries.insert(0, ("S", pair.size))
            if target.size is not None:
                entries.append(("S_rect", target.size))
            entries += [("R_rect", R_rect), ("P_rect", P)]
            lines += [f"{key}_{name}: {_words(entry)}" for key, entry in entries]
        return {path: "\n".join(lines) + "\n"}
    for number, (P, _) in enumerate(sides):
        lines.append(f"P{number}: {_words(P)}")
    if target.size is not None:
        lines += [f"S_rect_0{number}: {_words(target.size)}" for number in (0, 1)]
    if whole.T_camera_lidar is not None:
        lines.append(f"Tr: {_words(whole.T_camera_lidar[:3])}")
    return {path: "\n".join(lines) + "\n"}


def _words(entry: object) -> str:
    return " ".join(repr(float(value)) for value in np.ravel(np.asarray(entry, dtype=np.float64)))
