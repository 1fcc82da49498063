"""`make bench`: what the pair's own calibration costs over a long drive, and what a LiDAR scan costs in the front end.

CPU of the whole process beside wall time, since only the former says the same on a busy machine.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
import time
from collections.abc import Sequence

import numpy as np

from stereocalib_core.back.odometry.packing import pack
from stereocalib_core.back.rig.pair import summarise
from stereocalib_core.back.rig.pair_calibration import calibrate_pair
from stereocalib_core.config import PipelineConfig
from stereocalib_core.frames import FrameSource
from stereocalib_core.front.pipeline import FrontEnd
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.results import FrameResult
from stereocalib_core.sources import open_source

DEFAULT_SOURCE = "synthetic:town?frames=40&lidar=1"
CALLS = 5
HEIGHT_M = 1.65
"""Of the camera over the road; what it is changes no time."""


def scans(source: FrameSource, frames: int, config: PipelineConfig) -> tuple[Array, list[FrameResult]]:
    """(S,) CPU [ms] of what the front end does with each scan, and the results with all that the scans said.

    The first scan is done once more before, so that nothing is compiled within what is timed.
    """
    front = FrontEnd(source.camera, config)
    by_scan = FrontEnd(source.camera, config, T_camera_lidar=source.T_camera_lidar)
    spent: list[float] = []
    results: list[FrameResult] = []
    for frame in [source[i] for i in range(frames)]:  # all of them first: a renderer at work would count
        look = front.look(frame)
        result = look.result
        if look.road is not None and frame.lidar is not None:
            if not spent:
                by_scan.with_lidar(frame, look.result, look.road)
            began = time.process_time()
            result = by_scan.with_lidar(frame, look.result, look.road)
            spent.append(1e3 * (time.process_time() - began))
        results.append(result)
    return np.array(spent), results


def repeated(results: Sequence[FrameResult], frames: int, config: PipelineConfig) -> list[FrameResult]:
    """A drive of `frames` frames by the results at hand, again and again; no tracks lead over the seams.

    Of the scans only those speak that the front end would compare in a drive of that length.
    """
    drive = []
    for i in range(frames):
        result = results[i % len(results)]
        tracks = None if i % len(results) == 0 or result.tracks is None else result.tracks
        if tracks is not None:
            tracks = dataclasses.replace(tracks, previous=tracks.previous + i - result.frame)
        seen = result.disparities if config.scan_disparity.wanted(i) else None
        drive.append(
            dataclasses.replace(result, frame=i, timestamp_s=0.1 * i, tracks=tracks, disparities=seen)
        )
    return drive


def pair_cost(
    source: FrameSource, results: Sequence[FrameResult], config: PipelineConfig
) -> tuple[float, float]:
    """Wall time and CPU [s] of `calibrate_pair` over a drive, the medians of `CALLS`."""
    tracks = pack(source.camera, results, config.odometry)
    rows = summarise(source.camera, results, config.rectification)
    walls, cpus = [], []
    for k in range(CALLS + 1):
        wall, cpu = time.perf_counter(), time.process_time()
        calibrate_pair(source.camera, results, tracks, rows, None, HEIGHT_M, config)
        if k:  # the first call finds the motions that the whole back end shares
            walls.append(time.perf_counter() - wall)
            cpus.append(time.process_time() - cpu)
    return float(np.median(walls)), float(np.median(cpus))


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print; the exit code is 0 whatever the figures are."""
    parser = argparse.ArgumentParser(prog="make bench", description=__doc__)
    parser.add_argument(
        "--source", default=DEFAULT_SOURCE, help="any SOURCE of `stereocalib run`, with scans"
    )
    parser.add_argument("--frames", type=int, default=1100, help="of the drive whose pair is calibrated")
    given = parser.parse_args(arguments)
    source, config = open_source(given.source), PipelineConfig()
    spent, results = scans(source, min(len(source), 60), config)
    lines = []
    if len(spent):
        lines.append(
            f"{f'a LiDAR scan, CPU ms, of {len(spent)} scans':<58}median {np.median(spent):.1f}   "
            f"mean {spent.mean():.1f}   max {spent.max():.1f}"
        )
    drive = repeated(results, given.frames, config)
    without = [dataclasses.replace(result, disparities=None) for result in drive]
    for seen, which in ((without, ""), (drive, " with scans")) if len(spent) else ((without, ""),):
        wall, cpu = pair_cost(source, seen, config)
        what = f"the pair's own calibration, {given.frames} frames{which}"
        lines.append(f"{what:<58}wall {wall:.2f} s   CPU {cpu:.2f} s")
    sys.stdout.write("\n".join(lines) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
