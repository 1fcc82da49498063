"""The embedded drive: a town along a loop with exact truth, faults on request, and a flat plane for tests."""

from __future__ import annotations


def warm_up() -> None:
    """Compile the renderers into numba's cache."""
    from stereocalib_core.geometry import Extrinsics, StereoCamera
    from stereocalib_core.synthetic.plane import render_plane

    camera = StereoCamera(64, 48, 60.0, 32.0, 20.0, 0.5)
    render_plane(camera, Extrinsics.from_degrees(1.65, 0.8, -0.4), clutter=True)
