"""OpenCV's FileStorage (YAML, XML, JSON): M1 D1 M2 D2 R T, R1 R2 P1 P2 Q, in one or several files and in the
spellings that its users have for them; ORB-SLAM's `LEFT.K`... and `Camera.fx`... are of the same family."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from stereocalib_core.calibration import LensPair, RectifiedPair, Size, StereoCalibration
from stereocalib_core.config.reading import LEAST_FPS, MOST_FPS, MOST_PIXELS_ASIDE
from stereocalib_core.errors import SourceError
from stereocalib_core.geometry import Array
from stereocalib_core.sources.calibrations.parts import (
    lens,
    lens_model,
    lens_pair,
    metres,
    rectified_or_lenses,
)
from stereocalib_core.sources.calibrations.trees import Tree, array, key_of, number, numbers_in
from stereocalib_core.sources.sides import Side

_LEFT, _RIGHT = ("1", "l", "left"), ("2", "r", "right")
_ZERO_ONE = (("0",), ("1",))
_K = ("m", "k", "cameramatrix", "cm", "mtx", "intrinsic", "intrinsics", "intrinsicmatrix", "cammatrix", "cam")
_D = (
    *("d", "distcoeffs", "distcoeff", "dist", "distcoefs", "distortioncoefficients", "distortioncoeffs"),
    *("distortion", "dc", "coeffs"),
)
_R = ("r", "rotation", "rotationmatrix", "rot", "rmat", "rlr", "rlefttoright")
_T = ("t", "translation", "translationvector", "trans", "tvec", "tlr", "tlefttoright")
_RECTIFY = ("r", "rect", "rectification", "rectificationmatrix")
_PROJECT = ("p", "proj", "projection", "projectionmatrix")
_WIDTHS = ("image_width", "width", "imagewidth", "LEFT.width", "Camera.width", "cols", "img_width")
_HEIGHTS = ("image_height", "height", "imageheight", "LEFT.height", "Camera.height", "rows", "img_height")
_SIZES = ("image_size", "imagesize", "img_size", "size", "imgsize", "frame_size", "resolution")


def _plain(key: object) -> str:
    return re.sub(r"[^a-z0-9]", "", str(key).lower())


def _sided(
    tree: Tree, bases: Sequence[str], side: int, sides: tuple[Sequence[str], Sequence[str]]
) -> str | None:
    """The key of a matrix of one camera: M1, 1_M, camera_matrix_left, left.K, ..."""
    present = {_plain(key): key for key in tree}
    for base in bases:
        for token in sides[side]:
            for name in (base + token, token + base):
                if name in present:
                    return present[name]
    return None


def _sides(tree: Tree) -> tuple[Sequence[str], Sequence[str]] | None:
    """How the two cameras are called: 1 and 2, left and right, or 0 and 1; None where there are not both."""
    for sides in ((_LEFT, _RIGHT), _ZERO_ONE):
        for bases in (_K, _PROJECT):
            if all(_sided(tree, bases, side, sides) for side in (0, 1)):
                return sides
    return None


def is_ours(tree: Tree) -> bool:
    """Whether a file, or several merged, holds both cameras in OpenCV's way."""
    return _sides(tree) is not None or "Camera.bf" in tree


def is_whole(tree: Tree) -> bool:
    """Whether nothing is missing: both projections alone, or both K with R and T or what they follow from."""
    if "Camera.bf" in tree:
        return True
    sides = _sides(tree)
    if sides is None:
        return False
    present = {_plain(key) for key in tree}
    posed = bool(present & set(_R) and present & set(_T))
    if not all(_sided(tree, _K, side, sides) for side in (0, 1)):
        return not posed  # R and T without the lenses that they belong to are half of a calibration
    return posed or _has_rectification(tree, sides)


def _has_rectification(tree: Tree, sides: Any) -> bool:
    return all(_sided(tree, bases, side, sides) for bases in (_RECTIFY, _PROJECT) for side in (0, 1))


def is_part(tree: Tree) -> bool:
    """Whether a file may be one of several: intrinsics of a side, or R and T."""
    present = {_plain(key) for key in tree}
    one = any(_sided(tree, _K, side, sides) for sides in ((_LEFT, _RIGHT), _ZERO_ONE) for side in (0, 1))
    return one or _sides(tree) is not None or bool(present & set(_R) and present & set(_T))


def with_side(tree: Tree, side: Side | None) -> Tree:
    """The file of one camera, `left.yml`, with the side put into the names of its matrices: K as M1, D as D1."""
    if side is None or _sides(tree) is not None:
        return tree
    present = {_plain(key): key for key in tree}
    renamed = dict(tree)
    for bases, letter in ((_K, "M"), (_D, "D")):
        key = next((present[base] for base in bases if base in present), None)
        if key is not None:
            renamed[f"{letter}{side.index + 1}"] = renamed.pop(key)
    return renamed


