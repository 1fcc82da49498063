"""Every number that a stage checks against a limit: brightness, matches, coverage, agreement, sigma."""

from __future__ import annotations

import numpy as np

from stereocalib_app.drive.signals.row import Known, Row, Trace, Values
from stereocalib_app.widgets import palette


def checks(known: Known) -> list[Row]:
    """A row a number, in the order of the stages; the limits are those of the last frame that had them."""
    found: dict[tuple[str, str], Values] = {}
    last = {}
    for result in known.snapshot.results:
        for check in result.checks:
            key = check.stage, check.name
            if key not in found:
                found[key] = np.full(known.total, np.nan)
            found[key][result.frame] = check.value
            last[key] = check
    rows = []
    for (stage, name), values in found.items():
        check = last[stage, name]
        low, high = (None if edge is None else float(edge) for edge in (check.low, check.high))
        unit = {"deg": "°"}.get(check.unit, check.unit)
        trace = Trace("this frame", values, palette.FREE)
        rows.append(Row(f"{stage}/{name}", name, unit, f"Stage: {stage}", (trace,), 0.0, (low, high)))
    return rows
