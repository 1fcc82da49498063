"""Dense disparity by semi-global matching, with kernels of our own."""

from __future__ import annotations


def warm_up() -> None:
    """Compile what this package compiles."""
    import numpy as np

    from stereocalib_core.front.semi_global.paths import match

    image = np.zeros((16, 48), np.uint8)
    match(image, image, 0, 16, 3, 8, 600)
