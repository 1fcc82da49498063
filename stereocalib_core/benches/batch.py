"""`make bench-batch`: how much faster two workers of a batch are than one, and whether they give the same results.

Every pass starts from nothing: an empty output folder and, for synthetic drives, an empty cache of pictures. The
passes run as a user would run them, by the command line, start of the workers and summary included.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from stereocalib_core.files.run_folder import RESULT_FILES
from stereocalib_core.run.batch import drive_names, full_spec, usable_cores
from stereocalib_core.system.whole_file import read_json

OF_THE_MOMENT = ("source", "timing_ms", "frames_per_second")
BY_ONE_RUN = "one `run` after another"


def default_sources(drives: int, frames: int) -> list[str]:
    """Short synthetic drives, each another world."""
    return [f"synthetic:straight?seed={seed}&frames={frames}" for seed in range(1, drives + 1)]


def timed_s(arguments: Sequence[str], cache: Path) -> float:
    """Wall time of one call of the command line; exit code 3 is a result like any other."""
    began = time.perf_counter()
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
    return time.perf_counter() - began


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


def measure(sources: Sequence[str], workers: Sequence[int], folder: Path) -> dict[str, float]:
    """Seconds of every pass by name; the first is the reference of the results."""
    times: dict[str, float] = {}
    by_run = folder / "run"
    times[BY_ONE_RUN] = sum(
        timed_s(["run", source, "--out", str(by_run / name)], folder / "cache-run")
        for source, name in zip(sources, drive_names(list(sources)), strict=True)
    )
    for count in workers:
        out = folder / f"workers-{count}"
        arguments = ["batch", *sources, "--out", str(out), "--workers", str(count)]
        times[f"--workers {count}"] = timed_s(arguments, folder / f"cache-{count}")
        differing = different_files(by_run, out)
        if differing:
            raise SystemExit(f"not the same with {count} workers as by `run`: {', '.join(differing[:5])}")
    return times


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(prog="make bench-batch", description=__doc__)
    parser.add_argument("sources", metavar="SOURCE", nargs="*", help="default: 12 short synthetic drives")
    parser.add_argument("--drives", type=int, default=12)
    parser.add_argument("--frames", type=int, default=40)
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2])
    options = parser.parse_args(arguments)
    sources = [full_spec(spec) for spec in options.sources]
    sources = sources or default_sources(options.drives, options.frames)
    with tempfile.TemporaryDirectory(prefix="stereocalib-bench-") as folder:
        times = measure(sources, options.workers, Path(folder))
    one = times[f"--workers {options.workers[0]}"]
    sys.stdout.write(f"{len(sources)} drives, {len(usable_cores())} cores\n")
    for name, seconds in times.items():
        sys.stdout.write(f"{name:<26} {seconds:7.1f} s   {one / seconds:.2f} times as fast\n")
    sys.stdout.write("the same results in every pass, bit for bit\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
