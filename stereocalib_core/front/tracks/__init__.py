"""Points of the road, and above it, followed from one stereo pair to the next."""

from __future__ import annotations


def warm_up() -> None:
    """Compile what this package compiles."""
    import numpy as np

    from stereocalib_core.front.tracks.tracks import PairView, TrackerState, advance
    from stereocalib_core.geometry import Extrinsics, StereoCamera
    from stereocalib_core.results import DisparityMap

    camera = StereoCamera(640, 320, 400.0, 320.0, 160.0, 0.5)
    rng = np.random.default_rng(0)
    left = rng.integers(0, 255, (80, 160), dtype=np.uint8).repeat(4, axis=0).repeat(4, axis=1)
    right = np.roll(left, -8, axis=1)
    dense = DisparityMap(np.full((160, 320), 8.0, dtype=np.float32), 2)
    state = TrackerState()
    for index in range(3):
        view = PairView(index, left, right, dense, Extrinsics(1.65, 0.0, 0.0))
        state, _ = advance(camera, state, view)
