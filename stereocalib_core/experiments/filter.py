"""What the filter makes of single pairs: errors before and after, how honest sigma is, and what the U in UKF is for.

Every drive whose extrinsics are known will do. `raw` are single pairs; `filtered` knows the frames before, `smoothed`
those after too; both as every run writes them. `linear` is the same filter given height, pitch and roll in place of
the plane in disparity space, which makes it a plain Kalman filter.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from stereocalib_core.back.analyse import analyse
from stereocalib_core.back.odometry.packing import pack
from stereocalib_core.back.rig.body_filter import RigFilter, plane_covariance, plane_of
from stereocalib_core.back.rig.carried import Moved, motions
from stereocalib_core.back.rig.road_points import Look
from stereocalib_core.back.rig.smoothing import measurements
from stereocalib_core.config import PipelineConfig
from stereocalib_core.frames import FrameSource
from stereocalib_core.geometry import DisparityPlane, StereoCamera
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.results import FrameResult, FrameTable
from stereocalib_core.run.calibrate import follow
from stereocalib_core.sources import open_source
from stereocalib_core.system.whole_file import write_atomic, write_json

Progress = Callable[[int, int, str], None]

TAKES_DRIVE = True
"""Whether `--source` is a drive for it."""
DEFAULT_SOURCE = "synthetic:town"
METHODS = ("paper", "direct")
AXES = ("height_m", "pitch_deg", "roll_deg")
UNIT = np.array([1.0, *np.rad2deg([1.0, 1.0])])
APART = np.array([0.001, 0.01, 0.01])
"""Frames where the linear filter differs by more [m, deg] are held against the truth."""
ROUGH_HEIGHTS = (0.004, 0.02, 0.06, 0.12)
"""1 sigma of the height as a share of it, for planes of known noise; pitch and roll with it (see `rough_planes`)."""
ROUGH_FRAMES = 300
SEEDS = 4


class LinearFilter(RigFilter):
    """Height, pitch, roll in place of the plane: filterpy's filter is then a Kalman filter."""

    def _plane(self, values: Array) -> Array:
        return values

    def _jacobian(self, values: Array) -> Array:
        return np.eye(3)


def run(out: Path, source: str | None = None, progress: Progress | None = None) -> dict[str, Any]:
    """Both methods along a drive; writes filter.json, .md, .png.

    A drive whose extrinsics nobody knows cannot judge a filter, and is not driven: no figures.
    """
    spec = source or DEFAULT_SOURCE
    frames = open_source(spec)
    known = frames.ground_truth is not None and frames.ground_truth.extrinsics is not None
    report: dict[str, Any] = {}
    in_sigmas: dict[str, Array] = {}
    for number, method in enumerate(METHODS):
        if not known:
            report[method] = {"n": 0}
            continue
        config = PipelineConfig(method=method)  # type: ignore[arg-type]
        results = []
        for step in follow(frames, config):
            results.append(step.done.result)
            if progress:
                done = number * len(frames) + len(results)
                progress(done, len(METHODS) * len(frames), f"filter, {method}")
        report[method], scores = judge(results, frames, config)
        in_sigmas |= {f"{method}, {name}": score for name, score in scores.items()}
    if known:
        report["planes_of_known_noise"] = rough_planes(frames)
    write_json(out / "filter.json", report)
    write_atomic(out / "filter.md", markdown(frames.name, len(frames), report))
    if known:
        figure(in_sigmas).savefig(out / "filter-figure.png", dpi=110)
    return report


def judge(
    results: Sequence[FrameResult], source: FrameSource, config: PipelineConfig
) -> tuple[dict[str, Any], dict[str, Array]]:
    """One method along a drive against the truth, and (M, 3) errors over sigma of each series."""
    truth = source.ground_truth
    assert truth is not None and truth.extrinsics is not None
    table = analyse(results, source.camera, config, truth).frames
    tracks = pack(source.camera, results, config.odometry)
    looks = measurements(results, tracks, config)
    linear = filtered_by(LinearFilter, looks, source, config, motions(tracks))
    return against(table, linear, truth.extrinsics[: len(results), :3])


def filtered_by(
    kind: type[RigFilter],
    looks: Sequence[Sequence[Look]],
    source: FrameSource,
    config: PipelineConfig,
    moved: Sequence[Moved | None] | None = None,
) -> Array:
    """(N, 3) height, pitch, roll by a filter given the looks of each frame, none = failed, and the motions into it."""
    rig = kind(source.camera, config.filter, config.vehicle)
    found = [
        rig.step(float(t), *seen, moved=motion).values
        for t, seen, motion in zip(source.timestamps_s, looks, moved or [None] * len(looks), strict=False)
    ]
    return np.array(found).reshape(-1, 3)


