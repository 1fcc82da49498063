"""One drive laid out in every format that is read, so that what comes out can be compared with what went in.

Every function writes below `root` and returns the SOURCE that names it. `docs/formats.md` has a section for each, and a
test compares its tree with what is written here.
"""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from stereocalib_core.calibration import RectifiedPair, StereoCalibration
from stereocalib_core.frames import FrameSource
from stereocalib_core.geometry import invert_transform, rotation_x, rotation_y, rotation_z, transform
from stereocalib_core.sources.calibrations import write_calibration

EPOCH_NS = 1403636579763555584
OPTICAL = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
"""R_body_camera of a body with x ahead, y left, z up."""


@dataclass(frozen=True)
class Drive:
    """left, right: PNG bytes; camera: f, cx, cy, baseline; stamps_ns from any start; poses: (N, 4, 4); scans."""

    left: list[bytes]
    right: list[bytes]
    size: tuple[int, int]
    camera: tuple[float, float, float, float]
    stamps_ns: list[int]
    poses: np.ndarray
    scans: list[np.ndarray]
    T_camera_lidar: np.ndarray

    def __len__(self) -> int:
        return len(self.left)

    def calibration(self) -> StereoCalibration:
        return StereoCalibration(None, RectifiedPair(*self.camera, None, self.size), False)

    def grey(self, index: int) -> tuple[np.ndarray, np.ndarray]:
        left, right = (
            cv2.imdecode(np.frombuffer(side[index], np.uint8), 0) for side in (self.left, self.right)
        )
        return left, right


def drive_of(source: FrameSource, count: int) -> Drive:
    """The first frames of a source, with made-up scans where it has none."""
    rng = np.random.default_rng(5)
    sides: tuple[list[bytes], list[bytes]] = ([], [])
    for index in range(count):
        frame = source[index]
        for side, image in zip(sides, (frame.left, frame.right), strict=True):
            assert image is not None
            side.append(cv2.imencode(".png", image)[1].tobytes())
    camera = source.camera
    truth = source.ground_truth
    assert truth is not None and truth.poses is not None
    return Drive(
        sides[0],
        sides[1],
        (camera.width, camera.height),
        (camera.focal_px, camera.cx_px, camera.cy_px, camera.baseline_m),
        [EPOCH_NS + round(1e9 * t) for t in source.timestamps_s[:count]],
        truth.poses[:count],
        [rng.uniform(-20, 20, (50, 4)).astype(np.float32) for _ in range(count)],
        transform(OPTICAL.T, np.array([0.01, -0.08, -0.27])),
    )


def _write(path: Path, content: bytes | str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content if isinstance(content, bytes) else content.encode())


def _pictures(
    drive: Drive, left: Path, right: Path, name: Callable[[int], str], suffix: str = ".png"
) -> None:
    for i in range(len(drive)):
        _write(left / f"{name(i)}{suffix}", drive.left[i])
        _write(right / f"{name(i)}{suffix}", drive.right[i])


def _row(values: np.ndarray) -> str:
    return " ".join(repr(float(value)) for value in np.ravel(values))


def _kitti_poses(drive: Drive) -> str:
    return "".join(f"{_row(pose[:3])}\n" for pose in drive.poses)


