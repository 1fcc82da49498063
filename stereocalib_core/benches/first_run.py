"""`make bench-first`: the first run on a machine, with everything to compile, and the one after it.

Seconds from the command to its first frame in the checkpoint and to its end, and CPU of all processes together. The
second run is the same with what the first has compiled.
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

from stereocalib_core.errors import OutputError
from stereocalib_core.files.frames_bin import read_frames
from stereocalib_core.run.drive import CHECKPOINT

LOOK_S = 0.05
"""Between two looks at the checkpoint."""


@dataclass(frozen=True)
class First:
    """Seconds from the command to the first frame and to the end; cpu_s: of all its processes."""

    frame_s: float
    end_s: float
    cpu_s: float


def frames_done(checkpoint: Path) -> int:
    """How many frames a run has written so far."""
    try:
        return len(read_frames(checkpoint)[1])
    except OutputError:
        return 0


def measure(source: str, frames: int, folder: Path, name: str) -> First:
    """One run with the caches of `folder`."""
    out = folder / name
    caches = {"NUMBA_CACHE_DIR": str(folder / "numba"), "STEREOCALIB_CACHE": str(folder / "cache")}
    command = [sys.executable, "-m", "stereocalib_app.cli.main", "run", source, "--out", str(out)]
    times, began, first = os.times(), time.perf_counter(), None
    with subprocess.Popen(
        [*command, "--frames", f"0:{frames}"],
        env={**os.environ, **caches},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        while process.poll() is None:
            if first is None and frames_done(out / CHECKPOINT):
                first = time.perf_counter() - began
            time.sleep(LOOK_S)
        said = process.stderr.read() if process.stderr else ""
    if process.returncode not in (0, 3):
        raise SystemExit(said)
    end, now = time.perf_counter() - began, os.times()
    spent = now.children_user + now.children_system - times.children_user - times.children_system
    return First(end if first is None else first, end, spent)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(prog="make bench-first", description=__doc__)
    parser.add_argument("source", nargs="?", default="synthetic:town?frames=20")
    parser.add_argument("--frames", type=int, default=20)
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="stereocalib-bench-") as folder:
        for name in ("first", "second"):
            spent = measure(options.source, options.frames, Path(folder), name)
            sys.stdout.write(
                f"{name:<7} first frame after {spent.frame_s:5.1f} s, end after {spent.end_s:5.1f} s"
                f" {spent.cpu_s:7.1f} s CPU\n"
            )
            sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
