"""How far each path is from the truth, frame by frame, laid together at the first frame."""

from __future__ import annotations

from typing import Literal

from stereocalib_app.drive.signals.row import Known, Row, Trace
from stereocalib_app.widgets import palette


def path_errors(known: Known) -> list[Row]:
    """Position and heading error of every path that has a true one beside it."""
    compared = {n: e for n, e in known.paths.errors.items() if e.distance_m is not None}
    if not compared:
        return []
    rows = []
    for key, label, unit, field, span in (
        ("miss", "position error", "m", "miss_m", 0.5),
        ("heading_error", "heading error", "°", "heading_deg", 0.5),
    ):
        traces = []
        for name, errors in compared.items():
            values = getattr(errors, field)
            style: Literal["line", "dashed"] = "line" if name in ("autocalibrated", "live") else "dashed"
            if values is not None:
                shown = palette.VARIANT_NAME.get(name, name)
                color = palette.VARIANT.get(name, palette.COMPARED)
                traces.append(Trace(shown, known.column(values), color, style))
        rows.append(Row(key, label, unit, "Path", tuple(traces), span))
    return rows