def quaternion(R: np.ndarray) -> np.ndarray:
    """x y z w."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(R).as_quat()


def _seconds(drive: Drive) -> list[float]:
    return [(ns - drive.stamps_ns[0]) / 1e9 for ns in drive.stamps_ns]


def _times(drive: Drive) -> str:
    return "".join(f"{t!r}\n" for t in _seconds(drive))


def _P(drive: Drive, offset_px: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    left, right = drive.calibration().rectified.projections()  # type: ignore[union-attr]
    left[0, 3] += offset_px
    right[0, 3] += offset_px
    return left, right


def _scans(drive: Drive, folder: Path, name: Callable[[int], str]) -> None:
    for i, scan in enumerate(drive.scans):
        _write(folder / f"{name(i)}.bin", scan.tobytes())


def kitti_odometry(root: Path, drive: Drive) -> str:
    folder = root / "sequences" / "06"
    _pictures(drive, folder / "image_0", folder / "image_1", "{:06d}".format)
    P_left, P_right = _P(drive)
    text = f"P0: {_row(P_left)}\nP1: {_row(P_right)}\nTr: {_row(drive.T_camera_lidar[:3])}\n"
    _write(folder / "calib.txt", text)
    _write(folder / "times.txt", _times(drive))
    _scans(drive, folder / "velodyne", "{:06d}".format)
    _write(root / "poses" / "06.txt", _kitti_poses(drive))
    return str(folder)


def kitti_odometry_colour(root: Path, drive: Drive) -> str:
    folder = root / "sequences" / "06"
    _pictures(drive, folder / "image_2", folder / "image_3", "{:06d}".format)
    P_left, P_right = _P(drive)
    _write(folder / "calib.txt", f"P_rect_02: {_row(P_left)}\nP_rect_03: {_row(P_right)}\n")
    _write(folder / "times.txt", _times(drive))
    _write(root / "poses" / "06.txt", _kitti_poses(drive))
    return str(folder)


def _raw(root: Path, drive: Drive, cameras: tuple[int, int]) -> str:
    date = root / "2011_09_26"
    folder = date / "2011_09_26_drive_0009_sync"
    left, right = (folder / f"image_{camera:02d}" for camera in cameras)
    _pictures(drive, left / "data", right / "data", "{:010d}".format)
    lines = []
    for ns in drive.stamps_ns:
        moment = np.datetime64(ns, "ns")
        lines.append(str(moment).replace("T", " "))
    for side in (left, right):
        _write(side / "timestamps.txt", "\n".join(lines) + "\n")
    P_left, P_right = _P(drive)
    text = "calib_time: 09-Jan-2012 13:57:47\n"
    for camera, P in zip(cameras, (P_left, P_right), strict=True):
        text += f"S_rect_0{camera}: {drive.size[0]} {drive.size[1]}\nR_rect_0{camera}: {_row(np.eye(3))}\n"
        text += f"P_rect_0{camera}: {_row(P)}\n"
    _write(date / "calib_cam_to_cam.txt", text)
    T = drive.T_camera_lidar
    _write(date / "calib_velo_to_cam.txt", f"R: {_row(T[:3, :3])}\nT: {_row(T[:3, 3])}\n")
    _scans(drive, folder / "velodyne_points" / "data", "{:010d}".format)
    return str(folder)


def kitti_raw(root: Path, drive: Drive) -> str:
    spec = _raw(root, drive, (0, 1))
    _write(root / "2011_09_26" / "calib_imu_to_velo.txt", f"R: {_row(np.eye(3))}\nT: -0.81 0.32 -0.8\n")
    for i in range(len(drive)):
        longitude = 8.4 + np.rad2deg(float(drive.poses[i, 2, 3]) / (6378137.0 * np.cos(np.deg2rad(49.0))))
        packet = [49.0, float(longitude), 110.0, *([0.0] * 22)]
        text = " ".join(map(repr, packet)) + " 4 10 4 4 0"
        _write(Path(spec) / "oxts" / "data" / f"{i:010d}.txt", text)
    return spec


def kitti_raw_colour(root: Path, drive: Drive) -> str:
    return _raw(root, drive, (2, 3))


def _pairs(root: Path, drive: Drive, names: tuple[str, str], calib: str, first: int, stem: str) -> str:
    folder = root / "training"
    _pictures(drive, folder / names[0], folder / names[1], stem.format)
    P_left, P_right = _P(drive)
    for i in range(len(drive)):
        text = f"P{first}: {_row(P_left)}\nP{first + 1}: {_row(P_right)}\n"
        if calib == "calib_cam_to_cam":
            text = text.replace(f"P{first}", f"P_rect_0{first}").replace(
                f"P{first + 1}", f"P_rect_0{first + 1}"
            )
        if first == 2 and calib == "calib":
            text += f"R0_rect: {_row(np.eye(3))}\nTr_velo_to_cam: {_row(drive.T_camera_lidar[:3])}\n"
        _write(folder / calib / f"{i:06d}.txt", text)
    return str(folder)


def kitti_stereo_2012(root: Path, drive: Drive) -> str:
    return _pairs(root, drive, ("image_0", "image_1"), "calib", 0, "{:06d}_10")


def kitti_stereo_2015(root: Path, drive: Drive) -> str:
    return _pairs(root, drive, ("image_2", "image_3"), "calib_cam_to_cam", 2, "{:06d}_10")


def kitti_object(root: Path, drive: Drive) -> str:
    spec = _pairs(root, drive, ("image_2", "image_3"), "calib", 2, "{:06d}")
    _scans(drive, Path(spec) / "velodyne", "{:06d}".format)
    return spec


def kitti_360(root: Path, drive: Drive) -> str:
    name = "2013_05_28_drive_0000_sync"
    folder = root / "data_2d_raw" / name
    _pictures(drive, folder / "image_00" / "data_rect", folder / "image_01" / "data_rect", "{:010d}".format)
    lines = [str(np.datetime64(ns, "ns")).replace("T", " ") for ns in drive.stamps_ns]
    _write(folder / "image_00" / "timestamps.txt", "\n".join(lines) + "\n")
    P_left, P_right = _P(drive)
    text = "calib_time: 18-Jan-2016 21:30:44\n"
    for camera, P in ((0, P_left), (1, P_right)):
        size = f"{float(drive.size[0])} {float(drive.size[1])}"
        text += (
            f"S_rect_0{camera}: {size}\nR_rect_0{camera}: {_row(np.eye(3))}\nP_rect_0{camera}: {_row(P)}\n"
        )
    _write(root / "calibration" / "perspective.txt", text)
    _write(
        root / "calibration" / "calib_cam_to_velo.txt",
        _row(invert_transform(drive.T_camera_lidar)[:3]) + "\n",
    )
    _scans(drive, root / "data_3d_raw" / name / "velodyne_points" / "data", "{:010d}".format)
    world = transform(rotation_z(0.4) @ rotation_x(0.2), np.array([900.0, 3500.0, 115.0]))
    rows = [f"{i} {_row(world @ pose)}\n" for i, pose in enumerate(drive.poses)]
    _write(root / "data_poses" / name / "cam0_to_world.txt", "".join(rows))
    return str(folder)


def euroc(root: Path, drive: Drive) -> str:
    home = root / "MH_01" / "mav0"
    name = {i: str(ns) for i, ns in enumerate(drive.stamps_ns)}
    _pictures(drive, home / "cam0" / "data", home / "cam1" / "data", name.__getitem__)
    f, cx, cy, baseline = drive.camera
    T_body_cam0 = transform(rotation_y(0.3) @ rotation_x(-0.2), np.array([0.1, -0.02, 0.06]))
    T_cam0_cam1 = transform(np.eye(3), np.array([baseline, 0.0, 0.0]))
    for cam, T in (("cam0", T_body_cam0), ("cam1", T_body_cam0 @ T_cam0_cam1)):
        text = "%YAML:1.0\nsensor_type: camera\nT_BS:\n  cols: 4\n  rows: 4\n"
        text += f"  data: {[float(v) for v in T.ravel()]!r}\nrate_hz: 10\nresolution: {list(drive.size)}\n"
        text += f"camera_model: pinhole\nintrinsics: [{f!r}, {f!r}, {cx!r}, {cy!r}]\n"
        text += "distortion_model: radial-tangential\ndistortion_coefficients: [0.0, 0.0, 0.0, 0.0]\n"
        _write(home / cam / "sensor.yaml", text)
        rows = [f"{ns},{ns}.png\r\n" for ns in drive.stamps_ns]
        _write(home / cam / "data.csv", "#timestamp [ns],filename\r\n" + "".join(rows))
    rows = [
        "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z [], v [m/s]\n"
    ]
    for ns, pose in zip(drive.stamps_ns, drive.poses, strict=True):
        T = pose @ invert_transform(T_body_cam0)
        x, y, z, w = quaternion(T[:3, :3])
        rows.append(f"{ns}," + ",".join(repr(float(v)) for v in (*T[:3, 3], w, x, y, z, 0.0)) + "\n")
    _write(home / "state_groundtruth_estimate0" / "data.csv", "".join(rows))
    return str(root / "MH_01")


def folder(root: Path, drive: Drive) -> str:
    place = root / "drive"
    _pictures(drive, place / "left", place / "right", "{:06d}".format)
    (path,) = write_calibration(drive.calibration(), "yaml", place / "camera.yaml")
    with path.open("a") as file:
        file.write(f"T_camera_lidar: {[[float(v) for v in row] for row in drive.T_camera_lidar]!r}\n")
    _write(place / "times.txt", _times(drive))
    _write(place / "poses.txt", _kitti_poses(drive))
    _scans(drive, place / "velodyne", "{:06d}".format)
    return str(place)


def folder_of_two_cameras(root: Path, drive: Drive) -> str:
    """cam0/ cam1/ with stamps as names, those of the right camera a little later; Kalibr; TUM poses."""
    place = root / "drive"
    for i, ns in enumerate(drive.stamps_ns):
        _write(place / "cam0" / f"{ns}.png", drive.left[i])
        _write(place / "cam1" / f"{ns + 2_000_000}.png", drive.right[i])
    write_calibration(drive.calibration(), "kalibr", place / "camchain-rig.yaml")
    rows = ["# timestamp tx ty tz qx qy qz qw\n"]
    for ns, pose in zip(drive.stamps_ns, drive.poses, strict=True):
        rows.append(f"{ns / 1e9:.9f} {_row(pose[:3, 3])} {_row(quaternion(pose[:3, :3]))}\n")
    _write(place / "groundtruth.txt", "".join(rows))
    return str(place)


def one_folder(root: Path, drive: Drive) -> str:
    """left01.png and right01.png side by side; OpenCV's two files."""
    place = root / "drive"
    _pictures(drive, place, place, lambda i: f"left{i:02d}")
    for i in range(len(drive)):
        _write(place / f"left{i:02d}.png", drive.left[i])
        _write(place / f"right{i:02d}.png", drive.right[i])
    f, cx, cy, baseline = drive.camera
    K = np.array([[f, 0, cx], [0, f, cy], [0, 0, 1]])
    files: dict[str, dict[str, Any]] = {
        "intrinsics.yml": {"M1": K, "D1": np.zeros((1, 5)), "M2": K, "D2": np.zeros((1, 5))},
        "extrinsics.yml": {"R": np.eye(3), "T": np.array([[-baseline], [0.0], [0.0]])},
    }
    for name, matrices in files.items():
        store = cv2.FileStorage(str(place / name), cv2.FILE_STORAGE_WRITE)
        for key, matrix in matrices.items():
            store.write(key, matrix)
        store.release()
    stamps = [f"{i},{ns // 10**9}.{ns % 10**9:09d}\n" for i, ns in enumerate(drive.stamps_ns)]
    _write(place / "timestamps.csv", "index,time\n" + "".join(stamps))
    return str(place)


