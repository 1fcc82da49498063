"""The rig: smoothing, mounting yaw, the pair's self-check, the mount and its shifts."""

from __future__ import annotations


def warm_up() -> None:
    """Compile what this package compiles."""
    import numpy as np

    from stereocalib_core.geometry import StereoCamera
    from stereocalib_core.rig.body_filter import RigFilter
    from stereocalib_core.rig.rectification import fit_rows
    from stereocalib_core.rig.road_points import fit_plane
    from stereocalib_core.rig.row_matches import row_matches
    from stereocalib_core.rig.vanishing_point import vanishing_points

    image = np.random.default_rng(0).integers(0, 255, (96, 160), dtype=np.uint8)
    row_matches(image, image, -8.0, 16.0)
    fit_rows(StereoCamera(160, 96, 100.0, 80.0, 48.0, 0.5), 90.0 * np.random.default_rng(0).random((20, 4)))
    fit_plane(np.random.default_rng(0).uniform(0.1, 0.4, (3, 30)), np.ones(30))
    rig = RigFilter()
    for time_s in (0.0, 0.1):
        rig.step(time_s, np.array([1.6, 0.0, 0.0]), np.diag([1e-4, 1e-6, 1e-6]))
    one, none = np.ones(1, dtype=np.bool_), np.zeros(1, dtype=np.int64)
    rays = np.ascontiguousarray(np.random.default_rng(0).uniform(0.1, 0.4, (5, 12)))
    vanishing_points(rays, none, none + 12, np.eye(3)[None], one, 1e-2, 1e-3)
