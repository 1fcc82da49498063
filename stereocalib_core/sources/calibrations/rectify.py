"""From raw pictures to rectified ones: the camera they then have and the look-up maps."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from stereocalib_core.calibration import (
    Lens,
    LensPair,
    RectifiedPair,
    Size,
    StereoCalibration,
    rectifying_rotations,
    rotation_angle,
)
from stereocalib_core.config.reading import (
    FOCAL_OF_WIDTH,
    LARGEST_ZOOM,
    RESIZED,
    SAME_VIEW_RAD,
    SMALLEST_ZOOM,
    SQUEEZED,
    TURNED_RAD,
)
from stereocalib_core.errors import SourceError
from stereocalib_core.geometry import Array, StereoCamera

BORDER_POINTS = 33


@dataclass(frozen=True)
class Rectifier:
    """Look-up maps from both raw pictures to rectified ones; each (H, W, 2) int16 and (H, W) uint16."""

    left: tuple[NDArray[np.int16], NDArray[np.uint16]]
    right: tuple[NDArray[np.int16], NDArray[np.uint16]]

    def apply(
        self, left: NDArray[np.uint8], right: NDArray[np.uint8]
    ) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """Raw (H, W) left and right pictures to rectified ones.

        Bicubic: bilinear blurs each place by how far its pixels move, and such a pattern shows as roll.
        """
        done = [
            cv2.remap(image, *maps, cv2.INTER_CUBIC)
            for image, maps in ((left, self.left), (right, self.right))
        ]
        return done[0], done[1]  # type: ignore[return-value]


@dataclass(frozen=True)
class Opened:
    """A calibration made ready for pictures of one size: the rectified camera, and how to rectify if need be.

    R_left: (3, 3) from the left camera's own axes to the rectified ones.
    """

    camera: StereoCamera
    rectifier: Rectifier | None
    R_left: Array
    notes: tuple[str, ...] = ()


def needs_rectifying(pair: LensPair) -> bool:
    """Whether pictures of these lenses are not rectified as they are."""
    left, right = pair.left, pair.right
    if not (left.ideal and right.ideal):
        return True
    K, K_right = left.K, right.K
    focal = K[0, 0]
    same = np.abs(np.array([K[1, 1], K_right[0, 0], K_right[1, 1]]) / focal - 1).max() < 1e-9
    same = same and K[1, 2] == K_right[1, 2] and K[0, 1] == 0 and K_right[0, 1] == 0
    return not (same and all(rotation_angle(R) == 0 for R in rectifying_rotations(pair.R, pair.t)))


def opened(calibration: StereoCalibration, size: Size, where: object) -> Opened:
    """The camera and maps for pictures of (width, height); raises SourceError in one line."""
    check_size(calibration, size, where)
    pair, target = calibration.lenses, calibration.rectified
    if not calibration.raw_pictures and target is not None:
        _check_principal_point(target, size, where)
        return Opened(target.camera(size), None, np.eye(3), calibration.notes)
    assert pair is not None
    if not needs_rectifying(pair):
        target = ideal_target(pair, size)
        _check_principal_point(target, size, where)
        return Opened(target.camera(size), None, np.eye(3), calibration.notes)
    R_left, R_right = rectifying_rotations(pair.R, pair.t)
    if target is not None and rotation_angle(target.R_left @ R_left.T) > SAME_VIEW_RAD:
        target = None
    target = dataclasses.replace(
        target if target is not None else default_target(pair, size, where),
        baseline_m=pair.baseline_m,
        cx_right_px=None,
        size=size,
    )
    if not FOCAL_OF_WIDTH[0] * size[0] < target.focal_px < FOCAL_OF_WIDTH[1] * size[0]:
        raise SourceError("the pair cannot be rectified", where, "check K, D, R and t, or give focal_px")
    P = target.projections()[0][:, :3]
    maps = [_maps(lens, rotation, P, size) for lens, rotation in ((pair.left, R_left), (pair.right, R_right))]
    note = ["pictures are unrectified: rectified while reading"]
    turned = rotation_angle(R_left)
    if turned > TURNED_RAD:
        note.append(
            "the baseline is not along the left camera's x axis: angles are those of axes "
            f"{np.rad2deg(turned):.3f} deg from the camera's own"
        )
    return Opened(target.camera(size), Rectifier(*maps), R_left, (*calibration.notes, *note))


def check_size(calibration: StereoCalibration, size: Size, where: object) -> None:
    """Raise SourceError where the calibration's own size, or its principal point, is that of other pictures."""
    own = calibration.size
    pictures = f"{size[0]}x{size[1]}"
    if own is not None and own != size:
        scales = size[0] / own[0], size[1] / own[1]
        remedy = f"pictures are {pictures}, the calibration is for {own[0]}x{own[1]}"
        if abs(scales[0] - scales[1]) < 2.0 / min(own):
            remedy += f": scale its focal length and principal point by {scales[0]:.4g}"
        raise SourceError("pictures do not fit the camera", where, remedy)