def ros_folder(root: Path, drive: Drive) -> str:
    """image_left/ image_right/ with camera_info files in calib/."""
    place = root / "drive"
    _pictures(drive, place / "image_left", place / "image_right", "frame{:04d}".format)
    write_calibration(drive.calibration(), "ros", place / "calib")
    return str(place)


def archive(root: Path, drive: Drive) -> str:
    """A zip of the plain folder."""
    inside = root / "inside"
    folder(inside, drive)
    root.mkdir(parents=True, exist_ok=True)
    path = root / "drive.zip"
    with zipfile.ZipFile(path, "w") as packed:
        for file in sorted(inside.rglob("*")):
            if file.is_file():
                packed.write(file, file.relative_to(inside))
                file.unlink()
    for place in sorted(inside.rglob("*"), reverse=True):
        place.rmdir()
    inside.rmdir()
    return str(path)


# --- bags


def _store(ros2: bool) -> Any:
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE if ros2 else Stores.ROS1_NOETIC)
    if not ros2:
        kind = "tf2_msgs/msg/TFMessage"
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms\n", kind))
    return store


def _topics(
    drive: Drive,
    ros2: bool,
    rectified: bool = True,
    calibration: StereoCalibration | None = None,
    pictures: list[tuple[np.ndarray, np.ndarray]] | None = None,
) -> list[tuple[str, str, int, Any]]:
    """(topic, type, stamp, message) of everything in the drive.

    calibration: what camera_info says instead of the rectified camera. pictures: instead of the drive's own.
    """
    types = _store(ros2).types
    f, cx, cy, baseline = drive.camera
    name = "image_rect" if rectified else "image_raw"

    def header(ns: int, frame: str, seq: int = 0) -> Any:
        time = types["builtin_interfaces/msg/Time"](sec=ns // 10**9, nanosec=ns % 10**9)
        extra = {} if ros2 else {"seq": seq}
        return types["std_msgs/msg/Header"](stamp=time, frame_id=frame, **extra)

    def pose(T: np.ndarray) -> Any:
        x, y, z, w = map(float, quaternion(T[:3, :3]))
        point = types["geometry_msgs/msg/Point"](*map(float, T[:3, 3]))
        return types["geometry_msgs/msg/Pose"](
            position=point, orientation=types["geometry_msgs/msg/Quaternion"](x, y, z, w)
        )

    out: list[tuple[str, str, int, Any]] = []
    # the camera is mounted on base_link, the LiDAR too
    T_base_camera = transform(OPTICAL, np.array([1.2, 0.27, 1.6]))
    T_base_lidar = T_base_camera @ drive.T_camera_lidar
    transforms = []
    for child, T in (("camera_left", T_base_camera), ("velodyne", T_base_lidar)):
        x, y, z, w = map(float, quaternion(T[:3, :3]))
        transforms.append(
            types["geometry_msgs/msg/TransformStamped"](
                header=header(drive.stamps_ns[0], "base_link"),
                child_frame_id=child,
                transform=types["geometry_msgs/msg/Transform"](
                    translation=types["geometry_msgs/msg/Vector3"](*map(float, T[:3, 3])),
                    rotation=types["geometry_msgs/msg/Quaternion"](x, y, z, w),
                ),
            )
        )
    kind = "tf2_msgs/msg/TFMessage"
    out.append(("/tf_static", kind, drive.stamps_ns[0], types[kind](transforms=transforms)))
    infos = _infos(drive, calibration)
    for i, ns in enumerate(drive.stamps_ns):
        both = drive.grey(i) if pictures is None else pictures[i]
        for side, image, info_values in zip(("left", "right"), both, infos, strict=True):
            kind = "sensor_msgs/msg/Image"
            message = types[kind](
                header=header(ns, f"camera_{side}", i),
                height=drive.size[1],
                width=drive.size[0],
                encoding="mono8",
                is_bigendian=0,
                step=drive.size[0],
                data=image.ravel(),
            )
            out.append((f"/stereo/{side}/{name}", kind, ns, message))
            kind = "sensor_msgs/msg/CameraInfo"
            letters = "drkp" if ros2 else "DRKP"
            fields = dict(zip(letters, info_values, strict=True))
            region = types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
            info = types[kind](
                header=header(ns, f"camera_{side}", i),
                height=drive.size[1],
                width=drive.size[0],
                distortion_model="plumb_bob",
                binning_x=0,
                binning_y=0,
                roi=region,
                **fields,
            )
            out.append((f"/stereo/{side}/camera_info", kind, ns, info))
        kind = "sensor_msgs/msg/PointCloud2"
        field = types["sensor_msgs/msg/PointField"]
        fields_ = [field(n, 4 * k, 7, 1) for k, n in enumerate(("x", "y", "z", "intensity"))]
        scan = drive.scans[i]
        cloud = types[kind](
            header=header(ns, "velodyne", i),
            height=1,
            width=len(scan),
            fields=fields_,
            is_bigendian=False,
            point_step=16,
            row_step=16 * len(scan),
            data=np.frombuffer(scan.tobytes(), np.uint8),
            is_dense=True,
        )
        out.append(("/velodyne_points", kind, ns, cloud))
        kind = "nav_msgs/msg/Odometry"
        T = OPTICAL_WORLD @ drive.poses[i] @ invert_transform(T_base_camera)
        vector = types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
        odometry = types[kind](
            header=header(ns, "odom", i),
            child_frame_id="base_link",
            pose=types["geometry_msgs/msg/PoseWithCovariance"](pose=pose(T), covariance=np.zeros(36)),
            twist=types["geometry_msgs/msg/TwistWithCovariance"](
                twist=types["geometry_msgs/msg/Twist"](linear=vector, angular=vector), covariance=np.zeros(36)
            ),
        )
        out.append(("/ground_truth/odometry", kind, ns, odometry))
    return out


def _infos(drive: Drive, calibration: StereoCalibration | None) -> list[tuple[np.ndarray, ...]]:
    """D, R, K, P of the left and of the right camera_info."""
    from stereocalib_core.sources.calibrations.rectify import completed

    if calibration is None:
        return [(np.zeros(5), np.eye(3).ravel(), P[:, :3].ravel(), P.ravel()) for P in _P(drive)]
    whole = completed(calibration, "here")
    assert whole.lenses is not None and whole.rectified is not None
    sides = zip(
        (whole.lenses.left, whole.lenses.right),
        (whole.rectified.R_left, whole.rectified.R_right),
        whole.rectified.projections(),
        strict=True,
    )
    return [(np.append(lens.D, 0.0), R.ravel(), lens.K.ravel(), P.ravel()) for lens, R, P in sides]


def bag_of(
    root: Path,
    drive: Drive,
    calibration: StereoCalibration,
    pictures: list[tuple[np.ndarray, np.ndarray]] | None,
) -> str:
    """An MCAP with this camera_info: of these raw pictures, or of the drive's as rectified ones."""
    write_ros2(root / "drive", _topics(drive, True, pictures is None, calibration, pictures), mcap=True)
    return f"bag:{root / 'drive'}"


OPTICAL_WORLD = transform(OPTICAL, np.zeros(3))


def write_ros1(path: Path, topics: list[tuple[str, str, int, Any]], compression: str = "") -> None:
    from rosbags.rosbag1 import Writer

    store = _store(False)
    path.parent.mkdir(parents=True, exist_ok=True)
    writer = Writer(path)
    if compression:
        writer.set_compression(Writer.CompressionFormat[compression])
    with writer:
        connections: dict[str, Any] = {}
        for topic, kind, ns, message in topics:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(connections[topic], ns + 3_000_000, store.serialize_ros1(message, kind))


def write_ros2(path: Path, topics: list[tuple[str, str, int, Any]], mcap: bool, packed: str = "") -> None:
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    store = _store(True)
    path.parent.mkdir(parents=True, exist_ok=True)
    writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3)
    if packed:
        writer.set_compression(CompressionMode[packed], CompressionFormat.ZSTD)
    with writer:
        connections: dict[str, Any] = {}
        for topic, kind, ns, message in topics:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(connections[topic], ns + 3_000_000, store.serialize_cdr(message, kind))


