"""Writes small recordings of every layout, with pictures that say which frame and side they are."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

WIDTH, HEIGHT, FOCAL, CX, CY, BASELINE = 96, 64, 80.0, 47.5, 31.5, 0.5


def picture(frame: int, side: str, width: int = WIDTH, height: int = HEIGHT) -> np.ndarray:
    """(height, width) uint8; its first pixel is the frame number, its second 0 for left and 1 for right."""
    image = np.random.default_rng(7).integers(0, 256, (height, width)).astype(np.uint8)
    image[0, 0], image[0, 1] = frame, side == "right"
    return image


def write_picture(path: Path, image: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), image)


def calib_text(baseline: float = BASELINE) -> str:
    def row(name: str, offset: float) -> str:
        return f"{name}: {FOCAL} 0 {CX} {offset} 0 {FOCAL} {CY} 0 0 0 1 0\n"

    return "".join(row(f"P{i}", -FOCAL * baseline * (i % 2)) for i in range(4))


def poses_text(count: int) -> str:
    return "".join(f"1 0 0 0 0 1 0 0 0 0 1 {i * 1.0}\n" for i in range(count))


def odometry_drive(root: Path, frames: int = 6, poses: int | None = None, times: int | None = None) -> Path:
    """A KITTI odometry layout under `root`; returns its sequence folder."""
    sequence = root / "sequences" / "00"
    for i in range(frames):
        write_picture(sequence / "image_0" / f"{i:06d}.png", picture(i, "left"))
        write_picture(sequence / "image_1" / f"{i:06d}.png", picture(i, "right"))
    (sequence / "calib.txt").write_text(calib_text())
    (sequence / "times.txt").write_text(
        "".join(f"{i * 0.1:e}\n" for i in range(frames if times is None else times))
    )
    if poses is not None:
        (root / "poses").mkdir()
        (root / "poses" / "00.txt").write_text(poses_text(poses))
    return sequence


CAMERA_YAML = f"""\
width: {WIDTH}
height: {HEIGHT}
focal_px: {FOCAL}
cx_px: {CX}
cy_px: {CY}
baseline_m: {BASELINE}
"""


def plain_drive(root: Path, names: list[str] | None = None, camera: str = CAMERA_YAML) -> Path:
    """A plain folder; pictures are numbered in the order of `names`."""
    for i, name in enumerate(names or [f"{k:03d}" for k in range(5)]):
        write_picture(root / "left" / f"{name}.png", picture(i, "left"))
        write_picture(root / "right" / f"{name}.png", picture(i, "right"))
    (root / "camera.yaml").write_text(camera)
    return root


def _rigid(name: str, rotation: np.ndarray, translation: list[float]) -> str:
    numbers = " ".join(f"{x:.9e}" for x in rotation.ravel())
    return f"calib_time: 09-Jan-2012 13:57:47\nR: {numbers}\nT: {' '.join(map(str, translation))}\n"


def raw_drive(root: Path, frames: int = 6, oxts: int | None = None, scans: int = 0) -> Path:
    """A KITTI raw layout; the car drives east at 1 m a frame. Returns its drive folder."""
    date = root / "2011_09_26"
    drive = date / "2011_09_26_drive_0042_sync"
    for i in range(frames):
        write_picture(drive / "image_00" / "data" / f"{i:010d}.png", picture(i, "left"))
        write_picture(drive / "image_01" / "data" / f"{i:010d}.png", picture(i, "right"))
    stamp = "".join(f"2011-09-26 13:08:{24 + i // 10:02d}.{i % 10}00000123\n" for i in range(frames))
    (drive / "image_00" / "timestamps.txt").write_text(stamp)
    axes = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])  # LiDAR x forward, z up -> camera
    (date / "calib_velo_to_cam.txt").write_text(_rigid("R", axes, [0.0, -0.1, -0.3]))
    (date / "calib_imu_to_velo.txt").write_text(_rigid("R", np.eye(3), [-0.8, 0.3, -0.8]))
    unit = " ".join(map(str, np.eye(3).ravel()))
    lines = ["calib_time: 09-Jan-2012 13:57:47\n"]
    for i in range(4):
        offset = -FOCAL * BASELINE * (i % 2)
        lines.append(f"R_rect_0{i}: {unit}\nP_rect_0{i}: {FOCAL} 0 {CX} {offset} 0 {FOCAL} {CY} 0 0 0 1 0\n")
    (date / "calib_cam_to_cam.txt").write_text("".join(lines))
    if oxts is not None:
        (drive / "oxts" / "data").mkdir(parents=True)
        for i in range(oxts):
            longitude = 8.4 + np.rad2deg(i / (6378137.0 * np.cos(np.deg2rad(49.0))))
            packet = [49.0, longitude, 110.0, *([0.0] * 22), 4, 10, 4, 4, 0]
            (drive / "oxts" / "data" / f"{i:010d}.txt").write_text(" ".join(map(repr, map(float, packet))))
    for i in range(scans):
        (drive / "velodyne_points" / "data").mkdir(parents=True, exist_ok=True)
        np.full((10, 4), i, np.float32).tofile(drive / "velodyne_points" / "data" / f"{i:010d}.bin")
    return drive
