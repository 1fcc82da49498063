"""`make bench`: speeds as ratios to a yardstick measured in the same run, so that a busy machine does not lie.

The yardstick is OpenCV's SGBM_3WAY on one full-size pair (128 disparities, block 5, P1 200, P2 800, two
threads), interleaved with what is measured; every figure is the median.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np

from stereocalib_core.back.analyse import analyse_openly
from stereocalib_core.back.odometry.packing import pack_tracks
from stereocalib_core.back.odometry.trajectory import TrajectorySettings, trajectory
from stereocalib_core.config import Method, PipelineConfig
from stereocalib_core.frames import FrameSource, StereoFrame
from stereocalib_core.front.pipeline import look_at_pair
from stereocalib_core.results import FrameResult, Tracks
from stereocalib_core.run.calibrate import follow
from stereocalib_core.sources import open_source

CALLS = 20
DEFAULT_SOURCE = "synthetic:town?frames=60"
RENDER_SPEC = "synthetic:town?frames=48&seed=90210"


def _timed_ms(call: Callable[[], object]) -> float:
    began = time.perf_counter()
    call()
    return 1e3 * (time.perf_counter() - began)


def _yardstick(frame: StereoFrame) -> Callable[[], object]:
    matcher = cv2.StereoSGBM.create(
        minDisparity=0, numDisparities=128, blockSize=5, P1=200, P2=800, mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY
    )
    left, right = frame.left, frame.right
    assert left is not None and right is not None
    return lambda: matcher.compute(left, right)


def _chain(source: FrameSource, method: Method, frames: Sequence[int]) -> Callable[[int], object]:
    """Decode to extrinsics of one frame, the pair's self-check included."""
    config = PipelineConfig(method=method)

    def call(k: int) -> object:
        frame = source[frames[k % len(frames)]]
        if frame.left is None or frame.right is None:
            return None
        return look_at_pair(source.camera, frame.left, frame.right, config)

    return call


def _throughput_ms(source: FrameSource, frames: int) -> tuple[float, list[FrameResult]]:
    """Milliseconds per frame of the whole front end, reading ahead as `run` does; and the results."""
    first, began, results = min(4, frames), time.perf_counter(), []
    for step in follow(source, PipelineConfig(), 0, frames):
        results.append(step.done.result)
        if len(results) == first:
            began = time.perf_counter()
    return 1e3 * (time.perf_counter() - began) / max(frames - first, 1), results


def _recompute_ms(source: FrameSource, results: list[FrameResult], frames: int) -> float:
    """Median time of one variant over a drive of `frames` frames, made by repeating the results at hand."""
    _, workings = analyse_openly(results, source.camera, PipelineConfig())
    order = np.arange(frames) % len(results)
    tracks = pack_tracks(
        source.camera,
        [None if i == 0 or order[i] == 0 else _moved(results[order[i]], i) for i in range(frames)],
        np.ones(frames, dtype=bool),
        list(range(frames)),
    )
    extrinsics = workings.extrinsics[order]
    trajectory(tracks, extrinsics, TrajectorySettings())
    settings = [TrajectorySettings(pitch_error_rad=1e-4 * k) for k in range(CALLS)]
    return float(np.median([_timed_ms(lambda s=s: trajectory(tracks, extrinsics, s)) for s in settings]))  # type: ignore[misc]


def _moved(result: FrameResult, frame: int) -> Tracks | None:
    """The tracks of a result as if they led from frame - 1 to frame."""
    return None if result.tracks is None else dataclasses.replace(result.tracks, previous=frame - 1)


def _render_rate(spec: str) -> float:
    """Stereo pairs rendered per second from an empty cache."""
    from stereocalib_core.simulator.settings import parse_spec
    from stereocalib_core.simulator.studio import Studio
    from stereocalib_core.sources.formats.synthetic import SyntheticSource

    studio = Studio(parse_spec(spec))
    studio.pictures(0)
    count = len(SyntheticSource(parse_spec(spec)))
    began = time.perf_counter()
    for i in range(1, count):
        studio.pictures(i)
    return (count - 1) / (time.perf_counter() - began)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print; the exit code is 0 whatever the figures are."""
    parser = argparse.ArgumentParser(prog="make bench", description=__doc__)
    parser.add_argument("--source", default=DEFAULT_SOURCE, help="any SOURCE of `stereocalib run`")
    source = open_source(parser.parse_args(arguments).source)
    write = sys.stdout.write
    cv2.setNumThreads(2)
    frames = list(range(min(len(source), 60)))
    pairs = [source[i] for i in frames]  # a synthetic drive is rendered before anything is timed
    yardstick = _yardstick(next(p for p in pairs if p.left is not None))
    methods: tuple[Method, ...] = ("paper", "direct")
    chains = {method: _chain(source, method, frames) for method in methods}
    times: dict[str, list[float]] = {"yardstick": [], **{m: [] for m in methods}}
    for k in range(-2, CALLS):
        for name, call in (("yardstick", lambda k: yardstick()), *chains.items()):
            elapsed = _timed_ms(lambda call=call, k=k: call(k + 2))  # type: ignore[misc]
            if k >= 0:
                times[name].append(elapsed)
    base = float(np.median(times["yardstick"]))
    write(f"{Path(source.name).name}: {source.camera.width}x{source.camera.height}, {len(frames)} frames\n")
    write(f"yardstick, SGBM_3WAY full size   {base:8.1f} ms   1.00\n")
    for method in methods:
        value = float(np.median(times[method]))
        write(f"decode to extrinsics, {method:<8}   {value:8.1f} ms   {value / base:.2f}\n")
    per_frame, results = _throughput_ms(source, len(frames))
    after = float(np.median([_timed_ms(yardstick) for _ in range(CALLS)]))
    write(
        f"whole front end with tracks      {per_frame:8.1f} ms   {per_frame / (0.5 * (base + after)):.2f}\n"
    )
    for count in (1100, 4500):
        write(f"one variant of {count} frames      {_recompute_ms(source, results, count):8.1f} ms\n")
    write(f"rendering                        {_render_rate(RENDER_SPEC):8.1f} stereo pairs a second\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