def ros1_bag(root: Path, drive: Drive) -> str:
    write_ros1(root / "drive.bag", _topics(drive, False))
    return f"bag:{root / 'drive.bag'}"


def ros1_bag_packed(root: Path, drive: Drive) -> str:
    write_ros1(root / "drive.bag", _topics(drive, False), "LZ4")
    return f"bag:{root / 'drive.bag'}"


def ros2_bag(root: Path, drive: Drive) -> str:
    write_ros2(root / "drive", _topics(drive, True), mcap=False)
    return f"bag:{root / 'drive'}"


def ros2_bag_raw(root: Path, drive: Drive) -> str:
    """Topics called image_raw, ideal lenses; each message packed."""
    write_ros2(root / "drive", _topics(drive, True, rectified=False), mcap=False, packed="MESSAGE")
    return f"bag:{root / 'drive'}"


def mcap(root: Path, drive: Drive) -> str:
    write_ros2(root / "drive", _topics(drive, True), mcap=True)
    (root / "drive" / "drive.mcap").rename(root / "drive.mcap")
    (root / "drive" / "metadata.yaml").unlink()
    (root / "drive").rmdir()
    return f"bag:{root / 'drive.mcap'}"


def mcap_packed(root: Path, drive: Drive) -> str:
    write_ros2(root / "drive", _topics(drive, True), mcap=True, packed="STORAGE")
    return f"bag:{root / 'drive'}"