def _check_principal_point(target: RectifiedPair, size: Size, where: object) -> None:
    (width, height), cx, cy = size, target.cx_px, target.cy_px
    if not (-width < cx < 2 * width and -height < cy < 2 * height):
        what = f"principal point ({cx:g}, {cy:g}) px"
        raise SourceError(what, where, f"does not fit pictures of {width}x{height}")
    if target.size is not None:
        return
    across, down = 2 * (cx + 0.5) / width, 2 * (cy + 0.5) / height
    resized = abs(np.log(across)) > RESIZED and abs(np.log(down)) > RESIZED
    if resized and abs(np.log(across / down)) < RESIZED / 2:
        scale = 2.0 / (across + down)
        other = f"{width / scale:.0f}x{height / scale:.0f}"
        remedy = f"the principal point ({cx:g}, {cy:g}) is the middle of about {other}, pictures are {width}x{height}: "
        remedy += f"scale focal length and principal point by {scale:.2f}, or state the size in a camera.yaml"
        raise SourceError("calibration of pictures of another size", where, remedy)
    sides = ("x", cx, across, "width", width), ("y", cy, down, "height", height)
    for name, at, ratio, side, length in sides:
        if ratio > SQUEEZED:
            remedy = (
                f"the principal point's {name} of {at:g} lies at {ratio / 2:.0%} of the {side} of {length}: "
            )
            remedy += f"stretch the pictures to a {side} of about {ratio * length:.0f}"
            remedy += ", or state their size in a camera.yaml"
            raise SourceError("pictures squeezed, or cut, after their calibration", where, remedy)


def ideal_target(pair: LensPair, size: Size | None) -> RectifiedPair:
    """The rectified pair that ideal, parallel lenses are already."""
    K, K_right = pair.left.K, pair.right.K
    cx, cx_right = float(K[0, 2]), float(K_right[0, 2])
    return RectifiedPair(
        float(K[0, 0]), cx, float(K[1, 2]), pair.baseline_m, None if cx_right == cx else cx_right, size
    )


def default_target(pair: LensPair, size: Size, where: object) -> RectifiedPair:
    """A rectified camera that shows as much as both raw pictures cover, at about their own resolution."""
    boxes = [
        _covered(lens, rotation, size)
        for lens, rotation in zip((pair.left, pair.right), rectifying_rotations(pair.R, pair.t), strict=True)
    ]
    low = np.max([box[0] for box in boxes], axis=0)
    high = np.min([box[1] for box in boxes], axis=0)
    if not np.isfinite([*low, *high]).all() or np.any(high - low <= 1e-6):
        raise SourceError("the pair cannot be rectified", where, "check K, D, R and t, or give focal_px")
    raw = float(np.sqrt(pair.left.K[0, 0] * pair.left.K[1, 1]))
    last = np.array(size) - 1.0
    focal = float(np.clip(np.max(last / (high - low)), SMALLEST_ZOOM * raw, LARGEST_ZOOM * raw))
    centre = last / 2 - focal * (low + high) / 2
    return RectifiedPair(focal, float(centre[0]), float(centre[1]), pair.baseline_m, None, size)


def _covered(lens: Lens, rotation: Array, size: Size) -> tuple[Array, Array]:
    """Corners (2,), (2,) of the largest upright box of rectified, normalised coordinates that a raw picture fills."""
    u, v = (np.linspace(0, side - 1.0, BORDER_POINTS) for side in size)
    right, bottom = size[0] - 1.0, size[1] - 1.0
    sides = [
        np.stack([np.zeros_like(v), v], -1),
        np.stack([np.full_like(v, right), v], -1),
        np.stack([u, np.zeros_like(u)], -1),
        np.stack([u, np.full_like(u, bottom)], -1),
    ]
    left_x, right_x, top_y, bottom_y = (_undistorted(lens, side, rotation) for side in sides)
    low = np.array([left_x[:, 0].max(), top_y[:, 1].max()])
    high = np.array([right_x[:, 0].min(), bottom_y[:, 1].min()])
    return low, high


def _undistorted(lens: Lens, pixels: Array, rotation: Array) -> Array:
    points = np.ascontiguousarray(pixels.reshape(-1, 1, 2))
    with np.errstate(all="ignore"):
        if lens.model == "fisheye":
            done = cv2.fisheye.undistortPoints(points, lens.K, lens.D, R=rotation)
        else:
            done = cv2.undistortPoints(points, lens.K, lens.D, R=rotation)
    return np.asarray(done, dtype=np.float64).reshape(-1, 2)


def _maps(lens: Lens, rotation: Array, P: Array, size: Size) -> tuple[NDArray[np.int16], NDArray[np.uint16]]:
    init = cv2.fisheye.initUndistortRectifyMap if lens.model == "fisheye" else cv2.initUndistortRectifyMap
    return init(lens.K, lens.D, rotation, P, size, cv2.CV_16SC2)  # type: ignore[return-value]


def completed(calibration: StereoCalibration, where: object) -> StereoCalibration:
    """The calibration of its pictures with a rectified pair in any case; for formats that state both.

    Raises SourceError where the size is needed for that and unknown.
    """
    pair, target = calibration.lenses, calibration.rectified
    if not calibration.raw_pictures and target is not None:
        plain = dataclasses.replace(target, R_left=np.eye(3), R_right=np.eye(3))
        return dataclasses.replace(calibration, lenses=None, rectified=plain)
    assert pair is not None
    if target is not None:
        return calibration
    if not needs_rectifying(pair):
        return dataclasses.replace(
            calibration, lenses=None, rectified=ideal_target(pair, pair.size), raw_pictures=False
        )
    if pair.size is None:
        raise SourceError("calibration without a picture size", where, "name the size, --size WIDTHxHEIGHT")
    R_left, R_right = rectifying_rotations(pair.R, pair.t)
    target = dataclasses.replace(default_target(pair, pair.size, where), R_left=R_left, R_right=R_right)
    return dataclasses.replace(calibration, rectified=target)


def plain(calibration: StereoCalibration) -> StereoCalibration:
    """The same with ideal, parallel lenses said as the rectified pair that they are."""
    pair = calibration.lenses
    if calibration.raw_pictures and pair is not None and not needs_rectifying(pair):
        return dataclasses.replace(
            calibration, lenses=None, rectified=ideal_target(pair, pair.size), raw_pictures=False
        )
    return calibration
