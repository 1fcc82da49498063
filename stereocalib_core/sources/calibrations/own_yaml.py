"""`camera.yaml`: the stereo camera of pictures that bring no calibration of their own.

Rectified pictures: `width height focal_px cx_px cy_px baseline_m`, optional `cx_right_px` and `fps`.
Unrectified ones: `width height`, then `left:` and `right:` each with `K` and `D`, and `R`, `t` of right from
left (X_right = R X_left + t, metres) at the top level or under `right:`; optional `model: fisheye`. The pair
is then rectified here, to `focal_px cx_px cy_px` when these are given.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereocalib_core.errors import SourceError
from stereocalib_core.geometry import StereoCamera
from stereocalib_core.system.yaml_file import read_mapping

MAX_SIDE_PX = 16384
_RECTIFIED_KEYS = {"focal_px", "cx_px", "cy_px", "baseline_m", "cx_right_px"}
_KNOWN = _RECTIFIED_KEYS | {"width", "height", "fps", "left", "right", "R", "t", "model"}


@dataclass(frozen=True)
class Rectifier:
    """Look-up maps from both raw pictures to rectified ones; each (H, W, 2) int16 and (H, W) uint16."""

    left: tuple[NDArray[np.int16], NDArray[np.uint16]]
    right: tuple[NDArray[np.int16], NDArray[np.uint16]]

    def apply(
        self, left: NDArray[np.uint8], right: NDArray[np.uint8]
    ) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """Raw (H, W) left and right pictures to rectified ones, bilinear."""
        done = [
            cv2.remap(image, *maps, cv2.INTER_LINEAR)
            for image, maps in ((left, self.left), (right, self.right))
        ]
        return done[0], done[1]  # type: ignore[return-value]


@dataclass(frozen=True)
class CameraFile:
    """What a camera.yaml says: the rectified camera, frames a second if given, and how to rectify if need be."""

    camera: StereoCamera
    fps: float | None
    rectifier: Rectifier | None


def read_camera_file(path: Path) -> CameraFile:
    """Read and check a camera.yaml; raises SourceError that names the key."""
    values = read_mapping(path, "camera file", SourceError)
    unknown = sorted(str(key) for key in values.keys() - _KNOWN)
    if unknown:
        raise SourceError(f"unknown key {unknown[0]}", path, f"known are {' '.join(sorted(_KNOWN))}")
    width, height = (
        int(_number(values, key, path, 32, MAX_SIDE_PX, whole=True)) for key in ("width", "height")
    )
    fps = _number(values, "fps", path, 1e-3, 1e4) if "fps" in values else None
    if "left" in values or "right" in values:
        camera, rectifier = _rectified(values, (width, height), path)
        return CameraFile(camera, fps, rectifier)
    camera = StereoCamera(
        width,
        height,
        _number(values, "focal_px", path, 1.0, 1e6),
        _number(values, "cx_px", path, -width, 2 * width),
        _number(values, "cy_px", path, -height, 2 * height),
        _number(values, "baseline_m", path, 1e-3, 100.0),
        _number(values, "cx_right_px", path, -width, 2 * width) if "cx_right_px" in values else None,
    )
    return CameraFile(camera, fps, None)


def _number(
    values: dict[str, Any], key: str, path: Path, low: float, high: float, whole: bool = False
) -> float:
    value = values.get(key)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise SourceError(f"{key} is missing or no number", path, f"write `{key}: NUMBER`")
    if not low <= value <= high or (whole and value != int(value)):
        kind = "a whole number" if whole else "a number"
        raise SourceError(f"{key} is {str(value)[:20]}", path, f"expected {kind} from {low:g} to {high:g}")
    return float(value)


def _array(values: Any, key: str, sizes: tuple[int, ...], where: str) -> NDArray[np.float64]:
    """Nested lists of numbers under `key`, flattened; its length must be one of `sizes`."""
    given = values.get(key) if isinstance(values, dict) else None
    try:
        array = np.array(given, dtype=np.float64).ravel()
    except (TypeError, ValueError, OverflowError):
        array = np.array([np.nan])
    if len(array) not in sizes or not np.isfinite(array).all():
        expected = " or ".join(str(size) for size in sizes)
        raise SourceError(f"{key} is missing or wrong", where, f"expected {expected} finite numbers")
    return array


def _rectified(values: dict[str, Any], size: tuple[int, int], path: Path) -> tuple[StereoCamera, Rectifier]:
    model = values.get("model", "pinhole")
    if model not in ("pinhole", "fisheye"):
        raise SourceError(f"unknown model {str(model)[:20]}", path, "use pinhole or fisheye")
    counts = (4,) if model == "fisheye" else (4, 5, 8, 12, 14)
    K, D = [], []
    for side in ("left", "right"):
        where = f"{path}, {side}"
        K.append(_array(values.get(side), "K", (9,), where).reshape(3, 3))
        D.append(_array(values.get(side), "D", counts, where))
        if (
            K[-1][0, 0] <= 0
            or K[-1][1, 1] <= 0
            or K[-1][2, 2] != 1
            or np.any(K[-1][[1, 2, 2], [0, 0, 1]] != 0)
        ):
            raise SourceError(
                "K is no camera matrix", where, "expected [[fx, s, cx], [0, fy, cy], [0, 0, 1]]"
            )
    home = values if "R" in values or "t" in values else values.get("right")
    R = _array(home, "R", (9,), str(path)).reshape(3, 3)
    t = _array(home, "t", (3,), str(path))
    if np.abs(R @ R.T - np.eye(3)).max() > 1e-3 or np.linalg.det(R) < 0:
        raise SourceError("R is no rotation", path, "expected an orthonormal 3x3 matrix of right from left")
    baseline = float(np.linalg.norm(t))
    if t[0] >= 0 or abs(t[0]) < 0.7 * baseline or not 1e-3 < baseline < 100:
        remedy = "the right camera must lie to the right of the left one, t[0] < 0 in metres"
        raise SourceError(f"t is {np.round(t, 4).tolist()}", path, remedy)
    if "baseline_m" in values and abs(_number(values, "baseline_m", path, 1e-3, 100.0) / baseline - 1) > 0.02:
        raise SourceError("baseline_m and t disagree", path, f"t is {baseline:.4g} m long; drop one of them")
    R_left, R_right, P = _rectifying_rotations(model, K, D, size, R, t.reshape(3, 1))
    P = _wanted_matrix(P, values, size, path)
    camera = StereoCamera(size[0], size[1], float(P[0, 0]), float(P[0, 2]), float(P[1, 2]), baseline)
    init = cv2.fisheye.initUndistortRectifyMap if model == "fisheye" else cv2.initUndistortRectifyMap
    maps = [
        init(K[side], D[side], rotation, P, size, cv2.CV_16SC2)
        for side, rotation in ((0, R_left), (1, R_right))
    ]
    return camera, Rectifier(maps[0], maps[1])  # type: ignore[arg-type]


def _rectifying_rotations(
    model: str,
    K: list[NDArray[np.float64]],
    D: list[NDArray[np.float64]],
    size: tuple[int, int],
    R: NDArray[np.float64],
    t: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Rotations of both cameras into the rectified one, and its (3, 3) matrix with equal focal lengths."""
    if model == "fisheye":
        R_left, R_right, P, *_ = cv2.fisheye.stereoRectify(
            K[0], D[0], K[1], D[1], size, R, t, cv2.CALIB_ZERO_DISPARITY, balance=0.0
        )
    else:
        R_left, R_right, P, *_ = cv2.stereoRectify(
            K[0], D[0], K[1], D[1], size, R, t, flags=cv2.CALIB_ZERO_DISPARITY, alpha=0.0
        )
    P = np.array(P[:3, :3])
    P[1, 1] = P[0, 0]
    return R_left, R_right, P  # type: ignore[return-value]


def _wanted_matrix(
    P: NDArray[np.float64], values: dict[str, Any], size: tuple[int, int], path: Path
) -> NDArray[np.float64]:
    wanted = P.copy()
    if "focal_px" in values:
        wanted[0, 0] = wanted[1, 1] = _number(values, "focal_px", path, 1.0, 1e6)
    if "cx_px" in values:
        wanted[0, 2] = _number(values, "cx_px", path, -size[0], 2 * size[0])
    if "cy_px" in values:
        wanted[1, 2] = _number(values, "cy_px", path, -size[1], 2 * size[1])
    if not np.isfinite(wanted).all() or not 0.05 * size[0] < wanted[0, 0] < 50 * size[0]:
        raise SourceError("the pair cannot be rectified", path, "check K, D, R and t, or give focal_px")
    return wanted
