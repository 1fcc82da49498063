"""`make bench`: speeds as ratios to a yardstick measured in the same run, so that a busy machine does not lie.

The yardstick is OpenCV's SGBM_3WAY on one full-size pair (128 disparities, block 5, P1 200, P2 800, two
threads), interleaved with what is measured. Figures are medians of wall time; CPU is that of the whole process, per
pair, so that what runs on several cores at once is counted in full.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import cv2
import numpy as np

from stereocalib_core.back.analyse import analyse_openly
from stereocalib_core.back.odometry.packing import pack_tracks
from stereocalib_core.back.odometry.trajectory import TrajectorySettings, trajectory
from stereocalib_core.config import Method, PipelineConfig
from stereocalib_core.frames import FrameSource, StereoFrame
from stereocalib_core.front.matching import find_matcher
from stereocalib_core.front.rows.self_check import examine
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


@dataclass(frozen=True)
class Cost:
    """Milliseconds per pair: wall, and CPU of all threads together."""

    wall_ms: float
    cpu_ms: float

    def over(self, yardstick: Cost) -> dict[str, float]:
        """With the ratios to the yardstick, as `--json` has it: wall and CPU to its wall time, and CPU to its own CPU.

        The yardstick uses two cores as well as it can, so that its CPU is more than its wall time.
        """
        base = yardstick.wall_ms
        return {
            "wall_ms": round(self.wall_ms, 3), "cpu_ms": round(self.cpu_ms, 3),
            "wall_ratio": round(self.wall_ms / base, 4), "cpu_ratio": round(self.cpu_ms / base, 4),
            "cpu_over_cpu": round(self.cpu_ms / yardstick.cpu_ms, 4),
        }  # fmt: skip


def cost(call: Callable[[int], object], count: int) -> Cost:
    """Of `call(k)`, k = 0...count - 1, after two more to warm up: median wall time, mean CPU."""
    for k in range(2):
        call(k)
    walls, cpu = [], time.process_time()
    for k in range(count):
        walls.append(_timed_ms(lambda k=k: call(k)))  # type: ignore[misc]
    return Cost(float(np.median(walls)), 1e3 * (time.process_time() - cpu) / count)


def stages(source: FrameSource, pairs: Sequence[StereoFrame]) -> dict[str, Cost]:
    """What stands alone in the front end, each stage by itself over all pairs."""
    config = PipelineConfig()
    whole = [(p.index, p.left, p.right) for p in pairs if p.left is not None and p.right is not None]
    matcher = find_matcher(config.disparity.matcher)
    calls: dict[str, Callable[[int], object]] = {
        "decode": lambda k: source[whole[k][0]],
        "disparity": lambda k: matcher(whole[k][1], whole[k][2], source.camera, config.disparity),
        "rows": lambda k: examine(source.camera, whole[k][1], whole[k][2], config.rectification),
    }
    return {name: cost(call, len(whole)) for name, call in calls.items()}


def front_end(source: FrameSource, config: PipelineConfig, frames: int) -> tuple[Cost, list[FrameResult]]:
    """The whole front end as `run` has it, decoding included, once it is under way; and the results."""
    first, began, cpu, results = min(4, frames), time.perf_counter(), time.process_time(), []
    for step in follow(source, config, 0, frames):
        results.append(step.done.result)
        if len(results) == first:
            began, cpu = time.perf_counter(), time.process_time()
    count = max(frames - first, 1)
    spent = 1e3 * (time.perf_counter() - began), 1e3 * (time.process_time() - cpu)
    return Cost(spent[0] / count, spent[1] / count), results


def on_one_core(spec: str, method: str, frames: int) -> Cost:
    """The same in a process of its own that may use one core only."""
    code = (
        "import os, sys; os.sched_setaffinity(0, {min(os.sched_getaffinity(0))});"
        "import cv2; cv2.setNumThreads(1);"
        "from stereocalib_core.benches import front_end as b; from stereocalib_core.sources import open_source;"
        "from stereocalib_core.config import PipelineConfig;"
        f"c, _ = b.front_end(open_source({spec!r}), PipelineConfig(method={method!r}), {frames});"
        "print(c.wall_ms, c.cpu_ms)"
    )
    environment = {**os.environ, "NUMBA_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, check=True, capture_output=True, text=True
    )
    wall, cpu = map(float, done.stdout.split())
    return Cost(wall, cpu)


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
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures there too")
    given = parser.parse_args(arguments)
    source = open_source(given.source)
    cv2.setNumThreads(2)
    frames = min(len(source), 60)
    pairs = [source[i] for i in range(frames)]  # a synthetic drive is rendered before anything is timed
    yardstick = _yardstick(next(p for p in pairs if p.left is not None))
    methods: tuple[Method, ...] = ("direct", "paper")
    costs: dict[str, Cost] = {}
    before = cost(lambda k: yardstick(), CALLS)
    costs |= stages(source, pairs)
    results: list[FrameResult] = []
    for method in methods:
        costs[f"front end, {method}"], results = front_end(source, PipelineConfig(method=method), frames)
        between = cost(lambda k: yardstick(), CALLS)
        if hasattr(os, "sched_setaffinity"):
            costs[f"front end, {method}, one core"] = on_one_core(given.source, method, frames)
    after = cost(lambda k: yardstick(), CALLS)
    base = Cost(
        *(float(np.median([getattr(c, f.name) for c in (before, between, after)])) for f in fields(Cost))
    )
    name = Path(source.name).name
    lines = [
        f"{name}: {source.camera.width}x{source.camera.height}, {frames} pairs, over the yardstick's wall time and CPU",
        f"{'':<34}{'wall ms':>9}{'/ wall':>9}{'CPU ms':>9}{'/ wall':>9}{'/ CPU':>9}",
    ]
    for what, spent in {"yardstick, SGBM_3WAY full size": base, **costs}.items():
        ratio = spent.over(base)
        wall, cpu, own = (f"{ratio[key]:9.2f}" for key in ("wall_ratio", "cpu_ratio", "cpu_over_cpu"))
        lines.append(f"{what:<34}{spent.wall_ms:9.1f}{wall}{spent.cpu_ms:9.1f}{cpu}{own}")
    recompute = {count: _recompute_ms(source, results, count) for count in (1100, 4500)}
    lines += [f"{f'one variant of {count} frames':<34}{ms:9.1f}" for count, ms in recompute.items()]
    rate = _render_rate(RENDER_SPEC)
    lines.append(f"{'rendering, pairs a second':<34}{rate:9.1f}")
    sys.stdout.write("\n".join(lines) + "\n")
    if given.json is not None:
        figures = {
            "source": given.source, "pairs": frames, "yardstick": dataclasses.asdict(base),
            "costs": {what: spent.over(base) for what, spent in costs.items()},
            "one_variant_ms": recompute, "rendered_pairs_per_second": rate,
        }  # fmt: skip
        given.json.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
