"""A run for the Rerun viewer: written to a file, or shown while it happens.

Entities, in the axes of the first left camera (x right, y down, z forward):

- `world/camera`: pose of the left camera; `world/camera/image`: its picture with the horizon;
  `world/camera/road`: a grid on the measured road plane.
- `world/path/VARIANT`, `world/path/truth`: the paths.
- `disparity`: coloured, nearer is brighter.
- `extrinsics/AXIS/{raw,filtered,low,high}`: in metres and degrees, low and high at one filtered sigma.
- `events`: failed frames with their reasons, gaps, shifts of the mount and of the LiDAR against the camera.

Time lines: `frame` (zero-based) and `time` (seconds of the recording). Rerun is only imported when asked for.
"""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereocalib_core.config.running import (
    DISPARITY_QUALITY,
    FLUSH_TIMEOUT_S,
    PICTURE_QUALITY,
    VIEWER_SETTLE_S,
    VIEWER_TIMEOUT_S,
)
from stereocalib_core.errors import OutputError
from stereocalib_core.frames import StereoFrame
from stereocalib_core.geometry import Extrinsics, StereoCamera, horizon
from stereocalib_core.results import ANGLES, TO_DEGREES, DisparityMap, Drive, FrameResult, LidarShift, Shift

APPLICATION = "stereocalib"
AXES = ("height_m", "pitch_deg", "roll_deg")
RAW, FILTERED, BAND = (120, 160, 220), (255, 190, 60), (140, 110, 60)
PATH_COLOURS = {"autocalibrated": (255, 190, 60), "no_yaw": (90, 200, 120), "no_roll": (200, 100, 220)}
FAILED, EVENT = "WARN", "INFO"
VIEWER_PORT = 9876
VIEWER_URL = f"rerun+http://127.0.0.1:{VIEWER_PORT}/proxy"


