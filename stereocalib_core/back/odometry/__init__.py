"""The motion that the tracks of a drive show, and the path of the whole drive."""

from __future__ import annotations


def warm_up() -> None:
    """Compile what this package compiles."""
    import numpy as np

    from stereocalib_core.back.odometry.packing import pack_tracks
    from stereocalib_core.back.odometry.trajectory import TrajectorySettings, trajectory
    from stereocalib_core.geometry import StereoCamera
    from stereocalib_core.results import Tracks

    camera = StereoCamera(640, 320, 400.0, 320.0, 160.0, 0.5)
    rng = np.random.default_rng(0)
    u, v = rng.uniform(100, 540, 80), rng.uniform(200, 310, 80)
    disparity = (v - 160.0) * 0.5 / 1.65
    points = np.stack([u, v, disparity, u, v + 1.0, disparity], axis=1).astype(np.float32)
    tracks = pack_tracks(camera, [None, Tracks(points, np.arange(80) < 50, 0)])
    extrinsics = np.array([[1.65, 0.0, 0.0, 0.0]] * 2)
    changed = TrajectorySettings(pitch_error_rad=0.01)
    for settings in (changed, TrajectorySettings("planar"), TrajectorySettings("nonholonomic")):
        trajectory(tracks, extrinsics, settings)
