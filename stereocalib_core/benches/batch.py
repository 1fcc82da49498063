"""`make bench-batch`: how much faster two workers of a batch are than one, and whether they give the same results.

Every pass starts from nothing: an empty output folder and, for synthetic drives, an empty cache of pictures. The
passes run as a user would run them, by the command line, start of the workers and summary included. CPU is that of all
processes together: what two workers take more of it than one is what they cost each other.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from stereocalib_core.files.run_folder import RESULT_FILES
from stereocalib_core.run.batch import drive_names, full_spec, usable_cores
from stereocalib_core.system.compiled import known_also_in
from stereocalib_core.system.whole_file import read_json

OF_THE_MOMENT = ("source", "timing_ms", "frames_per_second")
BY_ONE_RUN = "one `run` after another"


def default_sources(drives: int, frames: int) -> list[str]:
    """Short synthetic drives, each another world."""
    return [f"synthetic:straight?seed={seed}&frames={frames}" for seed in range(1, drives + 1)]


@dataclass(frozen=True)
class Pass:
    """Seconds: wall, and CPU of all processes."""

    wall_s: float
    cpu_s: float


def _cpu_s() -> float:
    """CPU of all processes that this one has waited for."""
    times = os.times()
    return times.children_user + times.children_system


def timed(arguments: Sequence[str], cache: Path) -> Pass:
    """One call of the command line; exit code 3 is a result like any other. cache: empty but for what is compiled."""
    known_also_in(cache)
    began, cpu = time.perf_counter(), _cpu_s()
    done = subprocess.run(
        [sys.executable, "-m", "stereocalib_app.cli.main", *arguments],
        env={**os.environ, "STEREOCALIB_CACHE": str(cache)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        check=False,
    )
    if done.returncode not in (0, 3):
        raise SystemExit(done.stderr)
    return Pass(time.perf_counter() - began, _cpu_s() - cpu)


def _content(path: Path) -> object:
    """The bytes of a file; of a report, everything but what is of the moment."""
    if not path.is_file():
        return None
    if path.name != "report.json":
        return path.read_bytes()
    return {key: value for key, value in read_json(path).items() if key not in OF_THE_MOMENT}


def different_files(first: Path, second: Path) -> list[str]:
    """The results of the drives in `first` that are not the same in `second`, bit for bit."""
    names = [path.relative_to(first) for path in sorted(first.glob("*/*")) if path.name in RESULT_FILES]
    return [str(name) for name in names if _content(first / name) != _content(second / name)]


def measure(sources: Sequence[str], workers: Sequence[int], folder: Path, runs: bool) -> dict[str, Pass]:
    """Every pass by name; the first is the reference of the results. runs: `run` is the first."""
    passes: dict[str, Pass] = {}
    reference = folder / "run"
    if runs:
        alone = [
            timed(["run", source, "--out", str(reference / name)], folder / "cache-run")
            for source, name in zip(sources, drive_names(list(sources)), strict=True)
        ]
        passes[BY_ONE_RUN] = Pass(sum(p.wall_s for p in alone), sum(p.cpu_s for p in alone))
    for count in workers:
        out = folder / f"workers-{count}"
        arguments = ["batch", *sources, "--out", str(out), "--workers", str(count)]
        passes[f"--workers {count}"] = timed(arguments, folder / f"cache-{count}")
        reference = reference if len(passes) > 1 else out
        differing = different_files(reference, out)
        if differing:
            raise SystemExit(f"not the same with {count} workers as before: {', '.join(differing[:5])}")
    return passes


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(prog="make bench-batch", description=__doc__)
    parser.add_argument("sources", metavar="SOURCE", nargs="*", help="default: 12 short synthetic drives")
    parser.add_argument("--drives", type=int, default=12)
    parser.add_argument("--frames", type=int, default=40)
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--workers-only", action="store_true", help="no `run` of each drive before")
    options = parser.parse_args(arguments)
    sources = [full_spec(spec) for spec in options.sources]
    sources = sources or default_sources(options.drives, options.frames)
    with tempfile.TemporaryDirectory(prefix="stereocalib-bench-") as folder:
        passes = measure(sources, options.workers, Path(folder), not options.workers_only)
    one = passes[f"--workers {options.workers[0]}"]
    sys.stdout.write(f"batch of {len(sources)} drives, {len(usable_cores())} cores\n")
    for name, spent in passes.items():
        faster = one.wall_s / spent.wall_s
        sys.stdout.write(
            f"{name:<26} {spent.wall_s:7.1f} s   {faster:.2f} times as fast {spent.cpu_s:7.1f} s CPU\n"
        )
    sys.stdout.write("the same results in every pass, bit for bit\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