# --- videos, in a codec that loses nothing


def _video(path: Path, pictures: list[np.ndarray]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    height, width = pictures[0].shape
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"FFV1"), 10, (width, height))
    assert writer.isOpened()
    for picture in pictures:
        writer.write(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR))
    writer.release()


def video(root: Path, drive: Drive) -> str:
    _video(root / "drive.avi", [np.hstack(drive.grey(i)) for i in range(len(drive))])
    write_calibration(drive.calibration(), "yaml", root / "camera.yaml")
    return f"video:{root / 'drive.avi'}?camera=camera.yaml"


def video_top_bottom(root: Path, drive: Drive) -> str:
    _video(root / "drive.avi", [np.vstack(drive.grey(i)) for i in range(len(drive))])
    write_calibration(drive.calibration(), "yaml", root / "camera.yaml")
    return f"video:{root / 'drive.avi'}?camera=camera.yaml&layout=top-bottom"


def two_videos(root: Path, drive: Drive) -> str:
    for side, name in enumerate(("left", "right")):
        _video(root / f"{name}.avi", [drive.grey(i)[side] for i in range(len(drive))])
    write_calibration(drive.calibration(), "yaml", root / "camera.yaml")
    return f"video:{root / 'left.avi'},{root / 'right.avi'}?camera=camera.yaml"


