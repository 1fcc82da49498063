"""A synthetic drive as files: KITTI odometry layout, with the truth beside it."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from stereocalib_core.errors import OutputError
from stereocalib_core.simulator.settings import from_options
from stereocalib_core.sources.formats.synthetic import SyntheticSource

Progress = Callable[..., object]
DISPARITY_SCALE = 256.0


def synth(
    out: Path, name: str, options: dict[str, str], faults: list[str], progress: Progress | None = None
) -> None:
    """Write the drive NAME with these options and faults under `out`; ConfigError, OutputError."""
    write_drive(SyntheticSource(from_options(name, options, faults)), out, progress)


def write_drive(source: SyntheticSource, out: Path, progress: Progress | None = None) -> None:
    """Write `out`/sequences/00 and `out`/poses/00.txt.

    `progress(done, total, what)` is called after every frame. Reading the folder gives the very same pictures,
    times and camera as the source itself.
    """
    sequence = out / "sequences" / "00"
    try:
        for folder in (
            "image_0",
            "image_1",
            "disparity_gt",
            *(["velodyne"] if source.settings.lidar else []),
        ):
            (sequence / folder).mkdir(parents=True, exist_ok=True)
        (out / "poses").mkdir(parents=True, exist_ok=True)
        (sequence / "calib.txt").write_text(calib_text(source), encoding="ascii")
        (sequence / "times.txt").write_text(lines(source.timestamps_s[:, None]), encoding="ascii")
        poses = source.studio.poses()[:, :3].reshape(-1, 12)
        (out / "poses" / "00.txt").write_text(lines(poses), encoding="ascii")
        extrinsics = extrinsics_text(source.studio.drive.extrinsics)
        (sequence / "extrinsics_gt.csv").write_text(extrinsics, encoding="ascii")
        for i in range(len(source)):
            _write_frame(source, i, sequence)
            if progress is not None:
                progress(i + 1, len(source), "writing")
    except OSError as error:
        raise OutputError(
            "drive cannot be written", error.filename or out, error.strerror or "check the disk"
        ) from error


def _write_frame(source: SyntheticSource, i: int, sequence: Path) -> None:
    frame = source[i]
    if frame.left is not None and frame.right is not None:
        _write_png(sequence / "image_0" / f"{i:06d}.png", frame.left)
        _write_png(sequence / "image_1" / f"{i:06d}.png", frame.right)
    scaled = np.rint(np.nan_to_num(source.truth(i).disparity) * DISPARITY_SCALE)
    _write_png(sequence / "disparity_gt" / f"{i:06d}.png", np.clip(scaled, 0, 65535).astype(np.uint16))
    if frame.lidar is not None:
        (sequence / "velodyne" / f"{i:06d}.bin").write_bytes(np.ascontiguousarray(frame.lidar).tobytes())


def _write_png(path: Path, image: NDArray[np.uint8] | NDArray[np.uint16]) -> None:
    _, data = cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    path.write_bytes(data.tobytes())


def calib_text(source: SyntheticSource) -> str:
    """P0 and P1 (and P2, P3 the same), and Tr with a LiDAR; reading it gives the same floats."""
    c = source.camera
    cx_right = c.cx_px if c.cx_right_px is None else c.cx_right_px
    left = [c.focal_px, 0.0, c.cx_px, 0.0, 0.0, c.focal_px, c.cy_px, 0.0, 0.0, 0.0, 1.0, 0.0]
    right = left.copy()
    right[2] = cx_right
    right[3] = -_product(c.focal_px, c.baseline_m)
    rows = [("P0", left), ("P1", right), ("P2", left), ("P3", right)]
    if source.T_camera_lidar is not None:
        rows.append(("Tr", source.T_camera_lidar[:3].ravel().tolist()))
    return "".join(f"{name}: {' '.join(repr(float(v)) for v in values)}\n" for name, values in rows)


def _product(focal_px: float, baseline_m: float) -> float:
    """focal * baseline, such that dividing by focal gives the baseline back to the last bit."""
    value = focal_px * baseline_m
    for candidate in (value, math.nextafter(value, math.inf), math.nextafter(value, 0.0)):
        if candidate / focal_px == baseline_m:
            return candidate
    return value


def lines(rows: NDArray[np.float64]) -> str:
    """Numbers (N, M) as text that reads back to the same floats."""
    return "".join(" ".join(repr(float(v)) for v in row) + "\n" for row in rows)


def extrinsics_text(extrinsics: NDArray[np.float64]) -> str:
    """extrinsics_gt.csv from (N, 4) height [m], pitch, roll, yaw [rad]."""
    text = ["frame,height_m,pitch_deg,roll_deg,yaw_deg\n"]
    for i, (height, *angles) in enumerate(extrinsics):
        text.append(f"{i},{float(height)!r}," + ",".join(repr(float(np.rad2deg(a))) for a in angles) + "\n")
    return "".join(text)
