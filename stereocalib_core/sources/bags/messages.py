"""What messages hold: pictures in every encoding, clouds, camera_info, poses."""

from __future__ import annotations

import re
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereocalib_core.config.reading import LEAST_WAY_OF_A_COURSE_M, MOST_PIXELS
from stereocalib_core.geometry import Array, transform
from stereocalib_core.sources.calibrations.ros import CameraInfo
from stereocalib_core.sources.pictures import UnreadablePicture, decode
from stereocalib_core.sources.truth import from_quaternions

IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
CLOUD = "sensor_msgs/msg/PointCloud2"
POSES = (
    "nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/TransformStamped", "nav_msgs/msg/Path", "sensor_msgs/msg/NavSatFix",
)  # fmt: skip
TF_STATIC = "tf2_msgs/msg/TFMessage"
EARTH_RADIUS_M = 6378137.0
"""WGS 84, as KITTI's own tools take it for their Mercator projection."""
_COLOURS = {
    "rgb8": (3, cv2.COLOR_RGB2GRAY), "bgr8": (3, cv2.COLOR_BGR2GRAY), "8UC3": (3, cv2.COLOR_BGR2GRAY),
    "rgba8": (4, cv2.COLOR_RGBA2GRAY), "bgra8": (4, cv2.COLOR_BGRA2GRAY), "8UC4": (4, cv2.COLOR_BGRA2GRAY),
    "rgb16": (3, cv2.COLOR_RGB2GRAY), "bgr16": (3, cv2.COLOR_BGR2GRAY), "16UC3": (3, cv2.COLOR_BGR2GRAY),
    "rgba16": (4, cv2.COLOR_RGBA2GRAY), "bgra16": (4, cv2.COLOR_BGRA2GRAY),
}  # fmt: skip
# ROS names the first two pixels of the first row, OpenCV the second and third of the second
_BAYER = {
    "rggb": cv2.COLOR_BayerBG2GRAY, "bggr": cv2.COLOR_BayerRG2GRAY,
    "gbrg": cv2.COLOR_BayerGR2GRAY, "grbg": cv2.COLOR_BayerGB2GRAY,
}  # fmt: skip
_YUV = {
    "yuv422": cv2.COLOR_YUV2GRAY_UYVY, "uyvy": cv2.COLOR_YUV2GRAY_UYVY,
    "yuv422_yuy2": cv2.COLOR_YUV2GRAY_YUY2, "yuyv": cv2.COLOR_YUV2GRAY_YUY2,
}  # fmt: skip
_GREY = ("mono8", "mono16", "8UC1", "16UC1")

Grey = NDArray[np.uint8] | NDArray[np.uint16]


def picture(message: Any) -> Grey:
    """(H, W) grey, uint8 or uint16, of an Image or CompressedImage; raises UnreadablePicture."""
    if hasattr(message, "format"):
        return decode(bytes(message.data))
    encoding, width, height = str(message.encoding), int(message.width), int(message.height)
    if not 0 < width * height <= MOST_PIXELS:
        raise UnreadablePicture(f"{width}x{height} pixels")
    deep = encoding.endswith(("16", "16UC1", "16UC3")) or encoding.startswith("16")
    kind = np.dtype(np.uint16 if deep else np.uint8)
    if deep and message.is_bigendian:
        kind = kind.newbyteorder(">")
    bayer = re.fullmatch(r"bayer_([rgb]{4})(8|16)", encoding)
    if encoding in _GREY or bayer:
        channels = 1
    elif encoding in _YUV:
        channels = 2
    elif encoding in _COLOURS:
        channels = _COLOURS[encoding][0]
    else:
        raise UnreadablePicture(f"encoding {encoding[:30]!r} is not known")
    step = int(message.step) or width * channels * kind.itemsize
    data = np.asarray(message.data, dtype=np.uint8)
    row = width * channels * kind.itemsize
    if step < row or len(data) < step * (height - 1) + row:
        raise UnreadablePicture(f"{len(data)} bytes for {width}x{height} pixels of {encoding}")
    padded = np.zeros(step * height, np.uint8)
    padded[: min(len(data), len(padded))] = data[: len(padded)]
    rows = np.ascontiguousarray(padded.reshape(height, step)[:, :row]).view(kind)
    image = np.ascontiguousarray(rows.reshape(height, width, channels), dtype=kind.newbyteorder("="))
    if encoding in _GREY:
        return image[:, :, 0]
    code = _BAYER[bayer.group(1)] if bayer else _YUV[encoding] if encoding in _YUV else _COLOURS[encoding][1]
    return cv2.cvtColor(image[:, :, 0] if bayer else image, code)  # type: ignore[return-value]


