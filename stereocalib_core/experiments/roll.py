"""The paper's figure 2: roll on rotating rendered planes, every method on the same cells of the same pictures.

Methods: `eq12` (the vote over all near disparities) and `labayrade` (repeated projections) from the whole width of the
free map, as the paper; the same two within a corridor (`_corridor`), as on real roads; `to_the_letter`, the paper's
own steps (a line in the v-disparity picture, eq. 12 at one fixed disparity); `direct`, the alignment of the pictures.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from stereocalib_core.config import PipelineConfig
from stereocalib_core.errors import ConfigError
from stereocalib_core.experiments.figures import histogram
from stereocalib_core.front.road.estimate import estimate_road
from stereocalib_core.front.road.variants import fit_cells, fit_labayrade, fit_to_the_letter
from stereocalib_core.geometry import Extrinsics, StereoCamera
from stereocalib_core.numeric.arrays import Array, Grey
from stereocalib_core.simulator.plane import render_plane
from stereocalib_core.system.whole_file import write_atomic, write_json

Progress = Callable[[int, int, str], None]

TAKES_DRIVE = False
"""Whether `--source` is a drive for it; it makes its own data, whose truth is known."""
FRAMES = 201
RANGE_DEG = 5.0
CORRIDOR_M = 3.0
"""Half width of the corridor."""
NOISE = 1.5
EXPOSURE_DIFFERENCE = 0.05
CAMERA = StereoCamera(1226, 370, 707.0912, 601.8873, 183.1104, 0.53715)
PAPER = {"median_abs_deg": 0.0276, "mean_abs_deg": 0.0331, "std_deg": 0.213}
METHODS = ("eq12", "labayrade", "direct", "eq12_corridor", "labayrade_corridor", "to_the_letter")
BLOCKS = {"height": (0, "m"), "pitch": (1, "deg"), "roll": (2, "deg")}


def run(out: Path, source: str | None = None, progress: Progress | None = None) -> dict[str, Any]:
    """Rendered pairs through the real matcher, roll from -5 to 5 degrees; writes roll.json, .md, .png.

    The road is a textured plane with grey noise and an exposure difference between the cameras; height and pitch vary
    from frame to frame. `source` is not used: the truth must be known.
    """
    if source is not None:
        raise ConfigError("experiment roll takes no source", source, "it renders planes whose roll is known")
    rng = np.random.default_rng(2)
    truth, found = [], []
    for k in range(FRAMES):
        roll = -RANGE_DEG + 2.0 * RANGE_DEG * k / (FRAMES - 1)
        pose = Extrinsics.from_degrees(1.65 + rng.uniform(-0.05, 0.05), 0.8 + rng.uniform(-0.5, 0.5), roll)
        left, right = render_plane(
            CAMERA, pose, seed=k, noise=NOISE, exposure_difference=EXPOSURE_DIFFERENCE
        )[:2]
        truth.append([pose.height_m, pose.pitch_deg, pose.roll_deg])
        found.append(measure(left, right))
        if progress:
            progress(k + 1, FRAMES, "rendered planes")
    error = np.array(found) - np.array(truth)[:, None, :]
    blocks = {
        block: {method: errors(error[:, i, axis], unit) for i, method in enumerate(METHODS)}
        for block, (axis, unit) in BLOCKS.items()
    }
    report: dict[str, Any] = {**blocks["roll"], "pitch": blocks["pitch"], "height": blocks["height"]}
    write_json(out / "roll.json", report)
    write_atomic(out / "roll.md", markdown(report))
    figure_2(np.array(truth)[:, 2], np.array(found)[:, :, 2]).savefig(out / "roll-figure-2.png", dpi=110)
    return report


def measure(left: Grey, right: Grey) -> list[list[float]]:
    """(M, 3): height [m], pitch, roll [deg] by `METHODS`; NaN where a method says nothing."""
    config = PipelineConfig()
    road = estimate_road(left, right, CAMERA, config)
    found: dict[str, Extrinsics | None] = {}
    if road.drawable:
        cells = road.disparity, road.free, CAMERA, config
        for suffix, corridor_m in (("", None), ("_corridor", CORRIDOR_M)):
            fit = fit_cells(*cells, corridor_m)
            found["eq12" + suffix] = None if fit is None or fit.roll is None else fit.extrinsics
            found["labayrade" + suffix] = fit_labayrade(*cells, corridor_m)
        found["to_the_letter"] = fit_to_the_letter(*cells)
    if road.estimate is not None:
        found["direct"] = road.estimate.extrinsics
    return [_row(found.get(method)) for method in METHODS]


def _row(e: Extrinsics | None) -> list[float]:
    return [np.nan] * 3 if e is None else [e.height_m, e.pitch_deg, e.roll_deg]


def errors(error: Array, unit: str) -> dict[str, float | int | None]:
    """Statistics of (N,) errors; NaN = the method said nothing."""
    e = error[np.isfinite(error)]
    figures = {
        f"median_abs_{unit}": np.median(np.abs(e)) if len(e) else None,
        f"mean_abs_{unit}": np.mean(np.abs(e)) if len(e) else None,
        f"bias_{unit}": np.mean(e) if len(e) else None,
        f"std_{unit}": np.std(e) if len(e) else None,
    }
    return {key: None if value is None else float(value) for key, value in figures.items()} | {"n": len(e)}


def markdown(report: Mapping[str, Any]) -> str:
    """The tables of the three angles and what they show."""
    lines = [
        "# Roll on rendered planes (the paper's figure 2)",
        "",
        f"{FRAMES} rendered stereo pairs, roll from -{RANGE_DEG:g} to {RANGE_DEG:g} degrees, grey noise of {NOISE:g} "
        f"levels, {EXPOSURE_DIFFERENCE:.0%} exposure difference, matched at half resolution. Eq. 12 and Labayrade's "
        f"projections use the same cells: the whole width of the free map, or a corridor of {CORRIDOR_M:g} m to either "
        "side.",
        "",
        "| roll | n | median of error, deg | mean | bias | sigma |",
        "|---|---|---|---|---|---|",
        "| paper, eq. 12 | | {median_abs_deg} | {mean_abs_deg} | | {std_deg} |".format(**PAPER),
        *_rows(report, "deg"),
        "",
        "Ours are of the absolute error; the paper does not say whether its are.",
        "",
        "| pitch | n | median of error, deg | mean | bias | sigma |",
        "|---|---|---|---|---|---|",
        *_rows(report["pitch"], "deg"),
        "",
        "| height | n | median of error, m | mean | bias | sigma |",
        "|---|---|---|---|---|---|",
        *_rows(report["height"], "m"),
        "",
        *verdicts(report),
    ]
    return "\n".join(lines) + "\n"


def _rows(block: Mapping[str, Any], unit: str) -> list[str]:
    rows = []
    for method in METHODS:
        r = block[method]
        cells = [r[f"{key}_{unit}"] for key in ("median_abs", "mean_abs", "bias", "std")]
        shown = " | ".join("-" if value is None else f"{value:.4f}" for value in cells)
        rows.append(f"| {method} | {r['n']} | {shown} |")
    return rows


def verdicts(report: Mapping[str, Any]) -> list[str]:
    """Who wins, by the medians of the roll's error."""
    lines = []
    for suffix, where in (("", "From the whole width"), ("_corridor", f"Within {CORRIDOR_M:g} m")):
        ours, theirs = (report[m + suffix]["median_abs_deg"] for m in ("eq12", "labayrade"))
        if ours is None or theirs is None:
            continue
        winner = "eq. 12 wins" if ours < theirs else "Labayrade's projections win"
        lines.append(f"{where} {winner}: {ours:.4f} deg by eq. 12, {theirs:.4f} deg by Labayrade.")
    known = {m: report[m]["median_abs_deg"] for m in METHODS if report[m]["median_abs_deg"] is not None}
    if known:
        best = min(known, key=lambda method: known[method])
        letter = known.get("to_the_letter")
        lines.append(f"Of all, `{best}` is best with {known[best]:.4f} deg.")
        if letter is not None and "eq12" in known:
            lines.append(
                f"One fixed disparity and a line in the v-disparity picture, to the letter, give {letter:.4f} deg "
                f"where the vote over all near disparities gives {known['eq12']:.4f} deg."
            )
    return [" ".join(lines)]


def figure_2(truth_deg: Array, found_deg: Array) -> Figure:
    """Roll of each frame and the density of its error; found_deg: (N, M) by `METHODS`."""
    figure = Figure(figsize=(11, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    eq12, direct = METHODS.index("eq12"), METHODS.index("direct")
    left.plot(truth_deg, color="#1f4e9c", label="true")
    left.plot(found_deg[:, eq12], ".", ms=3, color="#c03020", label="eq. 12")
    left.set(xlabel="frame", ylabel="roll, deg", title="(a) roll of each frame")
    left.legend()
    histogram(right, found_deg[:, eq12] - truth_deg, "#c03020", "eq. 12")
    histogram(right, found_deg[:, direct] - truth_deg, "#1a7f4b", "direct")
    right.set(xlabel="error, deg", ylabel="density", title="(b) error of the roll")
    right.legend()
    return figure
