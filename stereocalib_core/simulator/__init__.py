"""The embedded drive: a town along a loop with exact truth, faults on request, and a flat plane for tests."""

from __future__ import annotations


def warm_up() -> None:
    """Compile the renderer into numba's cache."""
    from stereocalib_core.simulator.settings import parse_spec
    from stereocalib_core.simulator.studio import Studio

    studio = Studio(parse_spec("synthetic:plane?lidar=1&width=64&height=48&cx_px=32&cy_px=20&focal_px=40"))
    studio.frame(0)
    studio.truth(0)
