"""Camera to 3-D LiDAR by chessboard planes (Zheng et al. 2018, and beyond it).

`detect` looks at every picture and cloud once; `calibrate` solves for any choice of the pairs in
milliseconds; `run` does both from a folder and writes the report.
"""

import numpy as np

from stereocalib_core.lidar_camera.calibrate import calibrate, ticked_mask
from stereocalib_core.lidar_camera.calibration import Calibration, HeldOut, PairResult
from stereocalib_core.lidar_camera.camera import BoardCamera
from stereocalib_core.lidar_camera.detect import Detection, detect
from stereocalib_core.lidar_camera.folder import BoardFolder, open_folder
from stereocalib_core.lidar_camera.lidar_road import warm_up as _warm_up_road
from stereocalib_core.lidar_camera.observability import Observability
from stereocalib_core.lidar_camera.observation import BoardSpec, PairObservation, PlaneEstimate
from stereocalib_core.lidar_camera.outline import overlaps
from stereocalib_core.lidar_camera.pcd import lzf_decompress
from stereocalib_core.lidar_camera.refine import Iteration, Noise
from stereocalib_core.lidar_camera.run import run

__all__ = [
    "BoardCamera", "BoardFolder", "BoardSpec", "Calibration", "Detection", "HeldOut", "Iteration", "Noise",
    "Observability", "PairObservation", "PairResult", "PlaneEstimate", "calibrate", "detect", "open_folder",
    "run", "ticked_mask", "warm_up",
]  # fmt: skip


def warm_up() -> None:
    """Compile what is compiled: the outline search, the unpacker of compressed PCD files, the lane of a scan."""
    lzf_decompress(np.array([0, 7], dtype=np.uint8), 1)
    overlaps(np.zeros((1, 2)), np.ones(1, dtype=bool), np.ones(2), 0.0, np.zeros(1), np.zeros((1, 2)))
    _warm_up_road()