@dataclass(frozen=True)
class Layout:
    """truth: `whole`, `length` (heading not reliable) or none. stamps: absolute, from the first, or none (10 Hz)."""

    write: Callable[[Path, Drive], str]
    truth: str = ""
    lidar: bool = False
    stamps: str = "none"
    pixels: str = "exact"


LAYOUTS = {
    "KITTI odometry": Layout(kitti_odometry, "whole", True, "first"),
    "KITTI odometry, colour": Layout(kitti_odometry_colour, "whole", False, "first"),
    "KITTI raw": Layout(kitti_raw, "length", True, "first"),
    "KITTI raw, colour": Layout(kitti_raw_colour, "", True, "first"),
    "KITTI stereo 2012": Layout(kitti_stereo_2012),
    "KITTI stereo 2015": Layout(kitti_stereo_2015),
    "KITTI object": Layout(kitti_object, "", True),
    "KITTI-360": Layout(kitti_360, "whole", True, "first"),
    "EuRoC / ASL": Layout(euroc, "whole", False, "absolute"),
    "Plain folder": Layout(folder, "whole", True, "first"),
    "Two folders, stamps as names": Layout(folder_of_two_cameras, "whole", False, "absolute"),
    "One folder": Layout(one_folder, "", False, "absolute"),
    "Folders with ROS calibrations": Layout(ros_folder),
    "Zip": Layout(archive, "whole", True, "first"),
    "ROS 1 bag": Layout(ros1_bag, "whole", True, "absolute"),
    "ROS 2 bag": Layout(ros2_bag, "whole", True, "absolute"),
    "MCAP": Layout(mcap, "whole", True, "absolute"),
    "Video, side by side": Layout(video),
    "Video, top and bottom": Layout(video_top_bottom),
    "Two videos": Layout(two_videos),
}
"""Title of a section of docs/formats.md to what writes it."""
MORE = {
    "ROS 1 bag, lz4": Layout(ros1_bag_packed, "whole", True, "absolute"),
    "ROS 2 bag, packed messages, image_raw": Layout(ros2_bag_raw, "whole", True, "absolute"),
    "MCAP, zstd": Layout(mcap_packed, "whole", True, "absolute"),
}


