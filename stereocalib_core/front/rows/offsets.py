"""Where the right picture has the row of a left point, as the pair's own rows say."""

from __future__ import annotations

import numpy as np

from stereocalib_core.geometry import StereoCamera
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.results import RectificationSample


def rows_down(
    camera: StereoCamera, rows: RectificationSample | None, points: Array, disparity: Array
) -> Array:
    """(N,) [px] right row minus left row of left points (N, 2) with (N,) geometric disparities.

    What `self_check.fit_rows` fits. rows: None = they could not be measured, and are taken for true.
    """
    if rows is None:
        return np.zeros(len(points))
    f = camera.focal_px
    x, y = (points[:, 0] - camera.cx_px - disparity) / f, (points[:, 1] - camera.cy_px) / f
    return rows.down_px(f, x, y)
