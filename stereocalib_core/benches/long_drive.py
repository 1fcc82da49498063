"""`make bench-long`: memory and time of long drives, whose frames are those of a short one again and again.

Each length in a process of its own: a short drive through the front end, then its results as so many frames through
the checkpoint, the back end and the files, as `run` does it. What should not grow with the drive is a ratio near 1:
time per frame, and the process's largest memory over that of the first length.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from stereocalib_core.back.analyse import analyse
from stereocalib_core.config import PipelineConfig
from stereocalib_core.files.frame_record import Done
from stereocalib_core.files.frames_bin import Checkpoint, RunKey
from stereocalib_core.files.run_folder import write_run
from stereocalib_core.run.calibrate import follow, told
from stereocalib_core.sources import open_source

DEFAULT_SOURCE = "synthetic:town?frames=60"
PERIOD_S = 0.1
STEPS = ("checkpoint", "read back", "back end", "files")


@dataclass(frozen=True)
class Spent:
    """peak_mb of the process; cpu_ms per frame of each of STEPS."""

    frames: int
    peak_mb: float
    cpu_ms: dict[str, float]


def repeated(short: Sequence[Done], frames: int) -> Iterator[Done]:
    """So many frames: all of the short drive, then all but its first, whose tracks lead nowhere, over and over."""
    for i in range(frames):
        done = short[i if i < len(short) else 1 + (i - len(short)) % (len(short) - 1)]
        tracks = done.result.tracks
        if tracks is not None:
            tracks = dataclasses.replace(tracks, previous=i - 1)
        result = dataclasses.replace(done.result, frame=i, timestamp_s=PERIOD_S * i, tracks=tracks)
        yield dataclasses.replace(done, result=result)


def spend(spec: str, frames: int, folder: Path) -> Spent:
    """A drive of so many frames in this process."""
    source, config = open_source(spec), PipelineConfig()
    short = [step.done for step in follow(source, config, 0, min(len(source), 60))]
    key = RunKey(source.content_key, source.camera, config, None, {}, 0, None, "bench")
    clock = [time.process_time()]
    checkpoint = Checkpoint(folder / "checkpoint.bin", key)
    for done in repeated(short, frames):
        checkpoint.append(done)
    clock.append(time.process_time())
    again = checkpoint[:]
    clock.append(time.process_time())
    drive = analyse([done.result for done in again], source.camera, config)
    clock.append(time.process_time())
    write_run(told(drive, spec, source, again, 1.0), folder)
    clock.append(time.process_time())
    checkpoint.close()
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (
        1024.0**2 if sys.platform == "darwin" else 1024.0
    )
    each = [1e3 * (b - a) / frames for a, b in zip(clock[:-1], clock[1:], strict=True)]
    return Spent(frames, peak_mb, dict(zip(STEPS, each, strict=True)))


def _in_a_process(spec: str, frames: int) -> Spent:
    command = [
        sys.executable,
        "-m",
        "stereocalib_core.benches.long_drive",
        "--source",
        spec,
        "--alone",
        str(frames),
    ]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    return Spent(**json.loads(done.stdout))


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(prog="make bench-long", description=__doc__)
    parser.add_argument("--source", default=DEFAULT_SOURCE, help="its first 60 frames are repeated")
    parser.add_argument("--frames", type=int, nargs="+", default=[1000, 10_000, 36_000])
    parser.add_argument("--alone", type=int, help=argparse.SUPPRESS)
    given = parser.parse_args(arguments)
    if given.alone is not None:
        with tempfile.TemporaryDirectory(prefix="stereocalib-bench-") as folder:
            sys.stdout.write(json.dumps(dataclasses.asdict(spend(given.source, given.alone, Path(folder)))))
        return 0
    source = open_source(given.source)
    for i in range(min(len(source), 60)):
        source[i]  # a synthetic drive is rendered before anything is measured
    first: Spent | None = None
    sys.stdout.write(
        f"{'frames':>7}{'peak MB':>9}{'':>7}{'CPU ms a frame':>16}   of which {', '.join(STEPS)}\n"
    )
    for frames in given.frames:
        spent = _in_a_process(given.source, frames)
        first = first or spent
        total, before = sum(spent.cpu_ms.values()), sum(first.cpu_ms.values())
        steps = ", ".join(f"{spent.cpu_ms[step]:.2f}" for step in STEPS)
        sys.stdout.write(
            f"{frames:7d}{spent.peak_mb:9.0f}{spent.peak_mb / first.peak_mb:6.2f}x{total:10.2f}{total / before:5.2f}x"
            f"   {steps}\n"
        )
        sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
