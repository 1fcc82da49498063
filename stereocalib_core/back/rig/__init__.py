"""The rig over a drive: filter, mounting yaw, the pair's own calibration, the mount and its shifts."""

from __future__ import annotations


def warm_up() -> None:
    """Compile what this package compiles."""
    import numpy as np

    from stereocalib_core.back.rig.body_filter import RigFilter
    from stereocalib_core.back.rig.road_points import Look, fit_surface
    from stereocalib_core.back.rig.vanishing_point import vanishing_points
    from stereocalib_core.geometry import StereoCamera

    points = np.random.default_rng(0).uniform(0.1, 0.4, (10, 30))
    shapes, further = np.ascontiguousarray(points[3:6].T), np.ascontiguousarray(points[6:].T)
    fit_surface(
        points[:3], np.ones(30), shapes, further, np.array([1e-3, 1e-2]), 0.5, 1e-3, 1.0, 1.0, 3, 1, 0.3
    )
    rig = RigFilter(StereoCamera(640, 320, 400.0, 320.0, 160.0, 0.5))
    for time_s in (0.0, 0.1):
        rig.step(time_s, Look(np.array([1.6, 0.0, 0.0]), np.diag([1e-4, 1e-6, 1e-6])))
    one, none = np.ones(1, dtype=np.bool_), np.zeros(1, dtype=np.int64)
    rays = np.ascontiguousarray(np.random.default_rng(0).uniform(0.1, 0.4, (5, 12)))
    vanishing_points(0, 1, rays, none, none + 12, np.eye(3)[None], one, 1e-2, 1e-3, 3, np.zeros((1, 4)))
    _warm_up_pair()


def _warm_up_pair() -> None:
    import numpy as np

    from stereocalib_core.back.rig.stereo_tracks import StereoTracks
    from stereocalib_core.back.rig.yaw_solution import solve_yaw
    from stereocalib_core.config import PairConfig
    from stereocalib_core.geometry import StereoCamera

    rays = np.random.default_rng(0).uniform(0.05, 0.3, (8, 40))
    tracks = StereoTracks(StereoCamera(640, 320, 400.0, 320.0, 160.0, 0.5), rays, np.array([0, 0, 40]))
    solve_yaw(tracks, np.zeros((2, 7)), np.array([False, True]), (0.0, 0.0), PairConfig())
