"""The paper's figure 3: the height along a drive by every method, on the same frames.

`whole_map` and `free_map` take the whole width of the picture, as the paper; `_corridor` both within the same corridor,
as on real roads. `free_map_filtered` and `direct_filtered` are the causal filter on the same frames. `single_pass`
keeps the paper's order (pitch and height before roll), `to_the_letter` its own steps (a line in the v-disparity
picture, eq. 12 at one fixed disparity).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from stereocalib_core.back.rig.smoothing import filter_drive
from stereocalib_core.config import PipelineConfig
from stereocalib_core.experiments.figures import histogram
from stereocalib_core.frames import StereoFrame
from stereocalib_core.front.road.estimate import RoadResult, estimate_road
from stereocalib_core.front.road.paper import PaperFit
from stereocalib_core.front.road.variants import fit_cells, fit_to_the_letter
from stereocalib_core.geometry import Extrinsics, StereoCamera
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.results import FrameResult, RoadEstimate, estimates
from stereocalib_core.sources import open_source
from stereocalib_core.sources.prefetch import prefetch
from stereocalib_core.system.whole_file import write_atomic, write_json

Progress = Callable[[int, int, str], None]
Seen = tuple[Extrinsics, Array]
"""Height, pitch, roll and their (3, 3) covariance."""

TAKES_DRIVE = True
"""Whether `--source` is a drive for it."""
DEFAULT_SOURCE = "synthetic:town?frames=300"
CORRIDOR_M = 3.0
"""Half width of the corridor."""
PAPER = {
    "whole_map": {"std": 0.1383},
    "free_map": {"mean": 1.6404, "median": 1.65, "std": 0.0875},
    "free_map_filtered": {"std": 0.0415},
}
RAW = (
    "whole_map",
    "free_map",
    "whole_map_corridor",
    "free_map_corridor",
    "single_pass",
    "to_the_letter",
    "direct",
)
METHODS = (
    "whole_map", "free_map", "whole_map_corridor", "free_map_corridor", "free_map_filtered", "direct",
    "direct_filtered", "single_pass", "to_the_letter",
)  # fmt: skip


def run(out: Path, source: str | None = None, progress: Progress | None = None) -> dict[str, Any]:
    """Every method on every frame of a drive; writes height.json, .md, .png.

    Statistics are over the frames that all methods could measure.
    """
    recording = open_source(source or DEFAULT_SOURCE)
    config = PipelineConfig()
    series: dict[str, list[FrameResult]] = {name: [] for name in RAW}
    for frame in prefetch(recording, 0, len(recording)):
        found = measure(frame, recording.camera, config)
        for name in RAW:
            series[name].append(_as_result(frame, found.get(name) if len(found) == len(RAW) else None))
        if progress:
            progress(frame.index + 1, len(recording), "height")
    values = {name: estimates(results) for name, results in series.items()}
    for name in ("free_map", "direct"):
        values[f"{name}_filtered"] = filter_drive(series[name], recording.camera, config).filtered.values
    same = np.isfinite(values["direct"][:, 0])
    report: dict[str, Any] = {name: statistics(values[name][same, 0]) for name in METHODS}
    write_json(out / "height.json", report)
    write_atomic(out / "height.md", markdown(recording.name, len(recording), report))
    figure_3({name: rows[same] for name, rows in values.items()}).savefig(
        out / "height-figure-3.png", dpi=110
    )
    return report


def measure(frame: StereoFrame, camera: StereoCamera, config: PipelineConfig) -> dict[str, Seen]:
    """What each method of `RAW` makes of one pair; methods that say nothing are left out."""
    road = _road(frame, camera, config)
    if road is None or not road.drawable:
        return {}
    maps = {"whole_map": road.disparity.values > 0, "free_map": road.free}
    fits: dict[str, PaperFit | None] = {}
    for name, mask in maps.items():
        fits[name] = fit_cells(road.disparity, mask, camera, config)
        fits[f"{name}_corridor"] = fit_cells(road.disparity, mask, camera, config, CORRIDOR_M)
    fits["single_pass"] = fit_cells(road.disparity, road.free, camera, config, CORRIDOR_M, True)
    found = {name: (fit.extrinsics, fit.covariance) for name, fit in fits.items() if fit is not None}
    letter = fit_to_the_letter(road.disparity, road.free, camera, config)
    if letter is not None and "free_map" in found:
        found["to_the_letter"] = (letter, found["free_map"][1])
    if road.estimate is not None:
        found["direct"] = (road.estimate.extrinsics, road.estimate.covariance)
    return found


def _road(frame: StereoFrame, camera: StereoCamera, config: PipelineConfig) -> RoadResult | None:
    if frame.left is None or frame.right is None or frame.failure is not None:
        return None
    return estimate_road(frame.left, frame.right, camera, config)


def _as_result(frame: StereoFrame, seen: Seen | None) -> FrameResult:
    """One method's extrinsics in the form that the filter takes."""
    road = None if seen is None else RoadEstimate(*seen, 0, 0.0, (0.0, 0.0))
    return FrameResult(frame.index, frame.timestamp_s, road)


