"""Does the synthetic drive look real to an algorithm? `python -m stereocalib_core.experiments.realism SOURCE...`

For every drive: the share of valid disparities, the share of the free map, corners on the road in a frame, and
how often the picture's gradient is weak or strong; then the synthetic drive against the mean of the real ones.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from stereocalib_core.config import PipelineConfig
from stereocalib_core.errors import StereoCalibError
from stereocalib_core.frames import FrameSource
from stereocalib_core.front.road.estimate import estimate_road
from stereocalib_core.sources import open_source

GRADIENT_EDGES = (0.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, np.inf)
"""Grey levels per pixel; bins of the histogram."""
NAMES = (
    "valid disparities",
    "free map",
    "road corners",
    *(f"gradient {a:g}-{b:g}" for a, b in zip(GRADIENT_EDGES[:-1], GRADIENT_EDGES[1:], strict=True)),
)
_CORNER_QUALITY, _CORNER_DISTANCE_PX = 0.01, 7
FACTOR = 1.5


@dataclass(frozen=True)
class Realism:
    """One drive's statistics, the mean over its frames: values (len(NAMES),); frames used."""

    source: str
    values: NDArray[np.float64]
    frames: int


def picture_statistics(
    left: NDArray[np.uint8], right: NDArray[np.uint8], source: FrameSource
) -> NDArray[np.float64]:
    """(len(NAMES),) of one stereo pair; NaN where there is no road."""
    result = estimate_road(left, right, source.camera, PipelineConfig())
    values = np.full(len(NAMES), np.nan)
    if result.matched is not None:
        values[0] = float(np.mean(result.disparity.values > 0))
    if result.free_fraction is not None:
        values[1] = result.free_fraction
    if result.road is not None:
        height, width = left.shape
        mask = np.zeros((height, width), np.uint8)
        grown = cv2.resize(result.road.astype(np.uint8), None, fx=2, fy=2, interpolation=cv2.INTER_NEAREST)
        mask[: grown.shape[0], : grown.shape[1]] = grown[:height, :width]
        corners = cv2.goodFeaturesToTrack(left, 20000, _CORNER_QUALITY, _CORNER_DISTANCE_PX, mask=mask)
        values[2] = 0.0 if corners is None else len(corners)
    smooth = left.astype(np.float32)
    gradient = np.hypot(
        cv2.Sobel(smooth, cv2.CV_32F, 1, 0, scale=1 / 8), cv2.Sobel(smooth, cv2.CV_32F, 0, 1, scale=1 / 8)
    )
    counts, _ = np.histogram(gradient, np.array(GRADIENT_EDGES))
    values[3:] = counts / gradient.size
    return values


def measure(source: FrameSource, frames: int = 25) -> Realism:
    """A drive's statistics over `frames` frames spread evenly."""
    picks = np.unique(np.linspace(0, len(source) - 1, min(frames, len(source))).round().astype(int))
    rows = []
    for i in picks:
        frame = source[int(i)]
        if frame.left is not None and frame.right is not None:
            rows.append(picture_statistics(frame.left, frame.right, source))
    return Realism(source.name, np.nanmean(np.array(rows), axis=0), len(rows))


def table(synthetic: Realism, real: Sequence[Realism]) -> str:
    """Markdown: every statistic of every drive, the mean of the real ones, and the synthetic drive's ratio to it."""
    mean = np.mean([r.values for r in real], axis=0)
    head = [
        "statistic",
        *(r.source for r in real),
        "mean of the real",
        synthetic.source,
        "ratio",
        f"within {FACTOR:g}",
    ]
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for k, name in enumerate(NAMES):
        ratio = synthetic.values[k] / mean[k]
        digits = 0 if k == 2 else 4
        numbers = [f"{r.values[k]:.{digits}f}" for r in real]
        verdict = "yes" if 1 / FACTOR <= ratio <= FACTOR else "no"
        cells = [
            name,
            *numbers,
            f"{mean[k]:.{digits}f}",
            f"{synthetic.values[k]:.{digits}f}",
            f"{ratio:.2f}",
            verdict,
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main(arguments: Sequence[str]) -> int:
    """Print the table of the default drive against the recordings named; the exit code."""
    if not arguments:
        sys.stderr.write("usage: python -m stereocalib_core.experiments.realism SOURCE...\n")
        return 2
    try:
        real = [measure(open_source(spec)) for spec in arguments]
        synthetic = measure(open_source("synthetic:town"))
    except StereoCalibError as error:
        sys.stderr.write(f"stereocalib: error: {error}\n")
        return 2
    sys.stdout.write(table(synthetic, real) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
