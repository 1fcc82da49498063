"""`camera.yaml`: the stereo camera of pictures that bring no calibration of their own.

Rectified pictures: `width height focal_px cx_px cy_px baseline_m`, optional `cx_right_px` and `fps`.
Unrectified ones: `width height`, then `left:` and `right:` each with `K` and `D`, and `R`, `t` of right from
left (X_right = R X_left + t, metres) at the top level or under `right:`; optional `model: fisheye`. The pair
is then rectified while reading, to `focal_px cx_px cy_px` when these are given. `R_left`, `R_right` keep the
rectifying rotations of another tool, `T_camera_lidar` (4x4) places a LiDAR.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from stereocalib_core.calibration import LensPair, RectifiedPair, StereoCalibration, rectifying_rotations
from stereocalib_core.config.reading import (
    FOCAL_OF_WIDTH,
    LEAST_FPS,
    MOST_FPS,
    MOST_PIXELS_ASIDE,
    SAME_BASELINE,
)
from stereocalib_core.errors import SourceError
from stereocalib_core.geometry import Array, StereoCamera
from stereocalib_core.sources.calibrations.parts import check_baseline, lens, lens_model, lens_pair, metres
from stereocalib_core.sources.calibrations.rectify import Rectifier, default_target, opened
from stereocalib_core.sources.calibrations.trees import Tree, array, number, read_tree

_RECTIFIED_KEYS = {"focal_px", "cx_px", "cy_px", "baseline_m", "cx_right_px"}
_KNOWN = _RECTIFIED_KEYS | {
    *("width", "height", "fps", "left", "right", "R", "t", "model"),
    *("R_left", "R_right", "T_camera_lidar"),
}


@dataclass(frozen=True)
class CameraFile:
    """What a camera.yaml says: the rectified camera, frames a second if given, and how to rectify if need be."""

    camera: StereoCamera
    fps: float | None
    rectifier: Rectifier | None


def is_ours(tree: Tree) -> bool:
    """Whether a file is a camera.yaml."""
    return "focal_px" in tree or "baseline_m" in tree or isinstance(tree.get("left"), dict)


def read(tree: Tree, path: Path, unit: str | None = None) -> StereoCalibration:
    """Read and check a camera.yaml; raises SourceError that names the key."""
    unknown = sorted(str(key) for key in tree.keys() - _KNOWN)
    if unknown:
        raise SourceError(f"unknown key {unknown[0]}", path, f"known are {' '.join(sorted(_KNOWN))}")
    width, height = (
        int(number(tree, key, path, 32, MOST_PIXELS_ASIDE, whole=True)) for key in ("width", "height")
    )
    fps = number(tree, "fps", path, LEAST_FPS, MOST_FPS) if "fps" in tree else None
    T = array(tree, "T_camera_lidar", (16,), path).reshape(4, 4) if "T_camera_lidar" in tree else None
    if "left" in tree or "right" in tree:
        lenses, note = _lenses(tree, (width, height), path, unit)
        target = _target(lenses, tree, path)
        return StereoCalibration(lenses, target, True, fps, T, note, "own yaml")
    focal_px = number(tree, "focal_px", path, 1.0, 1e6)
    cx_px = number(tree, "cx_px", path, -width, 2 * width)
    cy_px = number(tree, "cy_px", path, -height, 2 * height)
    stated = number(tree, "baseline_m", path, 1e-3, 1e5)
    factor, changed = metres(stated, path, unit)
    right = number(tree, "cx_right_px", path, -width, 2 * width) if "cx_right_px" in tree else None
    pair = RectifiedPair(focal_px, cx_px, cy_px, stated * factor, right, (width, height))
    return StereoCalibration(None, pair, False, fps, T, (changed,) if changed else (), "own yaml")


def _lenses(
    tree: Tree, size: tuple[int, int], path: Path, unit: str | None
) -> tuple[LensPair, tuple[str, ...]]:
    model = lens_model(tree.get("model"), path)
    sides = []
    for side in ("left", "right"):
        where = f"{path}, {side}"
        counts = (0, 1, 2, 3, 4) if model == "fisheye" else (0, 1, 2, 3, 4, 5, 8, 12, 14)
        K = array(tree.get(side), "K", (9,), where)
        sides.append(lens(K, array(tree.get(side), "D", counts, where), model, where))
    home = tree if "R" in tree or "t" in tree else tree.get("right")
    R, t = array(home, "R", (9,), path), array(home, "t", (3,), path)
    factor, changed = metres(float(np.linalg.norm(t)), path, unit)
    pair = lens_pair(sides[0], sides[1], R, t * factor, size, path)
    if "baseline_m" in tree:
        stated = number(tree, "baseline_m", path, 1e-3, 1e5)
        if not any(
            abs(stated * unit_m / pair.baseline_m - 1) <= SAME_BASELINE for unit_m in (1.0, 1e-2, 1e-3)
        ):
            remedy = f"t is {pair.baseline_m:.4g} m long; drop one of them"
            raise SourceError("baseline_m and t disagree", path, remedy)
    return pair, (changed,) if changed else ()


def _target(pair: LensPair, tree: Tree, path: Path) -> RectifiedPair | None:
    """The rectified camera that the file asks for, None where it leaves that to us."""
    if not tree.keys() & {"focal_px", "cx_px", "cy_px", "R_left"}:
        return None
    assert pair.size is not None
    width, height = pair.size
    target = default_target(pair, pair.size, path)
    wanted: dict[str, Any] = {}
    for key, low, high in (
        ("focal_px", 1.0, 1e6), ("cx_px", -width, 2 * width), ("cy_px", -height, 2 * height)
    ):  # fmt: skip
        if key in tree:
            wanted[key] = number(tree, key, path, low, high)
    R_left, R_right = rectifying_rotations(pair.R, pair.t)
    if "R_left" in tree:
        R_left = array(tree, "R_left", (9,), path).reshape(3, 3)
        R_right = array(tree, "R_right", (9,), path).reshape(3, 3)
    target = dataclasses.replace(target, **wanted, R_left=R_left, R_right=R_right)
    if not FOCAL_OF_WIDTH[0] * width < target.focal_px < FOCAL_OF_WIDTH[1] * width:
        raise SourceError("the pair cannot be rectified", path, "check K, D, R and t, or give focal_px")
    check_baseline(target.baseline_m, path)
    return target


def read_camera_file(path: Path) -> CameraFile:
    """A camera.yaml made ready for pictures of the size it states; raises SourceError."""
    calibration = read(read_tree(path), path)
    assert calibration.size is not None
    ready = opened(calibration, calibration.size, path)
    return CameraFile(ready.camera, calibration.fps, ready.rectifier)


def write(calibration: StereoCalibration, path: Path) -> dict[Path, str]:
    """The text of a camera.yaml."""
    if calibration.size is None:
        raise SourceError("calibration without a picture size", path, "name the size, --size WIDTHxHEIGHT")
    lines = [f"width: {calibration.size[0]}", f"height: {calibration.size[1]}"]
    if calibration.fps is not None:
        lines.append(f"fps: {calibration.fps!r}")
    pair, target = calibration.lenses, calibration.rectified
    if pair is not None and calibration.raw_pictures:
        lines.append(f"model: {pair.left.model}")
        for side, one in (("left", pair.left), ("right", pair.right)):
            lines += [f"{side}:", f"  K: {_rows(one.K)}", f"  D: {_row(one.D)}"]
        lines += ["# of the right camera from the left one: X_right = R X_left + t, metres"]
        lines += [f"R: {_rows(pair.R)}", f"t: {_row(pair.t)}"]
    if target is not None:
        lines += [f"{key}: {getattr(target, key)!r}" for key in ("focal_px", "cx_px", "cy_px")]
        if pair is None or not calibration.raw_pictures:
            lines.append(f"baseline_m: {target.baseline_m!r}")
            if target.cx_right_px is not None:
                lines.append(f"cx_right_px: {target.cx_right_px!r}")
        else:
            lines += [f"R_left: {_rows(target.R_left)}", f"R_right: {_rows(target.R_right)}"]
    if calibration.T_camera_lidar is not None:
        lines.append(f"T_camera_lidar: {_rows(calibration.T_camera_lidar)}")
    return {path: "\n".join(lines) + "\n"}


def _row(values: Array) -> str:
    return "[" + ", ".join(repr(float(value)) for value in np.ravel(values)) + "]"


def _rows(matrix: Array) -> str:
    return "[" + ", ".join(_row(row) for row in matrix) + "]"
