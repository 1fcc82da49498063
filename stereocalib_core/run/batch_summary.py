"""The summary of a batch: one row per drive as CSV and Markdown, and one figure sheet."""

from __future__ import annotations

import csv
import io as text_io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from stereocalib_core.files.io import MOUNT_KEYS
from stereocalib_core.results import BEST, Drive
from stereocalib_core.system.whole_file import write_atomic

AXES = (
    ("height_m", "height [m]"),
    ("pitch_deg", "pitch [deg]"),
    ("roll_deg", "roll [deg]"),
    ("yaw_deg", "yaw [deg]"),
)
COLUMNS = (
    *("drive", "status", "frames", "frames_ok"),
    *(name for axis, _ in AXES for name in (axis, axis.replace("_", "_sigma_"))),
    *("rectification", "shifts", "path_m", "final_translation_percent", "trustworthy", "reason", "source"),
)


@dataclass(frozen=True)
class DriveOutcome:
    """One drive of a batch. status: done or failed; `drive` is there when done, `reason` when failed."""

    name: str
    source: str
    status: str
    reason: str = ""
    drive: Drive | None = None


def write_summary(out: Path, outcomes: Sequence[DriveOutcome]) -> None:
    """summary.csv, summary.md and summary.png in `out`."""
    rows = [row_of(outcome) for outcome in outcomes]
    table = text_io.StringIO()
    writer = csv.writer(table, lineterminator="\n")
    writer.writerow(COLUMNS)
    writer.writerows([[_cell(row[name]) for name in COLUMNS] for row in rows])
    write_atomic(out / "summary.csv", table.getvalue())
    write_atomic(out / "summary.md", _markdown(rows))
    write_atomic(out / "summary.png", _figure(rows))


def row_of(outcome: DriveOutcome) -> dict[str, Any]:
    """The values of one row by column, None = no value."""
    row: dict[str, Any] = dict.fromkeys(COLUMNS)
    row |= {"drive": outcome.name, "source": outcome.source, "status": outcome.status}
    row["reason"] = outcome.reason or None
    drive = outcome.drive
    if drive is None:
        return row
    for axis, _ in AXES:
        field, unit = MOUNT_KEYS[axis]
        found = getattr(drive.mount, field)
        if found is not None:
            row[axis], row[axis.replace("_", "_sigma_")] = found.value / unit, found.sigma / unit
    row |= {"frames": len(drive.frames), "frames_ok": drive.frames_ok}
    row |= {"trustworthy": drive.why_not is None, "reason": drive.why_not}
    row |= {"rectification": drive.pair.verdict, "shifts": len(drive.shifts)}
    if BEST in drive.paths:
        errors = drive.paths[BEST].errors
        row |= {"path_m": errors.path_m, "final_translation_percent": errors.final_translation_percent}
    return row


def _cell(value: Any) -> str:
    if value is None:
        return ""
    return f"{value:.6f}" if isinstance(value, float) else str(value)


def _markdown(rows: Sequence[dict[str, Any]]) -> str:
    done = [row for row in rows if row["status"] == "done"]
    lines = [f"# {len(done)} of {len(rows)} drives", "", "![](summary.png)", ""]
    lines.append(
        "| drive | ok frames | height m | pitch deg | roll deg | yaw deg | pair | shifts | path m | final error % |"
    )
    lines.append("|---|---|---|---|---|---|---|---|---|---|")
    for row in done:
        mount = [_with_sigma(row[axis], row[axis.replace("_", "_sigma_")]) for axis, _ in AXES]
        rest = [row["rectification"] or "", str(row["shifts"]), _short(row["path_m"], 1)]
        cells = [row["drive"], f"{row['frames_ok']} of {row['frames']}", *mount, *rest]
        lines.append(
            "| " + " | ".join([*map(_escaped, cells), _short(row["final_translation_percent"], 2)]) + " |"
        )
    for title, chosen in (
        ("Failed", [row for row in rows if row["status"] != "done"]),
        ("Not to be trusted", [row for row in done if row["reason"]]),
    ):
        if chosen:
            lines += ["", f"## {title}", ""]
            lines += [f"- **{_escaped(row['drive'])}**: {_escaped(row['reason'])}" for row in chosen]
    return "\n".join(lines) + "\n"


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace("|", "\\|")


def _short(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"


def _with_sigma(value: float | None, sigma: float | None) -> str:
    return "" if value is None else f"{value:.3f}" + ("" if sigma is None else f" ± {sigma:.3f}")


def ready_to_draw() -> None:
    """Import what the figure needs, which takes as long as drawing it."""
    import matplotlib.backends.backend_agg
    import matplotlib.figure  # noqa: F401


def _figure(rows: Sequence[dict[str, Any]]) -> bytes:
    """Height, pitch, roll and yaw of every drive with two sigma, and the share of frames that are ok."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 1.6 + 0.24 * len(rows)), layout="constrained")
    panels = figure.subplots(1, len(AXES) + 1, sharey=True)
    places = np.arange(len(rows))
    for panel, (axis, label) in zip(panels, AXES, strict=False):
        known = [i for i, row in enumerate(rows) if row[axis] is not None]
        values = np.array([rows[i][axis] for i in known], dtype=float)
        sigmas = np.array([rows[i][axis.replace("_", "_sigma_")] or 0.0 for i in known], dtype=float)
        panel.errorbar(values, known, xerr=2 * sigmas, fmt="o", ms=4, capsize=2, color="#2b6cb0")
        if len(values):
            panel.axvline(float(np.median(values)), color="#a0aec0", lw=0.8)
        panel.set_title(label, fontsize=9)
    shares = [(row["frames_ok"] or 0) / row["frames"] if row["frames"] else 0.0 for row in rows]
    colours = ["#38a169" if row["trustworthy"] else "#e53e3e" for row in rows]
    panels[-1].barh(places, shares, color=colours, height=0.6)
    panels[-1].set_title("share of ok frames", fontsize=9)
    panels[-1].set_xlim(0, 1)
    panels[0].set_yticks(places, [row["drive"][-32:] for row in rows])
    panels[0].set_ylim(len(rows) - 0.5, -0.5)
    for panel in panels:
        panel.tick_params(labelsize=7)
        panel.grid(True, axis="y", lw=0.3)
    buffer = text_io.BytesIO()
    FigureCanvasAgg(figure).print_png(buffer, metadata={"Software": None})
    return buffer.getvalue()
