"""The rows of left and right matches: the pair's check of itself, in every frame."""

from __future__ import annotations


def warm_up() -> None:
    """Compile what this package compiles."""
    import numpy as np

    from stereocalib_core.config import RectificationConfig
    from stereocalib_core.front.rows.row_matches import row_matches
    from stereocalib_core.front.rows.self_check import fit_rows
    from stereocalib_core.geometry import StereoCamera

    image = np.random.default_rng(0).integers(0, 255, (96, 160), dtype=np.uint8)
    row_matches(image, image, -8.0, 16.0)
    points = 90.0 * np.random.default_rng(0).random((20, 4))
    fit_rows(StereoCamera(160, 96, 100.0, 80.0, 48.0, 0.5), points, RectificationConfig())
