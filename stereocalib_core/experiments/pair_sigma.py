"""Does the pair's sigma hold? `python -m stereocalib_core.experiments.pair_sigma [--seeds FIRST:END] [--frames N]`

Every seed is a rendered drive, `town` and `curves` in turn, whose right camera is turned by a yaw drawn for it, small
ones as often as large ones. The whole drive is asked for the yaw, and pieces of it, each by itself as a short drive.
Counted is how many errors lie within one and two sigma (Gaussian: 68 and 95 %).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stereocalib_core.back.analyse import analyse
from stereocalib_core.config import PipelineConfig
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.run.calibrate import follow
from stereocalib_core.sources import open_source

FRESH = range(5000, 5032)
"""Seeds that no number was chosen on (`config.pair` says which those were)."""
YAWS_DEG = (0.006, 0.25)
PIECES = ((120, 80), (80, 60))
"""Frames of a piece, and from where to where the next begins."""


@dataclass(frozen=True)
class Coverage:
    """errors, sigmas: (N,) [deg] of N drives of `frames` frames; unmeasured ones are NaN."""

    frames: int
    errors: Array
    sigmas: Array

    def within(self, sigmas: float) -> float:
        """Share of the errors within so many sigma; one that is not measured lies in none."""
        return float(np.mean(np.abs(self.errors) <= sigmas * self.sigmas))

    def rms(self) -> float:
        """Root mean square of error over sigma; 1 where sigma holds."""
        return float(np.sqrt(np.nanmean((self.errors / self.sigmas) ** 2)))


def course_of(seed: int) -> tuple[str, float]:
    """Course and yaw [deg] of a seed; the logarithm of the yaw is uniform, its sign a coin's."""
    rng = np.random.default_rng(seed)
    sign = rng.choice([-1.0, 1.0])
    return ("town", "curves")[seed % 2], round(float(sign * np.exp(rng.uniform(*np.log(YAWS_DEG)))), 4)


def pieces_of(frames: int) -> list[tuple[int, int]]:
    """The whole drive, and the pieces that fit into it: first frame and the one after the last."""
    found = [(0, frames)]
    for length, step in PIECES:
        if length < frames:
            found += [(first, first + length) for first in range(0, frames - length + 1, step)]
    return found


def measure(seeds: Sequence[int], frames: int) -> list[Coverage]:
    """Coverage of drives of each length, the longest first; a line on stderr as each drive is done."""
    errors: dict[int, list[tuple[float, float]]] = {}
    config = PipelineConfig()
    for done, seed in enumerate(seeds):
        course, yaw = course_of(seed)
        source = open_source(f"synthetic:{course}?frames={frames}&seed={seed}&fault=rectification:yaw={yaw}")
        results = [step.done.result for step in follow(source, config)]
        for first, end in pieces_of(frames):
            found = analyse(results[first:end], source.camera, config).pair.relative_yaw_rad
            value, sigma = (np.nan, np.nan) if found is None else np.rad2deg([found.value, found.sigma])
            errors.setdefault(end - first, []).append((value - yaw, sigma))
        sys.stderr.write(f"\rdrive {done + 1} of {len(seeds)}")
    sys.stderr.write("\n")
    return [Coverage(length, *np.array(pairs).T) for length, pairs in errors.items()]


def table(coverages: Sequence[Coverage]) -> str:
    """As Markdown, a row for each length of drive."""
    lines = [
        "| frames | drives | within 1 sigma [%] | within 2 sigma [%] | rms of error / sigma | rms of error [deg] | "
        "median sigma [deg] |",
        "|---" * 7 + "|",
    ]
    for one in coverages:
        lines.append(
            f"| {one.frames} | {len(one.errors)} | {100 * one.within(1.0):.0f} | {100 * one.within(2.0):.0f} | "
            f"{one.rms():.2f} | {np.sqrt(np.nanmean(one.errors**2)):.5f} | {np.nanmedian(one.sigmas):.5f} |"
        )
    return "\n".join(lines) + "\n"


def main(words: Sequence[str] | None = None) -> None:
    """Render, measure, count, print."""
    parser = argparse.ArgumentParser(prog="pair_sigma", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", default=f"{FRESH.start}:{FRESH.stop}", help="FIRST:END, END not included")
    parser.add_argument("--frames", type=int, default=200, help="of each drive")
    arguments = parser.parse_args(words)
    first, end = (int(word) for word in arguments.seeds.split(":"))
    sys.stdout.write(table(measure(range(first, end), arguments.frames)))


if __name__ == "__main__":
    main()
