"""Kalibr's camchain (`cam0:`, `cam1:` in one file) and EuRoC's pair of sensor.yaml (one a camera, with T_BS)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from stereocalib_core.calibration import Lens, RectifiedPair, Size, StereoCalibration
from stereocalib_core.config.reading import LEAST_FPS, MOST_FPS, MOST_PIXELS_ASIDE, SIDEWAYS
from stereocalib_core.errors import SourceError
from stereocalib_core.geometry import Array, invert_transform
from stereocalib_core.sources.calibrations.parts import lens, lens_model, lens_pair, metres
from stereocalib_core.sources.calibrations.trees import Tree, array, number, numbers_in


def is_chain(tree: Tree) -> bool:
    """Whether a file is a camchain of two or more cameras."""
    return all(isinstance(tree.get(name), dict) and "intrinsics" in tree[name] for name in ("cam0", "cam1"))


def is_sensor(tree: Tree) -> bool:
    """Whether a file is the sensor.yaml of one camera."""
    return "T_BS" in tree and "intrinsics" in tree


def _lens(tree: Tree, where: str) -> tuple[Lens, Size | None]:
    camera = str(tree.get("camera_model", "pinhole")).lower()
    if camera not in ("pinhole", "none"):
        raise SourceError(f"unknown model {camera[:30]}", where, "use pinhole with radtan or equidistant")
    fx, fy, cx, cy = array(tree, "intrinsics", (4,), where)
    K = np.array([fx, 0, cx, 0, fy, cy, 0, 0, 1.0])
    D_key = next((key for key in ("distortion_coeffs", "distortion_coefficients") if key in tree), None)
    D = np.zeros(4) if D_key is None or not tree[D_key] else array(tree, D_key, tuple(range(1, 15)), where)
    model = lens_model(tree.get("distortion_model", "none"), where)
    found = numbers_in(tree.get("resolution"))
    if found is not None and not (
        len(found) == 2 and all(32 <= side <= MOST_PIXELS_ASIDE and side == int(side) for side in found)
    ):
        raise SourceError("resolution is wrong", where, "expected [width, height]")
    return lens(K, D, model, where), None if found is None else (int(found[0]), int(found[1]))


def _pair(
    left: tuple[Lens, Size | None],
    right: tuple[Lens, Size | None],
    T_right_left: Array,
    where: object,
    unit: str | None,
) -> tuple[Any, tuple[str, ...]]:
    t = T_right_left[:3, 3]
    factor, changed = metres(float(np.linalg.norm(t)), where, unit)
    if left[1] != right[1]:
        raise SourceError("cameras of two sizes", where, f"left {left[1]}, right {right[1]}")
    if t[0] > 0 and t[0] > SIDEWAYS * np.linalg.norm(t):
        remedy = "the second camera lies left of the first: exchange cam0 and cam1, pictures included"
        raise SourceError("cameras in the wrong order", where, remedy)
    pair = lens_pair(left[0], right[0], T_right_left[:3, :3], t * factor, left[1], where)
    return pair, (changed,) if changed else ()


def read_chain(tree: Tree, where: Path, unit: str | None = None) -> StereoCalibration:
    """The first two cameras of a camchain."""
    left, right = (_lens(tree[name], f"{where}, {name}") for name in ("cam0", "cam1"))
    T = array(tree["cam1"], "T_cn_cnm1", (16,), f"{where}, cam1").reshape(4, 4)
    pair, notes = _pair(left, right, T, where, unit)
    target = None
    keys = ("rectification_matrix", "projection_matrix")
    if all(key in tree[name] for name in ("cam0", "cam1") for key in keys):
        R = [array(tree[name], keys[0], (9,), where).reshape(3, 3) for name in ("cam0", "cam1")]
        P = [array(tree[name], keys[1], (12,), where).reshape(3, 4) for name in ("cam0", "cam1")]
        cx_right = float(P[1][0, 2])
        target = RectifiedPair(
            *(float(P[0][0, 0]), float(P[0][0, 2]), float(P[0][1, 2]), pair.baseline_m),
            None if cx_right == P[0][0, 2] else cx_right,
            pair.size,
            *R,
        )
    return StereoCalibration(pair, target, True, None, None, notes, "Kalibr camchain")


def body_from_camera(tree: Tree, where: object) -> Array:
    """(4, 4) T_body_camera of a sensor.yaml."""
    return array(tree, "T_BS", (16,), where).reshape(4, 4)


def read_sensors(left: Tree, right: Tree, where: Path, unit: str | None = None) -> StereoCalibration:
    """The pair of two sensor.yaml."""
    T_left, T_right = (body_from_camera(tree, where) for tree in (left, right))
    sides = _lens(left, f"{where}, left"), _lens(right, f"{where}, right")
    # products of two rigid poses: what is below rounding of the file is nothing
    T = invert_transform(T_right) @ T_left
    T[np.abs(T) < 1e-12] = 0.0
    pair, notes = _pair(*sides, T, where, unit)
    fps = number(left, "rate_hz", where, LEAST_FPS, MOST_FPS) if "rate_hz" in left else None
    return StereoCalibration(pair, None, True, fps, None, notes, "EuRoC sensor.yaml")


def write(calibration: StereoCalibration, path: Path) -> dict[Path, str]:
    """The text of a camchain. Raises SourceError for a lens that Kalibr has no model for."""
    pair, target = calibration.pictured(), calibration.rectified
    if pair.size is None:
        raise SourceError("calibration without a picture size", path, "name the size, --size WIDTHxHEIGHT")
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = pair.R, pair.t
    lines = []
    for name, one, R in (
        ("cam0", pair.left, None if target is None else target.R_left),
        ("cam1", pair.right, None if target is None else target.R_right),
    ):
        if len(one.D) > 4:
            remedy = "its radtan has k1 k2 p1 p2 only; write --to opencv or ros"
            raise SourceError(f"Kalibr has no place for {len(one.D)} coefficients", path, remedy)
        K = one.K
        lines += [f"{name}:"]
        if name == "cam1":
            lines += ["  T_cn_cnm1:", *(f"  - {_row(row)}" for row in T)]
        lines += [
            "  camera_model: pinhole",
            f"  distortion_coeffs: {_row(one.D)}",
            f"  distortion_model: {'equidistant' if one.model == 'fisheye' else 'radtan'}",
            f"  intrinsics: {_row(np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2]]))}",
            f"  resolution: [{pair.size[0]}, {pair.size[1]}]",
            f"  rostopic: /{name}/image_raw",
        ]
        if target is not None and R is not None and calibration.raw_pictures:
            P = target.projections()[0 if name == "cam0" else 1]
            lines += [f"  rectification_matrix: {_row(R)}", f"  projection_matrix: {_row(P)}"]
    return {path: "\n".join(lines) + "\n"}


def _row(values: Array) -> str:
    return "[" + ", ".join(repr(float(value)) for value in np.ravel(values)) + "]"
