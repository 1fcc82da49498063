"""ROS camera_info, one file for the left camera and one for the right: `camera_matrix:` ... as camera_calibration
writes it, or the message itself (`K: D: R: P:`, in capitals or not)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from stereocalib_core.calibration import LensPair, RectifiedPair, StereoCalibration
from stereocalib_core.config.reading import MOST_PIXELS_ASIDE
from stereocalib_core.errors import SourceError
from stereocalib_core.geometry import Array
from stereocalib_core.sources.calibrations.opencv import pair_from_rectification
from stereocalib_core.sources.calibrations.parts import lens, lens_model, metres, rectified_or_lenses
from stereocalib_core.sources.calibrations.trees import Tree, array, key_of, number

_MATRIX = ("camera_matrix", "K")
_ROTATION = ("rectification_matrix", "R")
_PROJECTION = ("projection_matrix", "P")
_DISTORTION = ("distortion_coefficients", "distortion_coeffs", "D")


@dataclass(frozen=True, eq=False)
class CameraInfo:
    """One camera_info: K (9,), D (n,), R (9,), P (12,)."""

    width: int
    height: int
    model: str
    K: Array
    D: Array
    R: Array
    P: Array


def is_side(tree: Tree) -> bool:
    """Whether a file is the camera_info of one camera."""
    return (
        all(key_of(tree, *names) for names in (_MATRIX, _PROJECTION))
        and key_of(tree, "image_width", "width") is not None
    )


def is_right(tree: Tree) -> bool:
    """Whether it is the right camera's: the one whose P carries the baseline."""
    key = key_of(tree, *_PROJECTION)
    try:
        return key is not None and bool(array(tree, key, (12,), "")[3] != 0)
    except SourceError:
        return False


def camera_info(tree: Tree, where: object) -> CameraInfo:
    """The values of one file; raises SourceError that names what is missing."""

    def values(names: Sequence[str], sizes: tuple[int, ...], default: Any = None) -> Array:
        key = key_of(tree, *names)
        if key is None and default is not None:
            return np.array(default, dtype=np.float64)
        return array(tree, key or names[0], sizes, where)

    sizes = [
        int(
            number(
                tree, key_of(tree, f"image_{name}", name) or name, where, 32, MOST_PIXELS_ASIDE, whole=True
            )
        )
        for name in ("width", "height")
    ]
    return CameraInfo(
        sizes[0],
        sizes[1],
        str(tree.get("distortion_model", "plumb_bob")),
        values(_MATRIX, (9,)),
        values(_DISTORTION, tuple(range(15)), []),
        values(_ROTATION, (9,), np.eye(3).ravel()),
        values(_PROJECTION, (12,)),
    )


def read(left: Tree, right: Tree, where: object, unit: str | None = None) -> StereoCalibration:
    """The pair of two files; raises SourceError in one line."""
    return from_infos(camera_info(left, f"{where}, left"), camera_info(right, f"{where}, right"), where, unit)


def from_infos(
    left: CameraInfo, right: CameraInfo, where: object, unit: str | None = None
) -> StereoCalibration:
    """The pair of two camera_info."""
    size = left.width, left.height
    if (right.width, right.height) != size:
        remedy = f"left is {size[0]}x{size[1]}, right {right.width}x{right.height}"
        raise SourceError("cameras of two sizes", where, remedy)
    P_left, P_right = (info.P.reshape(3, 4).copy() for info in (left, right))
    if P_right[0, 3] == 0 and P_left[0, 3] == 0:
        remedy = "P[0][3] of the right camera must be -f * baseline: calibrate them as a pair"
        raise SourceError("camera_info without a baseline", where, remedy)
    factor, changed = metres(float(P_right[0, 3] / P_right[0, 0]) if P_right[0, 0] else 0.0, where, unit)
    P_left[:, 3] *= factor
    P_right[:, 3] *= factor
    target = rectified_or_lenses(P_left, P_right, size, where)
    notes = (changed,) if changed else ()
    if isinstance(target, LensPair):
        return StereoCalibration(target, None, True, None, None, notes, "ROS camera_info")
    lenses = [lens(info.K, info.D, lens_model(info.model, where), where) for info in (left, right)]
    pair = pair_from_rectification(lenses, [left.R, right.R], target, where)
    rectified = RectifiedPair(
        *(target.focal_px, target.cx_px, target.cy_px, target.baseline_m, target.cx_right_px, size),
        left.R.reshape(3, 3),
        right.R.reshape(3, 3),
    )
    return StereoCalibration(pair, rectified, True, None, None, notes, "ROS camera_info")


def write(calibration: StereoCalibration, path: Path) -> dict[Path, str]:
    """Two files, NAME_left.yaml and NAME_right.yaml, or left.yaml and right.yaml in a folder."""
    from stereocalib_core.sources.calibrations.rectify import completed

    whole = completed(calibration, path)
    pair, target = whole.pictured(), whole.rectified
    assert target is not None
    if pair.size is None:
        raise SourceError("calibration without a picture size", path, "name the size, --size WIDTHxHEIGHT")
    texts = {}
    sides = (("left", pair.left, target.R_left), ("right", pair.right, target.R_right))
    for (side, one, R), P in zip(sides, target.projections(), strict=True):
        model = "equidistant" if one.model == "fisheye" else "plumb_bob"
        D = one.D
        if model == "plumb_bob" and len(D) < 5:
            D = np.append(D, np.zeros(5 - len(D)))
        elif model == "plumb_bob" and len(D) > 5:
            model = "rational_polynomial"
        name = path.stem.removesuffix("_left").removesuffix("_right")
        target_path = path.with_name(f"{name}_{side}.yaml") if path.suffix else path / f"{side}.yaml"
        texts[target_path] = "\n".join(
            [
                f"image_width: {pair.size[0]}",
                f"image_height: {pair.size[1]}",
                f"camera_name: {side}",
                *_block("camera_matrix", one.K),
                f"distortion_model: {model}",
                *_block("distortion_coefficients", D.reshape(1, -1)),
                *_block("rectification_matrix", R),
                *_block("projection_matrix", P),
                "",
            ]
        )
    return texts


def _block(name: str, matrix: Array) -> list[str]:
    data = ", ".join(repr(float(value)) for value in matrix.ravel())
    return [f"{name}:", f"  rows: {matrix.shape[0]}", f"  cols: {matrix.shape[1]}", f"  data: [{data}]"]
