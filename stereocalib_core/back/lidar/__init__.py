"""Do camera and LiDAR still agree, and where does the LiDAR stand: over a whole drive."""

from __future__ import annotations


def warm_up() -> None:
    """Compile what this package compiles."""
    import numpy as np

    from stereocalib_core.back.lidar.alignment import Belief, Scan, align
    from stereocalib_core.config import LidarAlignmentConfig
    from stereocalib_core.geometry import StereoCamera

    config = LidarAlignmentConfig()
    T = np.eye(4)
    T[:3, :3] = [[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]
    beams, edges = np.array([[10.0, 0.0, 0.0, 1.0]]), np.array([[320.0, 160.0, 20.0, 1.0, 30.0]])
    points, patches = np.array([[10.0, 0.0, 0.0]]), np.array([[320.0, 160.0, 20.0, 0.0, 0.0]])
    scan = Scan(0, beams, edges, points, patches, T, np.eye(4), np.zeros(6), 0.1, 0.0, None)
    camera = StereoCamera(640, 320, 400.0, 320.0, 160.0, 0.5)
    align([scan], camera, config, Belief.of(config), np.zeros(10))