# --- a pair that is not rectified yet

LENS_D = np.array([-0.12, 0.03, 6e-4, -8e-4])
TURNED = rotation_x(np.deg2rad(0.6)) @ rotation_y(np.deg2rad(-0.8)) @ rotation_z(np.deg2rad(0.5))
"""Of the right camera from the left one."""


def unrectified(drive: Drive) -> tuple[list[np.ndarray], list[np.ndarray], StereoCalibration]:
    """The drive as a lens with k1, k2, p1, p2 and a right camera that is turned would have seen it.

    The raw picture is larger than the rectified one, as real ones are, so that rectifying it leaves no black edge.
    """
    from stereocalib_core.calibration import Lens, LensPair

    f, cx, cy, baseline = drive.camera
    width, height = drive.size
    K = np.array([[f, 0, cx], [0, f, cy], [0, 0, 1]])
    pixels = (
        np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1).reshape(-1, 1, 2).astype(np.float64)
    )
    maps = []
    for R in (np.eye(3), TURNED):
        seen = cv2.undistortPoints(pixels, K, LENS_D, R=R.T, P=K).reshape(height, width, 2).astype(np.float32)
        maps.append(seen)
    sides: tuple[list[np.ndarray], list[np.ndarray]] = ([], [])
    for i in range(len(drive)):
        for side, image, seen in zip(sides, drive.grey(i), maps, strict=True):
            side.append(cv2.remap(image, seen, None, cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REFLECT_101))
    lens = Lens(K, LENS_D)
    pair = LensPair(lens, lens, TURNED, TURNED @ np.array([-baseline, 0.0, 0.0]), drive.size)
    return sides[0], sides[1], StereoCalibration(pair, None, True)
