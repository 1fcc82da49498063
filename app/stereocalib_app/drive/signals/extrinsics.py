"""Height, pitch and roll: each pair alone, filtered and smoothed with their sigma, the truth, another run."""

from __future__ import annotations

import numpy as np

from stereocalib_app.drive.session import Snapshot
from stereocalib_app.drive.signals.row import Known, Row, Trace, Values
from stereocalib_app.widgets import palette

AXES = (("height", "m", 0.12), ("pitch", "°", 0.4), ("roll", "°", 0.4))
"""Name, unit, and the least range of the axis."""


def axis_values(values: Values) -> Values:
    """(N, 3) height [m], pitch, roll [rad] in the units of the page (m, degrees)."""
    out = np.array(values, dtype=np.float64)
    out[:, 1:] = np.rad2deg(out[:, 1:])
    return out


def raw_values(snapshot: Snapshot) -> tuple[Values, Values]:
    """(N, 3) values [m, °] of each pair alone and their sigma, NaN where there is none."""
    values, sigma = np.full((2, snapshot.total, 3), np.nan)
    for result in snapshot.results:
        if result.road is not None:
            e = result.road.extrinsics
            values[result.frame] = e.height_m, e.pitch_rad, e.roll_rad
            sigma[result.frame] = result.road.sigma
    return axis_values(values), axis_values(sigma)


def saved_values(known: Known) -> Values:
    """(N, 3) filtered values [m, °] of the run that is laid beside."""
    out = np.full((known.total, 3), np.nan)
    if known.compared is not None:
        frames = known.compared.frames.frame
        inside = (frames >= 0) & (frames < known.total)
        out[frames[inside]] = axis_values(known.compared.frames.filtered[inside])
    return out


def _with_sigma(known: Known, name: str, values: Values, sigma: Values, color: palette.Rgb) -> list[Trace]:
    """One trace an axis, none where there is nothing."""
    if not np.isfinite(values).any():
        return []
    values, sigma = axis_values(values), axis_values(sigma)
    return [
        Trace(name, known.column(values[:, axis]), color, sigma=known.column(sigma[:, axis]))
        for axis in range(3)
    ]


def _tracked(known: Known) -> list[list[Trace]]:
    """Filtered (what was known at each frame) and smoothed (what the whole drive knows)."""
    drive = known.snapshot.drive
    if drive is None:
        return []
    table = drive.frames
    found = [_with_sigma(known, "filtered", table.filtered, table.filtered_sigma, palette.FILTERED)]
    found.append(_with_sigma(known, "smoothed", table.smoothed, table.smoothed_sigma, palette.SMOOTHED))
    return [traces for traces in found if traces]


def extrinsics(known: Known) -> list[Row]:
    """A row an axis."""
    raw, _ = raw_values(known.snapshot)
    tracked = _tracked(known)
    other = saved_values(known)
    truth = None if known.truth is None else known.truth.extrinsics
    true = None if truth is None else axis_values(truth[:, :3])
    rows = []
    for axis, (name, unit, span) in enumerate(AXES):
        traces = [Trace("this pair", raw[:, axis], palette.RAW, "dots")]
        traces += [series[axis] for series in tracked]
        if known.compared is not None:
            traces.append(Trace("other run", other[:, axis], palette.COMPARED, "dashed"))
        if true is not None:
            traces.append(Trace("truth", known.column(true[:, axis]), palette.TRUTH, "dashed"))
        rows.append(Row(name, name, unit, "Road", tuple(traces), span))
    return rows