class Recorder:
    """Sends frames and the analysed drive to one Rerun recording: a file, or a viewer when `path` is None."""

    def __init__(self, camera: StereoCamera, name: str, path: Path | None) -> None:
        # What fails is raised here in one line; Rerun would write its own log to stderr besides.
        os.environ.setdefault("RUST_LOG", "off")
        import rerun as rr

        self._rr = rr
        self._camera = camera
        self._path = path
        self._temporary = None if path is None else path.with_name(f".{path.name}.{os.getpid()}.tmp")
        self._stream = rr.RecordingStream(APPLICATION)
        try:
            if self._temporary is None:
                self._stream.connect_grpc(find_viewer(), default_blueprint=blueprint())
            else:
                self._stream.save(self._temporary, default_blueprint=blueprint())
        except (RuntimeError, OSError) as error:
            raise OutputError("recording cannot be started", path or VIEWER_URL, str(error)[:200]) from error
        self._stream.send_recording_name(name)
        self._begin()

    def close(self, keep: bool) -> None:
        """Deliver what is still on its way; a file gets its name now, or is removed when `keep` is False."""
        lost: RuntimeError | None = None
        try:
            self._stream.flush(timeout_sec=FLUSH_TIMEOUT_S)
        except RuntimeError as error:
            lost = error
        self._stream.disconnect()
        if self._path is None or self._temporary is None:
            return  # a viewer that was closed meanwhile is no reason to lose the run
        if keep and lost is None:
            os.replace(self._temporary, self._path)
            return
        self._temporary.unlink(missing_ok=True)
        if lost is not None:
            raise OutputError("recording cannot be written", self._path, str(lost)[:200]) from lost

    def _begin(self) -> None:
        rr, camera = self._rr, self._camera
        self._stream.log("world", rr.ViewCoordinates.RDF, static=True)
        pinhole = rr.Pinhole(
            image_from_camera=camera.K,
            resolution=[camera.width, camera.height],
            camera_xyz=rr.ViewCoordinates.RDF,
            image_plane_distance=2.0,
        )
        self._stream.log("world/camera/image", pinhole, static=True)
        for axis in AXES:
            for part, colour in (("filtered", FILTERED), ("low", BAND), ("high", BAND)):
                lines = rr.SeriesLines(
                    colors=[colour], names=[part], widths=[2.0 if part == "filtered" else 1.0]
                )
                self._stream.log(f"extrinsics/{axis}/{part}", lines, static=True)
            dots = rr.SeriesPoints(colors=[RAW], names=["raw"], marker_sizes=[2.0])
            self._stream.log(f"extrinsics/{axis}/raw", dots, static=True)

    def frame(self, frame: StereoFrame, result: FrameResult, disparity: DisparityMap | None) -> None:
        """One frame: pictures, road, this pair's own numbers, and its failure if it has one.

        disparity: as it was matched for the result; None = it was not.
        """
        rr, stream = self._rr, self._stream
        stream.set_time("frame", sequence=result.frame)
        stream.set_time("time", duration=result.timestamp_s)
        if frame.left is not None:
            picture = rr.EncodedImage(contents=jpeg(frame.left, PICTURE_QUALITY), media_type="image/jpeg")
            stream.log("world/camera/image", picture)
        if disparity is not None:
            coloured = jpeg(colour_disparity(disparity), DISPARITY_QUALITY)
            stream.log("disparity", rr.EncodedImage(contents=coloured, media_type="image/jpeg"))
        if result.road is None:
            stream.log("world/camera/road", rr.Clear(recursive=False))
            stream.log("world/camera/image/horizon", rr.Clear(recursive=False))
            why = "" if result.failure is None else result.failure.detail
            stream.log("events", rr.TextLog(f"frame {result.frame}: {result.reason}, {why}", level=FAILED))
            return
        pose = result.road.extrinsics
        stream.log("world/camera/road", rr.LineStrips3D(road_grid(pose), colors=[(80, 200, 120)]))
        line = rr.LineStrips2D([horizon_line(self._camera, pose)], colors=[(255, 190, 60)])
        stream.log("world/camera/image/horizon", line)
        for axis, value in zip(AXES, (pose.height_m, pose.pitch_deg, pose.roll_deg), strict=True):
            stream.log(f"extrinsics/{axis}/raw", rr.Scalars(value))

    def drive(self, drive: Drive, truth: NDArray[np.float64] | None) -> None:
        """The whole drive: filtered extrinsics with sigma, camera poses, paths, gaps and shifts."""
        self._filtered(drive)
        if drive.poses is not None:
            self._poses(drive, drive.poses)
        paths = {name: path.poses for name, path in drive.paths.items()}
        if truth is not None:
            paths["truth"] = truth
        for name, poses in paths.items():
            points = poses[np.isfinite(poses).all(axis=(1, 2)), :3, 3]
            colour = PATH_COLOURS.get(name, (150, 150, 150))
            strip = self._rr.LineStrips3D([points], colors=[colour], labels=[name], show_labels=False)
            self._stream.log(f"world/path/{name}", strip, static=True)
        for first, last in drive.gaps:
            self._event(drive, first, f"no road measured in frames {first} to {last}")
        for shift in drive.shifts:
            self._event(drive, shift.frame, shift_text(shift))
        for found in () if drive.lidar is None else drive.lidar.shifts:
            self._event(drive, found.frame, f"LiDAR: {shift_text(found)}")

    def _columns(self, drive: Drive, rows: NDArray[np.int64]) -> list[Any]:
        frames, times = drive.frames.frame[rows], drive.frames.elapsed_s[rows]
        return [self._rr.TimeColumn("frame", sequence=frames), self._rr.TimeColumn("time", duration=times)]

    def _filtered(self, drive: Drive) -> None:
        rows = np.flatnonzero([state != "none" for state in drive.frames.filter_state])
        if len(rows) == 0:
            return
        values = drive.frames.filtered[rows] * TO_DEGREES
        sigma = drive.frames.filtered_sigma[rows] * TO_DEGREES
        for i, axis in enumerate(AXES):
            parts = {
                "filtered": values[:, i],
                "low": values[:, i] - sigma[:, i],
                "high": values[:, i] + sigma[:, i],
            }
            for part, column in parts.items():
                self._stream.send_columns(
                    f"extrinsics/{axis}/{part}",
                    self._columns(drive, rows),
                    self._rr.Scalars.columns(scalars=column),
                )

    def _poses(self, drive: Drive, poses: NDArray[np.float64]) -> None:
        rows = np.flatnonzero(np.isfinite(poses).all(axis=(1, 2)))
        columns = self._rr.Transform3D.columns(translation=poses[rows, :3, 3], mat3x3=poses[rows, :3, :3])
        self._stream.send_columns("world/camera", self._columns(drive, rows), columns)

    def _event(self, drive: Drive, frame: int, text: str) -> None:
        row = min(max(frame - int(drive.frames.frame[0]), 0), len(drive.frames) - 1)
        self._stream.set_time("frame", sequence=int(drive.frames.frame[row]))
        self._stream.set_time("time", duration=float(drive.frames.elapsed_s[row]))
        self._stream.log("events", self._rr.TextLog(text, level=EVENT))