def against(table: FrameTable, linear: Array, truth: Array) -> tuple[dict[str, Any], dict[str, Array]]:
    """Errors of every series against (N, 3) truth, on frames that single pair, filter and smoother have all seen."""
    same = np.isfinite(np.hstack([table.values, table.filtered, table.smoothed, linear])).all(axis=1)
    same &= np.array([state == "updated" for state in table.filter_state])
    if not same.any():
        return {"n": 0}, {}
    raw = rmse((table.values - truth)[same])
    block: dict[str, Any] = {"n": int(same.sum()), "raw": {"rmse": _row(raw)}}
    block["raw"] |= covered((table.values - truth)[same], table.sigma[same])
    scores = {}
    for name in ("filtered", "smoothed"):
        error, sigma = (getattr(table, name) - truth)[same], getattr(table, name + "_sigma")[same]
        after = rmse(error)
        block[name] = {"rmse": _row(after), "ratio": _row(after / raw, scaled=False)} | covered(error, sigma)
        scores[name] = error / sigma
    apart = np.abs((table.filtered - linear)[same]) * UNIT
    far = (apart > APART).any(axis=1)
    block["linear"] = {
        "rmse": _row(rmse((linear - truth)[same])),
        "most_apart": _row(apart.max(axis=0, initial=0.0), scaled=False),
        "frames_apart": int(far.sum()),
        "rmse_there": _row(rmse((linear - truth)[same][far])),
        "ukf_rmse_there": _row(rmse((table.filtered - truth)[same][far])),
    }
    return block, scores


def covered(error: Array, sigma: Array) -> dict[str, Any]:
    """Share of (N, 3) errors within one and two sigma."""
    return {
        f"within_{times}_sigma": _row((np.abs(error) < times * sigma).mean(axis=0), scaled=False)
        for times in (1, 2)
    }


def rmse(error: Array) -> Array:
    """(3,) of (N, 3) errors; NaN without any."""
    return np.sqrt((error**2).mean(axis=0)) if len(error) else np.full(3, np.nan)


def _row(values: Array, scaled: bool = True) -> dict[str, float | None]:
    shown = values * UNIT if scaled else values
    return {axis: float(v) if np.isfinite(v) else None for axis, v in zip(AXES, shown.tolist(), strict=True)}


def rough_planes(source: FrameSource) -> list[dict[str, Any]]:
    """The drive's own body motion seen through planes whose noise is known, small to large: UKF against linear.

    (A, B, C) have normal errors, as a fit's; the filters get that covariance, the linear one turned into height, pitch
    and roll at what was measured. sigma: as of a share of the height, and 8 deg of pitch and 16 deg of roll per unit of
    it. Errors are those of the height; `linear_over_ukf` comes with the standard error over the seeds.
    """
    assert source.ground_truth is not None and source.ground_truth.extrinsics is not None
    truth = source.ground_truth.extrinsics[:ROUGH_FRAMES, :3]
    rows = []
    for share in ROUGH_HEIGHTS:
        sigma = np.array([share * truth[0, 0], *np.deg2rad([8.0 * share, 16.0 * share])])
        found = np.array([_rough(truth, source, sigma, seed) for seed in range(SEEDS)])
        ratio = found[:, 1] / found[:, 0]
        rows.append(
            {
                "height_sigma_m": float(sigma[0]),
                "ukf_rmse_m": float(found[:, 0].mean()),
                "linear_rmse_m": float(found[:, 1].mean()),
                "linear_over_ukf": float(ratio.mean()),
                "linear_over_ukf_sigma": float(ratio.std(ddof=1) / np.sqrt(len(ratio))),
            }
        )
    return rows


