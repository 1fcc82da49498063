"""Figures 3-6 and tables 1-5 of the second paper, ours beside theirs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from stereocalib_core.experiments.lidar_camera_simulation import ASSUMPTIONS
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.system.whole_file import write_atomic

PAPER_COUNTS = tuple(range(5, 16))
PAPER = {
    "dual_space": {
        "mean": (0.070, 0.053, 0.043, 0.037, 0.032, 0.028, 0.027, 0.023, 0.023, 0.021, 0.021),
        "std": (0.087, 0.045, 0.029, 0.031, 0.022, 0.019, 0.017, 0.013, 0.014, 0.012, 0.012),
    },
    "unnikrishnan_hebert": {
        "mean": (0.072, 0.054, 0.044, 0.039, 0.034, 0.029, 0.028, 0.024, 0.024, 0.022, 0.022),
        "std": (0.092, 0.046, 0.029, 0.032, 0.023, 0.019, 0.017, 0.014, 0.015, 0.013, 0.012),
    },
    "points_on_plane": {
        "mean": (3.080, 0.962, 0.405, 0.219, 0.137, 0.099, 0.077, 0.066, 0.053, 0.047, 0.045),
        "std": (4.420, 1.482, 0.607, 0.291, 0.181, 0.108, 0.073, 0.055, 0.047, 0.035, 0.033),
    },
}
"""Table 2. What the paper prints as "RMS" lies below the mean from 6 boards on, so it is a standard deviation."""
LABELS = {
    "dual_space": "dual space",
    "unnikrishnan_hebert": "Unnikrishnan-Hebert",
    "points_on_plane": "points on plane",
    "weighted": "weighted planes",
    "refined": "refined",
}
COLOURS = {
    "dual_space": "#1f4e79",
    "unnikrishnan_hebert": "#8a5aa8",
    "points_on_plane": "#c0562b",
    "weighted": "#3a7d44",
    "refined": "#111111",
}


def write(out: Path, result: dict[str, Any], samples: dict[int, dict[str, Array]], repeats: int) -> None:
    """lidar-camera.md and lidar-camera-figure-3 ... 6.png."""
    figures = {
        3: _figure_3(result),
        4: _figure_4(samples[11 if 11 in samples else max(samples)]),
        5: _figure_5(result),
        6: _figure_6(result),
    }
    for number, figure in figures.items():
        figure.savefig(out / f"lidar-camera-figure-{number}.png", dpi=110)
    write_atomic(out / "lidar-camera.md", markdown(result, repeats))


def _figure_3(result: dict[str, Any]) -> Figure:
    figure = Figure(figsize=(11, 4.5), layout="constrained")
    for ax, key, title in zip(
        figure.subplots(1, 2), ("mean", "std"), ("mean", "standard deviation"), strict=True
    ):
        for solver, label in LABELS.items():
            ax.semilogy(result["counts"], result[solver][key], "o-", ms=4, color=COLOURS[solver], label=label)
            if solver in PAPER:
                ax.semilogy(PAPER_COUNTS, PAPER[solver][key], "x--", ms=5, lw=0.8, color=COLOURS[solver])
        ax.set_xlabel("boards")
        ax.set_title(f"matrix error, {title} (dashed: paper)")
        ax.grid(True, which="both", alpha=0.25)
        ax.legend(fontsize=8)
    return figure


def _figure_4(at: dict[str, Array]) -> Figure:
    figure = Figure(figsize=(12, 4.2), layout="constrained")
    for ax, column, title in zip(
        figure.subplots(1, 3), (1, 2, 0), ("translation [m]", "rotation", "matrix"), strict=True
    ):
        ax.boxplot(
            [at[s][:, column] for s in LABELS], tick_labels=[LABELS[s] for s in LABELS], showfliers=False
        )
        ax.set_yscale("log")
        ax.set_title(f"{title} error at 11 boards")
        ax.tick_params(axis="x", rotation=30)
        ax.grid(True, axis="y", which="both", alpha=0.25)
    return figure


def _figure_5(result: dict[str, Any]) -> Figure:
    figure = Figure(figsize=(7, 4.5), layout="constrained")
    ax = figure.subplots()
    for solver, label in LABELS.items():
        ax.plot(result["counts"], result["eq7_px"][solver], "o-", ms=4, color=COLOURS[solver], label=label)
    ax.set_xlabel("boards")
    ax.set_ylabel("10 e_L + e_C [px]")
    ax.set_yscale("log")
    ax.set_title("error of eq. 7 on boards without noise that had no say")
    ax.grid(True, which="both", alpha=0.25)
    ax.legend(fontsize=8)
    return figure


def _figure_6(result: dict[str, Any]) -> Figure:
    figure = Figure(figsize=(11, 4.2), layout="constrained")
    for ax, name, title in zip(
        figure.subplots(1, 3), ("translation_m", "rotation", "matrix"), ("translation [m]", "rotation", "matrix"),
        strict=True,
    ):  # fmt: skip
        for solver in ("dual_space", "weighted", "refined"):
            values = result["by_count"][solver][name]
            ax.plot(result["counts"], values, "o-", ms=4, color=COLOURS[solver], label=LABELS[solver])
        ax.set_xlabel("boards")
        ax.set_ylim(bottom=0.0)
        ax.set_title(f"{title} error, mean")
        ax.grid(True, alpha=0.25)
        ax.legend(fontsize=8)
    return figure


def markdown(result: dict[str, Any], repeats: int) -> str:
    """The report: assumptions, table 2 with the paper's numbers, tables 3-5, predicted against observed sigma."""
    counts = result["counts"]
    lines = [
        "# LiDAR and camera by chessboard planes: the simulation of Zheng et al. (2018)",
        "",
        f"{repeats} repeats per number of boards. Errors are spectral norms of the difference from the truth",
        "(eq. 8-10).",
        "",
        "Assumed (table 1 and what it leaves open):",
        *[f"- {text};" for text in ASSUMPTIONS],
        "",
        "## Table 2: matrix error, mean (standard deviation)",
        "",
        "| boards | " + " | ".join(str(c) for c in counts) + " |",
        "|---|" + "---|" * len(counts),
    ]
    for solver, label in LABELS.items():
        row = zip(result[solver]["mean"], result[solver]["std"], strict=True)
        lines.append(f"| {label} | " + " | ".join(f"{m:.3f} ({s:.3f})" for m, s in row) + " |")
        if solver in PAPER:
            theirs = dict(
                zip(PAPER_COUNTS, zip(PAPER[solver]["mean"], PAPER[solver]["std"], strict=True), strict=True)
            )
            cells = [f"{theirs[c][0]:.3f} ({theirs[c][1]:.3f})" if c in theirs else "" for c in counts]
            lines.append(f"| *{label}, paper* | " + " | ".join(cells) + " |")
    lines += [
        "",
        "![error against boards](lidar-camera-figure-3.png)",
        "",
        "## Tables 3-5: errors at 11 boards",
        "",
    ]
    lines += ["| solver | rotation | translation [m] | matrix | matrix, paper |", "|---|---|---|---|---|"]
    for solver, label in LABELS.items():
        mean, std = result["at_11"][solver], result["at_11_std"][solver]
        paper = f"{PAPER[solver]['mean'][6]:.3f} ({PAPER[solver]['std'][6]:.3f})" if solver in PAPER else "-"
        cells = [f"{mean[n]:.4f} ({std[n]:.4f})" for n in ("rotation", "translation_m", "matrix")]
        lines.append(f"| {label} | " + " | ".join(cells) + f" | {paper} |")
    lines += ["", "![errors at 11 boards](lidar-camera-figure-4.png)", ""]
    lines += ["![eq. 7](lidar-camera-figure-5.png)", "", "![three errors](lidar-camera-figure-6.png)", ""]
    lines += ["## Predicted and observed sigma of the refined solution at 11 boards (camera x, y, z)", ""]
    lines += ["| | observed | predicted |", "|---|---|---|"]
    for name, scale, unit in (("rotation_deg", 1.0, "deg"), ("translation_m", 1000.0, "mm")):
        block = result["sigma_at_11"][name]
        cells = [", ".join(f"{scale * v:.3f}" for v in block[k]) for k in ("observed", "predicted")]
        lines.append(f"| {name.split('_')[0]} [{unit}] | {cells[0]} | {cells[1]} |")
    return "\n".join([*lines, *_wrong_intrinsics(result["refined_intrinsics"])]) + "\n"


def _wrong_intrinsics(block: dict[str, Any]) -> list[str]:
    """The table of a wrong K, held and refined."""
    lines = [
        "",
        f"## K off by {100 * block['focal_share']:.0f} % and {block['centre_px']:.0f} px, held and refined (eq. 6-7)",
        "",
        f"{block['repeats']} repeats; matrix error, mean (standard deviation), and what is left of K's errors.",
        "",
        "| boards | " + " | ".join(str(c) for c in block["counts"]) + " |",
        "|---|" + "---|" * len(block["counts"]),
    ]
    for name, label in (("fixed", "K held"), ("refined", "K refined")):
        one = block[name]
        cells = [f"{m:.3f} ({s:.3f})" for m, s in zip(one["mean"], one["std"], strict=True)]
        lines.append(f"| {label} | " + " | ".join(cells) + " |")
        left = zip(one["focal_error_px"], one["centre_error_px"], strict=True)
        lines.append(
            f"| *{label}: focal, centre px* | " + " | ".join(f"{f:.1f}, {c:.1f}" for f, c in left) + " |"
        )
    return lines