def statistics(heights: Array) -> dict[str, float | int | None]:
    """Mean, median and standard deviation [m], and of how many frames."""
    h = heights[np.isfinite(heights)]
    if len(h) == 0:
        return {"mean": None, "median": None, "std": None, "n": 0}
    return {"mean": float(h.mean()), "median": float(np.median(h)), "std": float(h.std()), "n": len(h)}


def markdown(name: str, frames: int, report: Mapping[str, Any]) -> str:
    """The table, ours beside the paper's, and who wins."""
    lines = [
        "# Height along a drive (the paper's figure 3)",
        "",
        f"Drive: {name}, {frames} frames; all rows are of the same {report['direct']['n']} frames, which every method",
        f"could measure. Corridor: {CORRIDOR_M:g} m to either side. The paper's own drive is KITTI raw",
        "2011_09_30_drive_0027, 1100 frames.",
        "",
        "| metres | n | mean | median | sigma | paper: mean | median | sigma |",
        "|---|---|---|---|---|---|---|---|",
    ]

    def cell(value: float | None) -> str:
        return "" if value is None else f"{value:.4f}"

    for method in METHODS:
        r, paper = report[method], PAPER.get(method, {})
        ours = " | ".join(cell(r[key]) for key in ("mean", "median", "std"))
        theirs = " | ".join(cell(paper.get(key)) for key in ("mean", "median", "std"))
        lines.append(f"| {method} | {r['n']} | {ours} | {theirs} |")
    return "\n".join([*lines, "", *verdicts(report)]) + "\n"


def verdicts(report: Mapping[str, Any]) -> list[str]:
    """Which map gives the steadier height, without and with a corridor, and what filter and direct alignment add."""
    if report["direct"]["std"] is None:
        return ["No frame could be measured by every method."]
    mm = {method: 1e3 * report[method]["std"] for method in METHODS}
    said = []
    for suffix, where in (
        ("", "Without a corridor, as in the paper,"),
        ("_corridor", "Within the same corridor"),
    ):
        whole, free = mm["whole_map" + suffix], mm["free_map" + suffix]
        better = "is the steadier" if free < whole else "is not steadier"
        said.append(
            f"{where} the free map {better}: sigma {free:.1f} mm against {whole:.1f} mm of the whole map."
        )
    best = min(METHODS, key=lambda method: mm[method])
    said.append(f"The steadiest of all is `{best}` with {mm[best]:.1f} mm.")
    said.append(f"`direct` alone has {mm['direct']:.1f} mm; the car's own springs are in every figure.")
    return [" ".join(said)]


def figure_3(values: Mapping[str, Array]) -> Figure:
    """Histograms of the height, raw and filtered, and pitch and roll along the drive."""
    figure = Figure(figsize=(12, 7), layout="constrained")
    grid = figure.subplots(2, 2)
    histogram(grid[0, 0], values["free_map"][:, 0], "#4c78a8", "free map")
    histogram(grid[0, 0], values["direct"][:, 0], "#1a7f4b", "direct")
    grid[0, 0].set(title="(a) height of single pairs", xlabel="height, m")
    histogram(grid[0, 1], values["free_map_filtered"][:, 0], "#4c78a8", "free map")
    histogram(grid[0, 1], values["direct_filtered"][:, 0], "#1a7f4b", "direct")
    grid[0, 1].set(title="(b) height after the filter", xlabel="height, m")
    for axes, axis, label in ((grid[1, 0], 1, "pitch"), (grid[1, 1], 2, "roll")):
        for name, colour in (("free_map", "#9ab6d6"), ("direct", "#1a7f4b")):
            rows = np.rad2deg(values[name][:, axis])
            axes.plot(rows, ".", ms=2.5, color=colour, label=name.replace("_", " "))
        filtered = np.rad2deg(values["direct_filtered"][:, axis])
        axes.plot(filtered, lw=1, color="#b0303a", label="direct, filtered")
        axes.set(title=f"(c) {label} along the drive", xlabel="frame", ylabel="deg")
    for axes in grid.flat:
        axes.legend(fontsize=8)
    return figure
