"""The drive on one sheet: mount, extrinsics over time, path, failures; as PNG."""

from __future__ import annotations

import io as bytes_io
import textwrap

import numpy as np

from stereocalib_app.drive.panels.corrections import describe
from stereocalib_app.drive.session import Session, Snapshot
from stereocalib_app.drive.settings import Settings
from stereocalib_app.drive.signals.extrinsics import AXES, axis_values, raw_values
from stereocalib_app.widgets import palette


def _rgb(color: palette.Rgb) -> tuple[float, float, float]:
    return color[0] / 255.0, color[1] / 255.0, color[2] / 255.0


def figure_sheet(session: Session, snapshot: Snapshot, settings: Settings, card: str) -> bytes:
    """PNG bytes of an A4 landscape sheet."""
    # not before somebody asks for a sheet: drawing with matplotlib takes half a second to load
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.7, 8.3), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(3, 3, width_ratios=(1.25, 1.25, 1.0))
    figure.suptitle(f"{session.source.name}: extrinsics of {len(snapshot.results)} frames", fontsize=13)
    raw = raw_values(snapshot)[0]
    frames = np.arange(len(raw))
    failed = snapshot.failures()
    for axis, (name, unit, _) in enumerate(AXES):
        ax = figure.add_subplot(grid[axis, :2])
        ax.plot(frames, raw[:, axis], ".", ms=3, color=_rgb(palette.RAW), label="this pair")
        if snapshot.drive is not None:
            values = axis_values(snapshot.drive.frames.filtered)[:, axis]
            sigma = axis_values(snapshot.drive.frames.filtered_sigma)[:, axis]
            x = np.arange(len(values))
            ax.fill_between(x, values - sigma, values + sigma, color=_rgb(palette.FILTERED), alpha=0.25, lw=0)
            ax.plot(x, values, "-", lw=1.4, color=_rgb(palette.FILTERED), label="filtered ± σ")
        for frame in failed:
            ax.axvspan(frame - 0.5, frame + 0.5, color=_rgb(palette.FAILED), alpha=0.25, lw=0)
        ax.set_ylabel(f"{name} [{unit}]")
        ax.grid(alpha=0.25)
        if axis == 0:
            ax.legend(loc="upper right", fontsize=8, framealpha=0.8)
    ax.set_xlabel("frame")
    path = figure.add_subplot(grid[:2, 2])
    truth = session.source.ground_truth
    if truth is not None and truth.poses is not None:
        path.plot(
            truth.poses[:, 0, 3],
            truth.poses[:, 2, 3],
            "--",
            color=_rgb(palette.VARIANT["ground_truth"]),
            label="ground truth",
        )
    if snapshot.paths is not None:
        corrections = settings.corrections
        for name, result in snapshot.paths.variants(corrections.source, corrections.model).items():
            path.plot(
                result.poses[:, 0, 3],
                result.poses[:, 2, 3],
                color=_rgb(palette.VARIANT[name]),
                lw=2.0 if name == "autocalibrated" else 1.1,
                label=palette.VARIANT_NAME[name],
            )
        if corrections.touched:
            live = snapshot.paths.live(corrections).poses
            name = f"live: {describe(corrections)}"
            path.plot(live[:, 0, 3], live[:, 2, 3], color=_rgb(palette.LIVE), lw=1.6, label=name)
    path.set_aspect("equal", adjustable="datalim")
    path.set_xlabel("x [m]")
    path.set_ylabel("z [m]")
    path.grid(alpha=0.25)
    if path.get_legend_handles_labels()[0]:
        path.legend(fontsize=7)
    text = figure.add_subplot(grid[2, 2])
    text.axis("off")
    wrapped = "\n".join(
        part for line in card.splitlines() for part in textwrap.wrap(line, 44, subsequent_indent="  ")
    )
    # The card must not take part in the layout: a long line would squeeze the plots to nothing.
    label = text.text(
        0, 1, wrapped, va="top", ha="left", fontsize=8.5, family="monospace", transform=text.transAxes
    )
    label.set_in_layout(False)
    buffer = bytes_io.BytesIO()
    figure.savefig(buffer, format="png")
    return buffer.getvalue()