def camera_info(message: Any) -> CameraInfo:
    """The calibration that a CameraInfo message of either ROS carries."""
    K, D, R, P = (
        np.array(getattr(message, name, None) if hasattr(message, name) else getattr(message, name.lower()))
        for name in ("K", "D", "R", "P")
    )
    return CameraInfo(
        int(message.width),
        int(message.height),
        str(message.distortion_model) or "plumb_bob",
        *(np.asarray(values, dtype=np.float64) for values in (K, D, R, P)),
    )


_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}


def cloud(message: Any) -> NDArray[np.float32] | None:
    """(N, 4) float32 x y z [m] and intensity of a PointCloud2, finite points only; None for one without x y z."""
    order = ">" if message.is_bigendian else "<"
    fields = {f.name: (int(f.offset), _TYPES.get(int(f.datatype))) for f in message.fields}
    if not all(fields.get(axis, (0, None))[1] for axis in "xyz"):
        return None
    names = [
        name for name in ("x", "y", "z", "intensity", "i", "reflectivity") if fields.get(name, (0, None))[1]
    ]
    step, width, height = int(message.point_step), int(message.width), int(message.height)
    row_step = int(message.row_step) or step * width
    dtype = np.dtype(
        {
            "names": names,
            "formats": [order + str(fields[name][1]) for name in names],
            "offsets": [fields[name][0] for name in names],
            "itemsize": step,
        }
    )
    data = np.asarray(message.data, dtype=np.uint8)
    if step <= 0 or row_step < step * width or len(data) < row_step * (height - 1) + step * width:
        return None
    rows = [data[i * row_step : i * row_step + step * width].view(dtype) for i in range(height)]
    records = np.concatenate(rows) if rows else np.zeros(0, dtype)
    points = np.zeros((len(records), 4), np.float32)
    for column, name in enumerate(["x", "y", "z"] + names[3:4]):
        points[:, column] = records[name]
    return points[np.isfinite(points).all(axis=1)]


def rigid(pose: Any) -> Array:
    """(4, 4) of a Pose or Transform; NaN for one that is none."""
    place = getattr(pose, "position", None) or pose.translation
    turn = getattr(pose, "orientation", None) or pose.rotation
    return from_quaternions(
        np.array([[place.x, place.y, place.z]], dtype=np.float64),
        np.array([[turn.x, turn.y, turn.z, turn.w]], dtype=np.float64),
        w_first=False,
    )[0]


def navsat_poses(fixes: Array) -> Array:
    """(N, 3) latitude, longitude [deg], altitude [m] to (N, 4, 4) poses of a camera that looks where it drives.

    East, north, up from the first fix, on a sphere of WGS 84's equator; heading is that of the way driven.
    """
    latitude, longitude = np.deg2rad(fixes[:, 0]), np.deg2rad(fixes[:, 1])
    good = np.isfinite(fixes).all(axis=1)
    first = int(np.argmax(good))
    scale = EARTH_RADIUS_M * np.cos(latitude[first])
    east = scale * (longitude - longitude[first])
    north = scale * (_mercator(latitude) - _mercator(latitude[first]))
    place = np.stack([east, north, fixes[:, 2] - fixes[first, 2]], axis=-1)
    poses = np.full((len(fixes), 4, 4), np.nan)
    heading = _course(place)
    for i in np.nonzero(good & np.isfinite(heading))[0]:
        ahead = np.array([np.sin(heading[i]), np.cos(heading[i]), 0.0])
        down = np.array([0.0, 0.0, -1.0])
        poses[i] = transform(np.stack([np.cross(down, ahead), down, ahead], axis=-1), place[i])
    return poses


def _mercator(latitude: Any) -> Any:
    return np.log(np.tan(np.pi / 4 + latitude / 2))


def _course(place: Array) -> Array:
    """(N,) heading from north to east [rad] of the way around each place; the last one known while standing."""
    heading = np.full(len(place), np.nan)
    known = np.nonzero(np.isfinite(place).all(axis=1))[0]
    for spot, i in enumerate(known):
        before, after = known[max(spot - 1, 0)], known[min(spot + 1, len(known) - 1)]
        step = place[after] - place[before]
        if np.hypot(step[0], step[1]) > LEAST_WAY_OF_A_COURSE_M:
            heading[i] = np.arctan2(step[0], step[1])
        elif spot > 0:
            heading[i] = heading[known[spot - 1]]
    known_heading = np.nonzero(np.isfinite(heading))[0]
    if len(known_heading):
        heading[known[known < known_heading[0]]] = heading[known_heading[0]]
    return heading
