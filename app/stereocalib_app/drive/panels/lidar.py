"""LiDAR: how it stands against the camera, what slipped, and the scan's edges in the picture before and after."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from stereocalib_app.drive.card import plain_units
from stereocalib_app.drive.moment import Moment
from stereocalib_app.drive.panel import Host
from stereocalib_app.widgets import canvas, palette
from stereocalib_app.widgets.copy_button import copy_button
from stereocalib_app.widgets.picture import PictureView
from stereocalib_app.widgets.tables import note, numbers_table
from stereocalib_app.words.lidar import AXES, axis_words, shift_line
from stereocalib_core.back.lidar.overlay import before_and_after
from stereocalib_core.geometry import StereoCamera, ros2_static_transform
from stereocalib_core.results import LidarCheck, LidarPose, ScanSample

NONE = "This recording has no LiDAR."
WAIT = "The LiDAR is compared as soon as enough frames are computed."
BEFORE, AFTER = palette.FAILED, palette.LIVE
HEADER = ("", "differs by", "")
KEY = "Depth edges of the scan as calibrated (orange) and as found (blue), over those of the picture (white)."
PICTURE_PX = 900


def check_html(check: LidarCheck | None) -> str:
    """The table of the six, what slipped and what could not be seen."""
    if check is None:
        return note(WAIT)
    html = ""
    if check.pose is not None:
        rows = []
        for (axis, _, _), value, sigma in zip(AXES, check.pose.six, check.pose.sigma, strict=True):
            known = np.isfinite(value)
            rows.append([axis, *(axis_words(axis, value, sigma) if known else ("not measured", ""))])
        title = f"LiDAR against its calibration, frames {check.pose.first} to {check.pose.last}"
        html += numbers_table(title, HEADER, [[plain_units(cell) for cell in row] for row in rows])
    for shift in check.shifts:
        html += note("⚠ " + plain_units(shift_line(shift)))
    if check.why:
        html += note(plain_units(f"Not measured: {check.why}"))
    return html


def overlay(
    left: NDArray[np.uint8], sample: ScanSample, pose: LidarPose, camera: StereoCamera
) -> NDArray[np.uint8]:
    """(H, W) grey to (H, W, 3) RGB with the edges of the picture, and of the scan before and after."""
    picture = np.asarray(cv2.cvtColor((left // 2).astype(np.uint8), cv2.COLOR_GRAY2RGB), dtype=np.uint8)
    before, after = before_and_after(sample, pose, camera)
    for points, color, radius in (
        (sample.picture_edges, palette.GRID, 0),
        (before, BEFORE, 2),
        (after, AFTER, 2),
    ):
        for u, v in np.rint(points[:, :2]).astype(int):
            cv2.circle(picture, (int(u), int(v)), radius, color, -1)
    return picture


class LidarPanel:
    """A tab below the 3-D view."""

    def __init__(self, host: Host) -> None:
        gui = host.gui
        self._html = gui.add_html(note(NONE))
        self._copy = gui.add_html("")
        self._picture: PictureView | None = None
        self._camera = host.session.source.camera
        self._there = host.session.source.T_camera_lidar is not None
        if self._there:
            self._html.content = note(WAIT)
            self._picture = PictureView(gui, PICTURE_PX)

    def update(self, moment: Moment) -> None:
        """Show the check anew with the drive, the picture with the frame when it rests."""
        if not self._there:
            return
        check = None if moment.snapshot.drive is None else moment.snapshot.drive.lidar
        pose = None if check is None else check.pose
        if moment.drive_changed:
            self._html.content = check_html(check) + (note(KEY) if pose is not None else "")
            if pose is not None:
                command = ros2_static_transform(pose.T_camera_lidar, "camera_optical_frame", "lidar")
                self._copy.content = copy_button("Copy its ROS 2 static transform", command)
        if (moment.frame_changed or moment.drive_changed) and not moment.clock.playing:
            self._draw(moment, pose)

    def _draw(self, moment: Moment, pose: LidarPose | None) -> None:
        result = moment.result
        if pose is None or self._picture is None or result is None or result.scan is None:
            return
        left = moment.session.views.stages(moment.frame).frame.left
        if left is not None:
            self._picture.show(canvas.encode_jpeg(overlay(left, result.scan, pose, self._camera)))