def read(tree: Tree, where: Path, unit: str | None = None) -> StereoCalibration:
    """A pair from the merged keys of its files; raises SourceError that names what is missing."""
    size = _size(tree, where)
    sides = _sides(tree)
    if sides is None:
        return _orb_slam(tree, size, where)
    fps_key = key_of(tree, "fps", "Camera.fps")
    fps = number(tree, fps_key, where, LEAST_FPS, MOST_FPS) if fps_key else None
    notes: tuple[str, ...] = ()
    projections = [_matrix(tree, _PROJECT, side, sides, 12, where) for side in (0, 1)]
    rotations = [_matrix(tree, _RECTIFY, side, sides, 9, where) for side in (0, 1)]
    target: RectifiedPair | LensPair | None = None
    factor = 1.0
    if projections[0] is not None and projections[1] is not None:
        P_left, P_right = (P.reshape(3, 4).copy() for P in projections)  # type: ignore[union-attr]
        factor, changed = metres(float(P_right[0, 3] / P_right[0, 0]), where, unit)
        P_left[:, 3] *= factor
        P_right[:, 3] *= factor
        notes = (changed,) if changed else ()
        target = rectified_or_lenses(P_left, P_right, size, where)
    keys = [_sided(tree, _K, side, sides) for side in (0, 1)]
    if None in keys:
        return _finished(None, target, fps, notes, where)
    model = lens_model(tree[name] if (name := key_of(tree, *_MODELS)) else None, where)
    lenses = []
    for side in (0, 1):
        K = array(tree, str(keys[side]), (9,), where)
        D_key = _sided(tree, _D, side, sides)
        D = np.zeros(4) if D_key is None else array(tree, D_key, (1, 2, 3, 4, 5, 8, 12, 14), where)
        lenses.append(lens(K, D, model, f"{where}, {keys[side]}"))
    present = {_plain(key): key for key in tree}
    R_key = next((present[name] for name in _R if name in present), None)
    t_key = next((present[name] for name in _T if name in present), None)
    if R_key is not None and t_key is not None:
        R, t = _rotation(tree, R_key, where), array(tree, t_key, (3,), where)
        factor, changed = metres(float(np.linalg.norm(t)), where, unit)
        notes = (changed,) if changed else ()
        pair = lens_pair(lenses[0], lenses[1], R, t * factor, size, where)
    elif rotations[0] is not None and rotations[1] is not None and isinstance(target, RectifiedPair):
        pair = pair_from_rectification(lenses, rotations, target, where)
    else:
        raise SourceError(
            "calibration without R and T", where, "add the file with R and T of the right camera"
        )
    if isinstance(target, RectifiedPair) and rotations[0] is not None and rotations[1] is not None:
        target = _turned(target, rotations, pair)
    else:
        target = None
    return _finished(pair, target, fps, notes, where)


_MODELS = ("distortion_model", "model", "camera_model", "lens_model", "Camera.type")


def pair_from_rectification(
    lenses: Sequence[Any], rotations: Sequence[Array | None], target: RectifiedPair, where: object
) -> LensPair:
    """R and t of the right camera as the rectifying rotations and the baseline imply them."""
    R_left, R_right = (np.array(R, dtype=np.float64).reshape(3, 3) for R in rotations)
    t = R_right.T @ np.array([-target.baseline_m, 0.0, 0.0])
    return lens_pair(lenses[0], lenses[1], R_right.T @ R_left, t, target.size, where)


def _turned(target: RectifiedPair, rotations: Sequence[Any], pair: LensPair) -> RectifiedPair:
    R_left, R_right = (np.array(R, dtype=np.float64).reshape(3, 3) for R in rotations)
    return RectifiedPair(
        *(target.focal_px, target.cx_px, target.cy_px, pair.baseline_m, target.cx_right_px, target.size),
        R_left,
        R_right,
    )


def _finished(
    pair: LensPair | None,
    target: RectifiedPair | LensPair | None,
    fps: float | None,
    notes: tuple[str, ...],
    where: object,
) -> StereoCalibration:
    if isinstance(target, LensPair):
        pair, target = pair or target, None
    if pair is None and target is None:
        raise SourceError("calibration of one camera only", where, "it needs both cameras")
    return StereoCalibration(pair, target, pair is not None, fps, None, notes, "OpenCV")


def _matrix(
    tree: Tree, bases: Sequence[str], side: int, sides: Any, count: int, where: object
) -> Array | None:
    key = _sided(tree, bases, side, sides)
    if key is None:
        return None
    found = numbers_in(tree[key])
    if found is None or len(found) != count:
        return None
    return np.array(found)


def _rotation(tree: Tree, key: str, where: object) -> Array:
    """(9,) a matrix, or a Rodrigues vector."""
    values = array(tree, key, (9, 3), where)
    if len(values) == 9:
        return values
    import cv2

    return np.asarray(cv2.Rodrigues(values)[0], dtype=np.float64).ravel()


