"""The mounting yaw by the vanishing point of straight travel, on drives whose truth is known; and figure 1c."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from stereocalib_core.back.analyse import Workings
from stereocalib_core.back.rig.vanishing_point import VanishingPointView
from stereocalib_core.back.rig.yaw import YawEstimate, view
from stereocalib_core.experiments.odometry import follow
from stereocalib_core.frames import FrameSource
from stereocalib_core.sources import open_source
from stereocalib_core.system.whole_file import write_atomic, write_json

Picture = NDArray[np.uint8]

TAKES_DRIVE = True
"""Whether `--source` is a drive for it."""
TRUE_DEG = (-1.0, -0.3, 0.0, 0.5)
FRAMES = 160
"""Of the default drive: a straight, a bend and a straight."""
PAPER_DEG = -0.3
"""The paper's yaw of KITTI odometry 07, from straight parts of other drives of the same car."""


def run(
    out: Path, source: str | None = None, progress: Callable[[int, int, str], None] | None = None
) -> list[dict[str, Any]]:
    """Write yaw.json, yaw.md and yaw-figure-1c.png into `out`; returns what the JSON holds.

    Without `source`: synthetic drives with each yaw of `TRUE_DEG`. With one: that drive, `true_deg` null where
    it is not known. `estimate_deg` is null where a drive shows no yaw.
    """
    if source is None:
        specs = [f"synthetic:town?frames={FRAMES}&mount_yaw_deg={value}" for value in TRUE_DEG]
    else:
        specs = [source]
    entries, estimates, names = [], [], []
    shown: tuple[Picture, VanishingPointView] | None = None
    for number, spec in enumerate(specs):
        frames = open_source(spec)
        _, workings = follow(frames, _shared(progress, number, len(specs)))
        estimate = workings.yaw
        entries.append(_entry(_truth_deg(frames), estimate))
        estimates.append(estimate)
        names.append(frames.name)
        if shown is None or (source is None and TRUE_DEG[number] == PAPER_DEG):
            shown = _figure_pair(frames, workings) or shown
    write_json(out / "yaw.json", entries)
    write_atomic(out / "yaw.md", markdown(names, entries, estimates))
    if shown is not None:
        figure_1c(*shown).savefig(out / "yaw-figure-1c.png", dpi=110)
    return entries


def _shared(
    progress: Callable[[int, int, str], None] | None, number: int, count: int
) -> Callable[[int, int, str], None] | None:
    """Progress of one drive as its share of all."""
    if progress is None:
        return None
    return lambda done, total, what: progress(number * total + done, count * total, "yaw")


def _truth_deg(source: FrameSource) -> float | None:
    truth = source.ground_truth
    if truth is None or truth.extrinsics is None:
        return None
    value = float(np.rad2deg(np.nanmedian(truth.extrinsics[:, 3])))
    return value if np.isfinite(value) else None


def _entry(true_deg: float | None, estimate: YawEstimate) -> dict[str, Any]:
    known = estimate.value_rad is not None and estimate.sigma_rad is not None
    return {
        "true_deg": true_deg,
        "estimate_deg": float(np.rad2deg(estimate.value_rad)) if known else None,  # type: ignore[arg-type]
        "sigma_deg": float(np.rad2deg(estimate.sigma_rad)) if known else None,  # type: ignore[arg-type]
        "reason": estimate.reason,
    }


def _figure_pair(source: FrameSource, workings: Workings) -> tuple[Picture, VanishingPointView] | None:
    """The pair that agrees best with the drive's yaw: its previous left image, and its lines."""
    estimate, tracks = workings.yaw, workings.tracks
    if estimate.value_rad is None:
        return None
    misses = np.abs(estimate.pair_yaw_rad - estimate.value_rad)
    frame = int(np.nanargmin(misses))
    shown = view(tracks, frame)
    image = source[int(tracks.previous[frame])].left
    return None if shown is None or image is None else (image, shown)


def figure_1c(image: Picture, shown: VanishingPointView) -> Figure:
    """Road tracks as lines, where they intersect, and the vanishing point, over the left image."""
    height, width = image.shape
    figure = Figure(figsize=(12, 12 * height / width + 0.5), layout="constrained")
    ax = figure.subplots()
    ax.imshow(image, cmap="gray", vmin=0, vmax=255)
    u, v = shown.vanishing_point
    for (u0, v0, u1, v1), inlier in zip(shown.tracks, shown.inlier, strict=True):
        if inlier:
            ax.plot([u0, u], [v0, v], color="gold", linewidth=0.3, alpha=0.6)
        ax.plot([u0, u1], [v0, v1], color="lime" if inlier else "red", linewidth=1.4)
    ax.plot(*shown.intersections.T, ".", color="deepskyblue", markersize=2, alpha=0.5)
    ax.plot(u, v, "+", color="magenta", markersize=22, markeredgewidth=2)
    ax.axvline((width - 1) / 2, color="white", linewidth=0.5, linestyle=":")
    ax.set(xlim=(0, width - 1), ylim=(height - 1, 0))
    ax.set_title(
        f"Road tracks turned back (green: agree, red: not), intersections (blue), vanishing point ({u:.1f}, {v:.1f})"
        " px (paper: figure 1c)",
        fontsize=9,
    )
    return figure


def markdown(names: list[str], entries: list[dict[str, Any]], estimates: list[YawEstimate]) -> str:
    """The table, ours beside the paper's one value."""
    lines = [
        "# Mounting yaw",
        "",
        "Vanishing point of the road tracks of each pair of frames on a straight, tracks turned back by the",
        "rotation between the frames, RANSAC within the pair and over the pairs; exact under pitch and roll, and",
        "with the curvature of the path taken out.",
        "",
        f"The paper gives {PAPER_DEG} deg for the car of KITTI odometry 07, without a sigma and without a truth.",
        "",
        "| drive | true deg | estimate deg | sigma deg | error deg | pairs used | lever arm m |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, entry, estimate in zip(names, entries, estimates, strict=True):
        value, truth = entry["estimate_deg"], entry["true_deg"]
        error = None if value is None or truth is None else value - truth
        cells = [
            _cell(truth, ".3f"),
            _cell(value, ".4f"),
            _cell(entry["sigma_deg"], ".4f"),
            _cell(error, "+.4f"),
        ]
        lever = f"{estimate.lever_arm_m:.2f} +- {estimate.lever_arm_sigma_m:.2f}"
        lines.append(f"| `{name}` | {' | '.join(cells)} | {estimate.pairs_used} | {lever} |")
    refused = [f"- `{n}`: {e.reason}" for n, e in zip(names, estimates, strict=True) if e.reason]
    return "\n".join([*lines, "", *refused]).rstrip() + "\n"


def _cell(value: float | None, spec: str) -> str:
    return "-" if value is None else format(value, spec)
