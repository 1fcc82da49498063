"""The LiDAR's road minus the stereo road, where frames carry scans."""

from __future__ import annotations

import numpy as np

from stereocalib_app.drive.signals.extrinsics import axis_values
from stereocalib_app.drive.signals.row import Known, Row, Trace
from stereocalib_app.widgets import palette


def lidar(known: Known) -> list[Row]:
    """Residual in height, pitch and roll of every frame with a scan."""
    found = [(r.frame, r.lidar) for r in known.snapshot.results if r.lidar is not None]
    if not found:
        return []
    values, sigma = np.full((2, known.total, 3), np.nan)
    for frame, residual in found:
        values[frame] = residual.values
        sigma[frame] = np.sqrt(np.diag(residual.covariance))
    values, sigma = axis_values(values), axis_values(sigma)
    return [
        Row(f"lidar_{name}", f"LiDAR − stereo, {name}", unit, "LiDAR",
            (Trace("this frame", values[:, i], palette.LIVE, sigma=sigma[:, i]),), span)
        for i, (name, unit, span) in enumerate((("height", "m", 0.08), ("pitch", "°", 0.4), ("roll", "°", 0.6)))
    ]  # fmt: skip