def _size(tree: Tree, where: object) -> Size | None:
    width, height = key_of(tree, *_WIDTHS), key_of(tree, *_HEIGHTS)
    if width and height:
        sizes = [number(tree, key, where, 32, MOST_PIXELS_ASIDE, whole=True) for key in (width, height)]
        return int(sizes[0]), int(sizes[1])
    key = key_of(tree, *_SIZES)
    found = numbers_in(tree[key]) if key else None
    if found is None or len(found) != 2 or min(found) < 32 or max(found) > MOST_PIXELS_ASIDE:
        return None
    return int(found[0]), int(found[1])


def _orb_slam(tree: Tree, size: Size | None, where: Path) -> StereoCalibration:
    """ORB-SLAM's settings of a rectified pair: Camera.fx ... and Camera.bf = fx * baseline."""
    fx, fy, cx, cy = (
        number(tree, f"Camera.{key}", where, low, 1e6)
        for key, low in (("fx", 1.0), ("fy", 1.0), ("cx", -1e6), ("cy", -1e6))
    )
    bf = number(tree, "Camera.bf", where, 1e-3, 1e7)
    P_left = np.array([[fx, 0, cx, 0], [0, fy, cy, 0], [0, 0, 1, 0]], np.float64)
    P_right = P_left.copy()
    P_right[0, 3] = -bf
    fps = number(tree, "Camera.fps", where, LEAST_FPS, MOST_FPS) if "Camera.fps" in tree else None
    return _finished(None, rectified_or_lenses(P_left, P_right, size, where), fps, (), where)


def write(calibration: StereoCalibration, path: Path) -> dict[Path, str]:
    """The text of one file in YAML, XML or JSON by its ending; OpenCV's FileStorage reads it."""
    from stereocalib_core.sources.calibrations.rectify import completed

    whole = completed(calibration, path)
    pair, target = whole.pictured(), whole.rectified
    assert target is not None
    P_left, P_right = target.projections()
    right = float(P_right[0, 2])
    Q = np.zeros((4, 4))
    Q[0, 0] = Q[1, 1] = 1.0
    Q[:3, 3] = [-target.cx_px, -target.cy_px, target.focal_px]
    Q[3, 2], Q[3, 3] = 1.0 / target.baseline_m, -(target.cx_px - right) / target.baseline_m
    matrices = {
        "M1": pair.left.K, "D1": pair.left.D.reshape(1, -1), "M2": pair.right.K,
        "D2": pair.right.D.reshape(1, -1), "R": pair.R, "T": pair.t.reshape(3, 1),
        "R1": target.R_left, "R2": target.R_right, "P1": P_left, "P2": P_right, "Q": Q,
    }  # fmt: skip
    plain: dict[str, int | float | str] = {}
    if pair.size is not None:
        plain = {"image_width": pair.size[0], "image_height": pair.size[1]}
    if pair.left.model == "fisheye":
        plain["distortion_model"] = "fisheye"
    if whole.fps is not None:
        plain["fps"] = whole.fps
    writer = {".xml": _xml, ".json": _json}.get(path.suffix.lower(), _yaml)
    return {path: writer(plain, matrices)}


def _yaml(plain: dict[str, Any], matrices: dict[str, Array]) -> str:
    lines = ["%YAML:1.0", "---"]
    lines += [
        f'{key}: "{value}"' if isinstance(value, str) else f"{key}: {value!r}" for key, value in plain.items()
    ]
    for key, matrix in matrices.items():
        rows, cols = matrix.shape
        lines += [f"{key}: !!opencv-matrix", f"   rows: {rows}", f"   cols: {cols}", "   dt: d"]
        words = [repr(float(value)) for value in matrix.ravel()]
        chunks = [", ".join(words[i : i + 3]) for i in range(0, len(words), 3)]
        lines.append("   data: [ " + ",\n       ".join(chunks) + " ]")
    return "\n".join(lines) + "\n"


def _xml(plain: dict[str, Any], matrices: dict[str, Array]) -> str:
    lines = ['<?xml version="1.0"?>', "<opencv_storage>"]
    lines += [
        f"<{key}>{value if isinstance(value, str) else repr(value)}</{key}>" for key, value in plain.items()
    ]
    for key, matrix in matrices.items():
        rows, cols = matrix.shape
        data = "\n    ".join(" ".join(repr(float(value)) for value in row) for row in matrix)
        lines += [f'<{key} type_id="opencv-matrix">', f"  <rows>{rows}</rows>", f"  <cols>{cols}</cols>"]
        lines += ["  <dt>d</dt>", f"  <data>\n    {data}</data></{key}>"]
    return "\n".join([*lines, "</opencv_storage>"]) + "\n"


def _json(plain: dict[str, Any], matrices: dict[str, Array]) -> str:
    values: dict[str, Any] = dict(plain)
    for key, matrix in matrices.items():
        rows, cols = matrix.shape
        data = [float(value) for value in matrix.ravel()]
        values[key] = {"type_id": "opencv-matrix", "rows": rows, "cols": cols, "dt": "d", "data": data}
    return json.dumps(values, indent=1) + "\n"
