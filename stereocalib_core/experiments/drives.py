"""How well the road is measured on rendered drives: `python -m stereocalib_core.experiments.drives [DRIVE[@A:B] ...]`

For every drive, frames A to B (all of them without): how many have a road, the errors of height, pitch and roll over
the plane of the own lane (bias: their median with its sign), and how many lie within one and two of their sigmas.
Without a drive: three courses of three seeds each that no number was fitted to, the first `FRAMES` frames of each.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stereocalib_core.config import PipelineConfig
from stereocalib_core.errors import ConfigError, StereoCalibError
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.run.calibrate import follow
from stereocalib_core.sources.formats.synthetic import SyntheticSource

COURSES = ("town", "curves", "straight")
SEEDS = (11, 23, 42)
FRAMES = 120
HEADER = (
    f"{'drive':32s} {'road':>9s}  {'RMSE mm, deg, deg':>22s}  "
    f"{'median mm, deg, deg':>22s}  {'bias mm, deg, deg':>22s}  {'<1 s':>5s} {'<2 s':>5s}"
)
_UNIT = np.array([1e3, *np.rad2deg([1.0, 1.0])])


@dataclass(frozen=True)
class Judged:
    """frames: looked at. error, sigma: (N, 3) of height [m], pitch, roll [rad] of those with a road."""

    frames: int
    error: Array
    sigma: Array

    def line(self, name: str) -> str:
        """One line of the table under `HEADER`."""
        if not len(self.error):
            return f"{name:32s} {0:4d}/{self.frames:4d}"
        rmse = _UNIT * np.sqrt(np.mean(self.error**2, axis=0))
        median = _UNIT * np.median(np.abs(self.error), axis=0)
        bias = _UNIT * np.median(self.error, axis=0)
        ratio = np.abs(self.error) / self.sigma
        figures = "  ".join("{:6.2f} {:7.4f} {:7.4f}".format(*row) for row in (rmse, median, bias))
        shares = " ".join(f"{np.mean(ratio < k):5.0%}" for k in (1.0, 2.0))
        return f"{name:32s} {len(self.error):4d}/{self.frames:4d}  {figures}  {shares}"


def judge(drive: str, settings: PipelineConfig | None = None) -> Judged:
    """Every frame of a synthetic drive, `synthetic...[@A:B]`, one after the other, against its truth."""
    spec, _, part = drive.partition("@")
    source = SyntheticSource.from_spec(spec)
    truth = source.ground_truth.extrinsics
    assert truth is not None
    first, _, last = part.partition(":")
    if not all(end.isdigit() or not end for end in (first, last)):
        raise ConfigError("no frames", f"@{part}", "write DRIVE@A:B, two frame numbers")
    start, stop = int(first or 0), min(int(last or len(source)), len(source))
    error, sigma = [], []
    for step in follow(source, settings or PipelineConfig(), start, stop):
        road = step.done.result.road
        if road is not None:
            e = road.extrinsics
            error.append(np.array([e.height_m, e.pitch_rad, e.roll_rad]) - truth[step.frame.index, :3])
            sigma.append(road.sigma)
    return Judged(max(stop - start, 0), np.reshape(error, (-1, 3)), np.reshape(sigma, (-1, 3)))


def together(parts: Sequence[Judged]) -> Judged:
    """All of them as one."""
    return Judged(
        sum(part.frames for part in parts),
        np.concatenate([part.error for part in parts]),
        np.concatenate([part.sigma for part in parts]),
    )


def main(drives: Sequence[str]) -> int:
    """Print the table, a line a drive, and the whole where they are several."""
    chosen = list(drives) or [f"synthetic:{c}?seed={s}@0:{FRAMES}" for c in COURSES for s in SEEDS]
    _say(HEADER)
    parts = []
    for drive in chosen:
        try:
            parts.append(judge(drive))
        except StereoCalibError as error:
            sys.stderr.write(f"{error}\n")
            return 2
        _say(parts[-1].line(drive))
    if len(parts) > 1:
        _say(together(parts).line("together"))
    return 0


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