def shift_text(shift: Shift | LidarShift) -> str:
    """A shift in one line, in metres or degrees."""
    size, unit = (np.rad2deg(shift.size), "deg") if shift.axis in ANGLES else (shift.size, "m")
    return f"{shift.kind} of {shift.axis} by {size:+.3f} {unit}"


def find_viewer() -> str:
    """The address of the viewer that listens on this machine, or of one started for it.

    Rerun's own way of starting one would listen to the whole network.
    """
    if _listening():
        return VIEWER_URL
    command = [sys.executable, "-m", "rerun", "--bind", "127.0.0.1", "--port", str(VIEWER_PORT)]
    quiet = subprocess.DEVNULL
    viewer = subprocess.Popen(command, stdin=quiet, stdout=quiet, stderr=quiet, start_new_session=True)
    deadline = time.monotonic() + VIEWER_TIMEOUT_S
    while not _listening() and viewer.poll() is None and time.monotonic() < deadline:
        time.sleep(0.1)
    with contextlib.suppress(subprocess.TimeoutExpired):
        viewer.wait(VIEWER_SETTLE_S)  # without a display it listens first and ends then
    if viewer.poll() is not None:
        raise OutputError(
            "Rerun viewer cannot be started", "--rerun", "it needs a display; use --rrd instead"
        )
    return VIEWER_URL


def _listening() -> bool:
    with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", VIEWER_PORT), timeout=0.5):
        return True
    return False


def blueprint() -> Any:
    """How the viewer opens: pictures left, path in the middle, extrinsics right, events below."""
    import rerun.blueprint as rrb

    pictures = rrb.Vertical(
        rrb.Spatial2DView(origin="world/camera/image", name="Left picture, horizon"),
        rrb.Spatial2DView(origin="disparity", name="Disparity"),
        rrb.TextLogView(origin="events", name="Events"),
    )
    plots = rrb.Vertical(*(rrb.TimeSeriesView(origin=f"extrinsics/{axis}", name=axis) for axis in AXES))
    scene = rrb.Spatial3DView(origin="world", name="Path and road")
    layout = rrb.Horizontal(pictures, scene, plots, column_shares=[3, 4, 3])
    return rrb.Blueprint(layout, rrb.TimePanel(timeline="frame", state="collapsed"), collapse_panels=True)


def jpeg(picture: NDArray[np.uint8], quality: int) -> bytes:
    """(H, W) grey or (H, W, 3) blue-green-red uint8 to JPEG."""
    ok, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])
    if not ok:
        raise OutputError("picture cannot be encoded", f"{picture.shape}", "report this")
    return data.tobytes()


def colour_disparity(disparity: DisparityMap, largest_px: float = 96.0) -> NDArray[np.uint8]:
    """(h, w, 3) blue-green-red: the square root of disparity on a perceptual scale, black where there is none."""
    values = np.nan_to_num(disparity.values, nan=0.0)
    level = np.sqrt(np.clip(values / largest_px, 0.0, 1.0)) * 255
    coloured = np.asarray(cv2.applyColorMap(level.astype(np.uint8), cv2.COLORMAP_INFERNO), dtype=np.uint8)
    coloured[~(values > 0)] = 0
    return coloured


def road_grid(pose: Extrinsics) -> list[NDArray[np.float64]]:
    """Lines on the road, 8 m wide and 4 to 30 m ahead, as points in the camera frame [m]."""
    along = [np.array([[x, 0.0, 4.0], [x, 0.0, 30.0]]) for x in np.arange(-4.0, 4.1, 2.0)]
    across = [np.array([[-4.0, 0.0, z], [4.0, 0.0, z]]) for z in np.arange(4.0, 30.1, 2.0)]
    T = pose.T_camera_road
    return [line @ T[:3, :3].T + T[:3, 3] for line in (*along, *across)]


def horizon_line(camera: StereoCamera, pose: Extrinsics) -> NDArray[np.float64]:
    """(2, 2) where the horizon crosses the left and right edge of the picture [px]."""
    slope, row = horizon(camera, pose)
    u = np.array([0.0, camera.width - 1.0])
    return np.column_stack([u, row + slope * (u - camera.cx_px)])
