"""What the rows of each pair say of the pair itself."""

from __future__ import annotations

import numpy as np

from stereocalib_app.drive.signals.row import Known, Row, Trace
from stereocalib_app.widgets import palette


def pair(known: Known) -> list[Row]:
    """Row offset, relative pitch and roll of the right camera, as each pair by itself has them."""
    samples = [(r.frame, r.rectification) for r in known.snapshot.results if r.rectification is not None]
    if not samples:
        return []
    values, sigma = np.full((2, known.total, 3), np.nan)
    for frame, sample in samples:
        values[frame] = sample.values
        sigma[frame] = np.sqrt(np.diag(sample.covariance))
    for array in (values, sigma):
        array[:, 1:] = np.rad2deg(array[:, 1:])
    kinds = (
        ("row_offset", "row offset", "px", 0.4),
        ("relative_pitch", "pitch of right camera", "°", 0.05),
        ("relative_roll", "roll of right camera", "°", 0.1),
    )
    return [
        Row(key, label, unit, "Stereo pair",
            (Trace("this pair", values[:, i], palette.RAW, sigma=sigma[:, i]),), span)
        for i, (key, label, unit, span) in enumerate(kinds)
    ]  # fmt: skip
