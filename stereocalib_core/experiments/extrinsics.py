"""The paper's figures 2 and 3: roll on rotating rendered planes, and the height along a drive."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from stereocalib_core.back.rig.smoothing import filter_drive
from stereocalib_core.config import PipelineConfig
from stereocalib_core.errors import ConfigError
from stereocalib_core.frames import StereoFrame
from stereocalib_core.front.road.estimate import RoadResult, estimate_road
from stereocalib_core.front.road.variants import eq12_roll, fit_single_pass, fit_whole_map, labayrade_roll
from stereocalib_core.geometry import Extrinsics, StereoCamera
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.results import FrameResult, RoadEstimate, estimates
from stereocalib_core.simulator.plane import render_plane
from stereocalib_core.sources import open_source, prefetch
from stereocalib_core.system.whole_file import write_atomic, write_json

Progress = Callable[[int, int, str], None]

ROLL_FRAMES = 201
ROLL_RANGE_DEG = 5.0
NOISE = 1.5
EXPOSURE_DIFFERENCE = 0.05
CAMERA = StereoCamera(1226, 370, 707.0912, 601.8873, 183.1104, 0.53715)
PAPER_ROLL = {"median_abs_deg": 0.0276, "mean_abs_deg": 0.0331, "std_deg": 0.213}
PAPER_HEIGHT = {
    "whole_map": {"std": 0.1383},
    "free_map": {"mean": 1.6404, "median": 1.65, "std": 0.0875},
    "free_map_filtered": {"std": 0.0415},
}
ROLL_METHODS = ("eq12", "labayrade", "direct")
HEIGHT_METHODS = ("whole_map", "free_map", "free_map_filtered", "direct", "direct_filtered")


def run_roll(out: Path, source: str | None = None, progress: Progress | None = None) -> dict[str, Any]:
    """Figure 2: rendered pairs through the real matcher, roll from -5 to 5 degrees; writes roll.json, .md, .png.

    The road is a textured plane with grey noise and an exposure difference between the cameras; height and
    pitch vary from frame to frame. `source` is not used: the truth must be known.
    """
    if source is not None:
        raise ConfigError("experiment roll takes no source", source, "it renders planes whose roll is known")
    rng = np.random.default_rng(2)
    truth, found = [], []
    for k in range(ROLL_FRAMES):
        roll = -ROLL_RANGE_DEG + 2.0 * ROLL_RANGE_DEG * k / (ROLL_FRAMES - 1)
        pose = Extrinsics.from_degrees(1.65 + rng.uniform(-0.05, 0.05), 0.8 + rng.uniform(-0.5, 0.5), roll)
        left, right = render_plane(
            CAMERA, pose, seed=k, noise=NOISE, exposure_difference=EXPOSURE_DIFFERENCE
        )[:2]
        truth.append([pose.height_m, pose.pitch_deg, pose.roll_deg])
        found.append(_roll_frame(left, right))
        if progress:
            progress(k + 1, ROLL_FRAMES, "rendered planes")
    error = np.array(found) - np.array(truth)[:, None, :]
    report: dict[str, Any] = {m: _errors(error[:, i, 2], "deg") for i, m in enumerate(ROLL_METHODS)}
    report["pitch"] = {
        m: _errors(error[:, i, 1], "deg") for i, m in enumerate(ROLL_METHODS) if m != "labayrade"
    }
    report["height"] = {
        m: _errors(error[:, i, 0], "m") for i, m in enumerate(ROLL_METHODS) if m != "labayrade"
    }
    write_json(out / "roll.json", report)
    write_atomic(out / "roll.md", _roll_markdown(report))
    _figure_2(np.array(truth)[:, 2], np.array(found)[:, :, 2]).savefig(out / "roll-figure-2.png", dpi=110)
    return report


def _roll_frame(left: NDArray[np.uint8], right: NDArray[np.uint8]) -> list[list[float]]:
    """(3, 3): height [m], pitch, roll [deg] by `ROLL_METHODS`; NaN where a method says nothing."""
    config = PipelineConfig()
    road = estimate_road(left, right, CAMERA, config)
    rows = [[np.nan] * 3 for _ in ROLL_METHODS]
    if road.disparity is None or road.free is None:
        return rows
    if road.paper is not None:
        alone = eq12_roll(road.disparity, road.free, CAMERA, config)
        e = road.paper.extrinsics
        rows[0] = [e.height_m, e.pitch_deg, np.nan if alone is None else float(np.rad2deg(alone))]
    projected = labayrade_roll(road.disparity, road.free, CAMERA, config.profile)
    rows[1][2] = np.nan if projected is None else float(np.rad2deg(projected))
    if road.estimate is not None:
        e = road.estimate.extrinsics
        rows[2] = [e.height_m, e.pitch_deg, e.roll_deg]
    return rows


def _errors(error: Array, unit: str) -> dict[str, float | int]:
    e = error[np.isfinite(error)]
    return {
        f"median_abs_{unit}": float(np.median(np.abs(e))),
        f"mean_abs_{unit}": float(np.mean(np.abs(e))),
        f"bias_{unit}": float(np.mean(e)),
        f"std_{unit}": float(np.std(e)),
        "n": len(e),
    }


def _roll_markdown(report: Mapping[str, Any]) -> str:
    lines = [
        "# Roll on rendered planes (the paper's figure 2)",
        "",
        f"{ROLL_FRAMES} rendered stereo pairs, roll from -{ROLL_RANGE_DEG:g} to {ROLL_RANGE_DEG:g} degrees, "
        f"grey noise of {NOISE:g} levels, {EXPOSURE_DIFFERENCE:.0%} exposure difference, matched at half resolution.",
        "",
        "| roll | median of error | mean | bias | sigma |",
        "|---|---|---|---|---|",
        "| paper, eq. 12 | {median_abs_deg} | {mean_abs_deg} | | {std_deg} |".format(**PAPER_ROLL),
    ]
    for method in ROLL_METHODS:
        r = report[method]
        lines.append(
            "| {0} | {median_abs_deg:.4f} | {mean_abs_deg:.4f} | {bias_deg:+.4f} | {std_deg:.4f} |".format(
                method, **r
            )
        )
    lines += [
        "",
        "Degrees; ours are of the absolute error.",
        "",
        "| | pitch bias, deg | height bias, mm |",
        "|---|---|---|",
    ]
    for method in report["pitch"]:
        pitch, height = report["pitch"][method]["bias_deg"], 1e3 * report["height"][method]["bias_m"]
        lines.append(f"| {method} | {pitch:+.4f} | {height:+.2f} |")
    return "\n".join(lines) + "\n"


def _figure_2(truth_deg: Array, found_deg: Array) -> Figure:
    figure = Figure(figsize=(11, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.plot(truth_deg, color="#1f4e9c", label="true")
    left.plot(found_deg[:, 0], ".", ms=3, color="#c03020", label="eq. 12")
    left.set(xlabel="frame", ylabel="roll, deg", title="(a) roll of each frame")
    left.legend()
    _histogram(right, found_deg[:, 0] - truth_deg, "#c03020", "eq. 12")
    _histogram(right, found_deg[:, 2] - truth_deg, "#1a7f4b", "direct")
    right.set(xlabel="error, deg", ylabel="density", title="(b) error of the roll")
    right.legend()
    return figure


def _histogram(axes: Axes, values: Array, colour: str, label: str) -> None:
    """Histogram as a density with the normal distribution of the same mean and sigma over it."""
    values = values[np.isfinite(values)]
    if len(values) < 2:
        return
    mean, std = float(values.mean()), max(float(values.std()), 1e-9)
    x = np.linspace(mean - 4 * std, mean + 4 * std, 200)
    axes.hist(values, bins=40, density=True, color=colour, alpha=0.35)
    density = np.exp(-0.5 * ((x - mean) / std) ** 2) / (std * np.sqrt(2 * np.pi))
    axes.plot(x, density, color=colour, label=f"{label}: {mean:.4f} ± {std:.4f}")


def run_height(out: Path, source: str | None = None, progress: Progress | None = None) -> dict[str, Any]:
    """Figure 3: the height along a drive by every method, raw and filtered; writes height.json, .md, .png."""
    recording = open_source(source or "synthetic:town?frames=300")
    config = PipelineConfig()
    series: dict[str, list[FrameResult]] = {name: [] for name in ("whole_map", "free_map", "direct")}
    single: list[float] = []
    for frame in prefetch(recording, 0, len(recording)):
        road = _road(frame, recording.camera, config)
        whole = None
        if road is not None and road.disparity is not None:
            whole = fit_whole_map(road.disparity, recording.camera, config)
            once = (
                None
                if road.free is None
                else fit_single_pass(road.disparity, road.free, recording.camera, config)
            )
            single.append(np.nan if once is None else once.height_m)
        series["whole_map"].append(_as_result(frame, road, whole))
        paper = None if road is None or road.estimate is None or road.paper is None else road.paper.extrinsics
        series["free_map"].append(_as_result(frame, road, paper))
        direct = None if road is None or road.estimate is None else road.estimate.extrinsics
        series["direct"].append(_as_result(frame, road, direct))
        if progress:
            progress(frame.index + 1, len(recording), "frames")
    values = {name: estimates(results) for name, results in series.items()}
    for name in ("free_map", "direct"):
        values[f"{name}_filtered"] = filter_drive(series[name], recording.camera, config).values
    report: dict[str, Any] = {name: _statistics(values[name][:, 0]) for name in HEIGHT_METHODS}
    report["single_pass"] = _statistics(np.array(single))
    write_json(out / "height.json", report)
    write_atomic(out / "height.md", _height_markdown(recording.name, len(recording), report))
    _figure_3(values).savefig(out / "height-figure-3.png", dpi=110)
    return report


def _road(frame: StereoFrame, camera: StereoCamera, config: PipelineConfig) -> RoadResult | None:
    if frame.left is None or frame.right is None or frame.failure is not None:
        return None
    return estimate_road(frame.left, frame.right, camera, config)


def _as_result(frame: StereoFrame, road: RoadResult | None, extrinsics: Extrinsics | None) -> FrameResult:
    """One method's extrinsics in the form that the filter takes, with the covariance of the frame's own fit."""
    if road is None or extrinsics is None or road.paper is None:
        return FrameResult(frame.index, frame.timestamp_s, None)
    covariance = road.paper.covariance
    if road.estimate is not None and road.estimate.extrinsics == extrinsics:
        covariance = road.estimate.covariance
    estimate = RoadEstimate(extrinsics, covariance, 0, 0.0, (0.0, 0.0))
    return FrameResult(frame.index, frame.timestamp_s, estimate)


def _statistics(heights: Array) -> dict[str, float | None]:
    h = heights[np.isfinite(heights)]
    if len(h) == 0:
        return {"mean": None, "median": None, "std": None}
    return {"mean": float(h.mean()), "median": float(np.median(h)), "std": float(h.std())}


def _height_markdown(name: str, frames: int, report: Mapping[str, Any]) -> str:
    lines = [
        "# Height along a drive (the paper's figure 3)",
        "",
        f"Drive: {name}, {frames} frames. The paper's own drive is KITTI raw 2011_09_30_drive_0027, 1100 frames.",
        "",
        "| metres | mean | median | sigma | paper: mean | median | sigma |",
        "|---|---|---|---|---|---|---|",
    ]

    def cell(value: float | None) -> str:
        return "" if value is None else f"{value:.4f}"

    for method in (*HEIGHT_METHODS, "single_pass"):
        r, paper = report[method], PAPER_HEIGHT.get(method, {})
        ours = " | ".join(cell(r[key]) for key in ("mean", "median", "std"))
        theirs = " | ".join(cell(paper.get(key)) for key in ("mean", "median", "std"))
        lines.append(f"| {method} | {ours} | {theirs} |")
    return "\n".join(lines) + "\n"


def _figure_3(values: Mapping[str, Array]) -> Figure:
    figure = Figure(figsize=(12, 7), layout="constrained")
    grid = figure.subplots(2, 2)
    _histogram(grid[0, 0], values["free_map"][:, 0], "#4c78a8", "free map")
    _histogram(grid[0, 0], values["direct"][:, 0], "#1a7f4b", "direct")
    grid[0, 0].set(title="(a) height of single pairs", xlabel="height, m")
    _histogram(grid[0, 1], values["free_map_filtered"][:, 0], "#4c78a8", "free map")
    _histogram(grid[0, 1], values["direct_filtered"][:, 0], "#1a7f4b", "direct")
    grid[0, 1].set(title="(b) height after the filter", xlabel="height, m")
    for axes, axis, label in ((grid[1, 0], 1, "pitch"), (grid[1, 1], 2, "roll")):
        for name, colour in (("free_map", "#9ab6d6"), ("direct", "#1a7f4b")):
            axes.plot(
                np.rad2deg(values[name][:, axis]), ".", ms=2.5, color=colour, label=name.replace("_", " ")
            )
        axes.plot(
            np.rad2deg(values["direct_filtered"][:, axis]), lw=1, color="#b0303a", label="direct, filtered"
        )
        axes.set(title=f"(c) {label} along the drive", xlabel="frame", ylabel="deg")
    for axes in grid.flat:
        axes.legend(fontsize=8)
    return figure
