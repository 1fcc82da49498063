"""What our own scripts in the browser are told: messages of a JSON head and bytes behind it."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from stereocalib_app.drive.card import shift_words
from stereocalib_app.drive.frame_views import FrameView
from stereocalib_app.drive.moment import Moment
from stereocalib_app.drive.session import Snapshot
from stereocalib_app.drive.signals.row import Row
from stereocalib_app.drive.stage_table import STAGES
from stereocalib_app.widgets import palette
from stereocalib_core.back.spans import failed_spans
from stereocalib_core.results import Drive


def packed(head: Mapping[str, Any], *parts: bytes) -> bytes:
    """Length of the head (4 bytes, big endian), the head as JSON, and the parts behind it."""
    text = json.dumps(head, allow_nan=False, separators=(",", ":")).encode()
    return b"".join((struct.pack(">I", len(text)), text, *parts))


def now_head(moment: Moment, version: int) -> dict[str, Any]:
    """Where the page is. version: of the signals, which are asked for when it has grown."""
    result = moment.result
    times = moment.session.source.timestamps_s
    return {
        "t": "now",
        "frame": moment.frame,
        "total": moment.snapshot.total,
        "time_s": round(float(times[moment.frame]), 3) if len(times) else 0.0,
        "playing": moment.clock.playing,
        "reason": "" if result is None else result.reason,
        "computed": len(moment.snapshot.results),
        "done": moment.snapshot.done,
        "version": version,
        "layout": moment.settings.layout,
    }


def picture_head(view: FrameView) -> dict[str, Any]:
    """What the bytes of a picture and of its thumbnails are."""
    stage = STAGES[view.layout]
    return {
        "frame": view.index,
        "bytes": len(view.jpeg),
        "size": view.size,
        "axes": stage.axes,
        "extent": view.extent,
        "legend": [[name, palette.css(color)] for name, color in stage.legend],
        "sheet": len(view.sheet),
        "thumbs": [[t.name, t.x, t.y, t.width, t.height] for t in view.thumbnails],
    }


def _edge(value: float | None) -> float | None:
    return None if value is None or not np.isfinite(value) else float(value)


def shift_marks(drive: Drive | None) -> list[tuple[int, str]]:
    """Where camera or LiDAR moved, and in which words."""
    if drive is None:
        return []
    found = [(shift.frame, shift_words(shift)) for shift in drive.shifts]
    if drive.lidar is not None:
        found += [(shift.frame, f"LiDAR: {shift_words(shift)}") for shift in drive.lidar.shifts]
    return found


def signals_message(
    rows: Sequence[Row], wanted: Sequence[str], snapshot: Snapshot, times_s: Sequence[float], version: int
) -> bytes:
    """The rows that are wanted as float32, after the times [s]; the list of all rows, and what happened when."""
    parts = [np.asarray(times_s, dtype="<f4").tobytes()]
    drawn = []
    for row in rows:
        if row.key not in wanted:
            continue
        traces = []
        for trace in row.traces:
            parts.append(trace.values.astype("<f4").tobytes())
            if trace.sigma is not None:
                parts.append(trace.sigma.astype("<f4").tobytes())
            traces.append([trace.name, palette.css(trace.color), trace.style, trace.sigma is not None])
        drawn.append(
            {
                "key": row.key,
                "label": row.label,
                "unit": row.unit,
                "span": row.least_span,
                "limits": [_edge(edge) for edge in row.limits],
                "traces": traces,
            }
        )
    drive = snapshot.drive
    head = {
        "t": "signals",
        "version": version,
        "total": snapshot.total,
        "all": [[row.key, row.label, row.unit, row.group] for row in rows],
        "rows": drawn,
        "failed": [[s.first, s.last, s.reason] for s in failed_spans(snapshot.results)],
        "shifts": [[int(frame), words] for frame, words in shift_marks(drive)],
        "gaps": [] if drive is None else [[int(a), int(b)] for a, b in drive.gaps],
    }
    return packed(head, *parts)
