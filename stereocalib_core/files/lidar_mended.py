"""lidar_mended.yaml: where a drive found the LiDAR, for whoever goes on with it."""

from __future__ import annotations

from pathlib import Path

import yaml

from stereocalib_core.files.report import lidar_pose
from stereocalib_core.results import LidarPose
from stereocalib_core.system.whole_file import plain, write_atomic

HEAD = """# Where this drive found the LiDAR. T_camera_lidar maps its points into the left camera's optical frame
# (x right, y down, z forward); the line of that name can take the place of the one in a calibration.
# difference: how it stands otherwise than calibrated, with 1 sigma; null = not measured and left as it was.
"""


def write_lidar_mended(path: Path, pose: LidarPose) -> None:
    """T_camera_lidar, what it differs by from the calibration, and the ROS 2 command that publishes it."""
    block = lidar_pose(pose)
    values = {
        "T_camera_lidar": block["found"],
        "T_camera_lidar_calibrated": block["calibrated"],
        "difference": block["difference"],
        "frames": block["frames"],
    }
    text = yaml.safe_dump(plain(values), sort_keys=False, default_flow_style=None, width=120)
    write_atomic(path, HEAD + text + f"ros2_static_transform: {block['ros2_static_transform']}\n")