def _rough(truth: Array, source: FrameSource, sigma: Array, seed: int) -> tuple[float, float]:
    config = PipelineConfig()
    looks = [(look,) for look in planes_seen(truth, source.camera, sigma, seed)]
    ukf, linear = (
        float(rmse((filtered_by(kind, looks, source, config) - truth)[len(truth) // 6 :])[0])
        for kind in (RigFilter, LinearFilter)
    )
    return ukf, linear


def planes_seen(truth: Array, camera: StereoCamera, sigma: Array, seed: int) -> list[Look]:
    """N looks: height, pitch, roll read from planes with normal errors in (A, B, C), and their covariance.

    truth: (N, 3); sigma: (3,) of height, pitch, roll as the planes' errors make them at the first frame.
    """
    noise = plane_covariance(camera, truth[0], np.diag(sigma**2))
    rng = np.random.default_rng([seed, 12])
    planes = np.array([plane_of(camera, row) for row in truth])
    planes = planes + rng.standard_normal(planes.shape) @ np.linalg.cholesky(noise).T
    looks = []
    for plane in planes:
        e = DisparityPlane(*plane.tolist()).extrinsics(camera)
        back = np.linalg.inv(e.disparity_plane_jacobian(camera))
        looks.append(Look(np.array([e.height_m, e.pitch_rad, e.roll_rad]), back @ noise @ back.T))
    return looks


def markdown(name: str, frames: int, report: Mapping[str, Any]) -> str:
    """The tables and what they show."""
    lines = ["# The filter against the truth", "", f"Drive: {name}, {frames} frames.", ""]
    if "planes_of_known_noise" not in report:
        return (
            "\n".join([*lines, "The extrinsics of this drive are not known: nothing to judge the filter by."])
            + "\n"
        )
    for method in METHODS:
        lines += [f"## Method `{method}`, {report[method]['n']} frames", ""]
        if report[method]["n"] == 0:
            lines += ["No frame showed its road: nothing to judge the filter by.", ""]
            continue
        lines += [*_table(report[method]), "", verdict(method, report[method]), ""]
    lines += [
        "## What the U is for",
        "",
        "The measurement is the plane in disparity space, nonlinear in height, pitch and roll. A linear filter takes",
        "height, pitch and roll themselves for normal. The drive itself, seen through planes of known noise:",
        "",
        "| sigma of a single height, m | error by the UKF, m | by the linear filter, m | linear / UKF |",
        "|---|---|---|---|",
    ]
    for row in report["planes_of_known_noise"]:
        lines.append(
            f"| {row['height_sigma_m']:.3f} | {row['ukf_rmse_m']:.4f} | {row['linear_rmse_m']:.4f} "
            f"| {row['linear_over_ukf']:.3f} +- {row['linear_over_ukf_sigma']:.3f} |"
        )
    return "\n".join([*lines, "", linear_verdict(report)]) + "\n"


def _table(block: Mapping[str, Any]) -> list[str]:
    lines = [
        "| | height mm | pitch deg | roll deg | ratio to a single pair | within 1 sigma | within 2 sigma |",
        "|---|---|---|---|---|---|---|",
    ]
    for name in ("raw", "filtered", "smoothed"):
        part = block[name]
        h, p, r = (part["rmse"][axis] for axis in AXES)
        ratio = "" if name == "raw" else _three(part["ratio"], ".2f")
        once, twice = (_three(part[f"within_{times}_sigma"], ".0%") for times in (1, 2))
        lines.append(f"| {name} | {1e3 * h:.2f} | {p:.4f} | {r:.4f} | {ratio} | {once} | {twice} |")
    return lines


def _three(row: Mapping[str, float | None], spec: str) -> str:
    return " / ".join("-" if row[axis] is None else format(row[axis], spec) for axis in AXES)


def verdict(method: str, block: Mapping[str, Any]) -> str:
    """What the filter gains, and whether its sigma may be believed."""
    ratios = block["filtered"]["ratio"]
    worse = [axis.split("_")[0] for axis in AXES if ratios[axis] > 1.0]
    gain = f"{' and '.join(worse)} worse" if worse else "nothing worse"
    twice = min(v for name in ("filtered", "smoothed") for v in block[name]["within_2_sigma"].values())
    return (
        f"The filter makes {gain} than in single pairs (largest ratio {max(ratios.values()):.2f}). At least "
        f"{twice:.0%} of the errors of filter and smoother are within two sigma on every axis (95 % were they normal)."
    )


def linear_verdict(report: Mapping[str, Any]) -> str:
    """Where a linear filter is worse, on the drive itself and on planes of known noise."""
    said = []
    for method in METHODS:
        if report[method]["n"] == 0:
            continue
        linear = report[method]["linear"]
        apart = _three(linear["most_apart"], ".4f")
        said.append(f"On the drive, `{method}`: the two differ by at most {apart} (m / deg / deg)")
        if linear["frames_apart"]:
            ours, theirs = linear["ukf_rmse_there"]["height_m"], linear["rmse_there"]["height_m"]
            said[-1] += (
                f", by more than 1 mm or 0.01 deg in {linear['frames_apart']} frames, where the height is off by "
                f"{1e3 * ours:.2f} mm by the UKF and {1e3 * theirs:.2f} mm by the linear filter"
            )
        said[-1] += "."
    worse = [
        row
        for row in report["planes_of_known_noise"]
        if row["linear_over_ukf"] - 2.0 * row["linear_over_ukf_sigma"] > 1.0
    ]
    if worse:
        said.append(
            f"With planes of known noise the linear filter is measurably worse from a sigma of "
            f"{worse[0]['height_sigma_m']:.3f} m on, {worse[-1]['linear_over_ukf']:.2f} times at the largest."
        )
    else:
        said.append("At no noise that was tried is the linear filter measurably worse.")
    return " ".join(said)


def figure(in_sigmas: Mapping[str, Array]) -> Figure:
    """Which share of the errors is within so many sigma, beside the normal distribution's."""
    result = Figure(figsize=(13, 4), layout="constrained")
    at = np.linspace(0.0, 4.0, 81)
    for axis, (name, axes) in enumerate(zip(AXES, result.subplots(1, 3, sharey=True), strict=True)):
        for label, score in in_sigmas.items():
            axes.plot(at, (np.abs(score[:, axis])[:, None] < at).mean(axis=0), label=label)
        axes.plot(at, [math.erf(x / math.sqrt(2.0)) for x in at], "k:", label="normal")
        axes.set(title=name.split("_")[0], xlabel="sigma", ylabel="share of the errors within")
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8)
    return result
