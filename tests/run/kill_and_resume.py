"""Kill `stereocalib run` with SIGKILL at random moments, resume it, and compare with an undisturbed run.

`python tests/kill_and_resume.py SOURCE [--kills 10] [--seed 0] [-- more arguments of run]`
"""

from __future__ import annotations

import argparse
import json
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

OF_THE_MOMENT = ("source", "timing_ms", "frames_per_second")
NOT_COMPARED = ("report.json", "recording.rrd", "frames.bin")


def command(source: str, out: Path, more: Sequence[str]) -> list[str]:
    """The run as a user calls it."""
    return [
        sys.executable,
        "-m",
        "stereocalib_app.cli.main",
        "run",
        source,
        "--out",
        str(out),
        "--resume",
        *more,
    ]


def run(arguments: Sequence[str]) -> None:
    """To the end; exit code 3 is a result like any other."""
    done = subprocess.run(
        arguments, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, check=False
    )
    assert done.returncode in (0, 3), done.stderr


def killed_after(arguments: Sequence[str], delay_s: float) -> bool:
    """Whether there was something left to kill."""
    process = subprocess.Popen(arguments, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        process.wait(delay_s)
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGKILL)
        process.wait()
        return True
    return False


def killed_at(arguments: Sequence[str], sign: Path) -> bool:
    """Kill as soon as the file `sign` is there: in the middle of writing the results."""
    process = subprocess.Popen(arguments, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    while process.poll() is None:
        if sign.is_file():
            process.send_signal(signal.SIGKILL)
            process.wait()
            return True
    return False


def differences(first: Path, second: Path) -> list[str]:
    """What is not the same in two finished folders."""
    names = sorted(p.name for p in first.iterdir())
    others = sorted(p.name for p in second.iterdir())
    found = [] if names == others else [f"files {sorted(set(names) ^ set(others))}"]
    for name in names:
        if name in others and name not in NOT_COMPARED:
            found += [name] * ((first / name).read_bytes() != (second / name).read_bytes())
    reports = [json.loads((folder / "report.json").read_text()) for folder in (first, second)]
    keys = set(reports[0]) | set(reports[1])
    found += [
        f"report {key}"
        for key in sorted(keys - set(OF_THE_MOMENT))
        if reports[0].get(key) != reports[1].get(key)
    ]
    if "recording.rrd" in names and recorded(first) != recorded(second):
        found.append("recording.rrd")
    return found


def recorded(folder: Path) -> dict[str, list[int]]:
    """Frames of every entity of a recording that passes Rerun's own verifier."""
    import rerun.chunk

    path = folder / "recording.rrd"
    verify = [sys.executable, "-m", "rerun", "rrd", "verify", str(path)]
    assert subprocess.run(verify, capture_output=True, check=False).returncode == 0
    frames: dict[str, list[int]] = {}
    for chunk in rerun.chunk.RrdReader(str(path)).stream():
        if not chunk.is_static:
            rows = chunk.to_record_batch().to_pydict().get("frame", [])
            frames.setdefault(str(chunk.entity_path), []).extend(rows)
    return {entity: sorted(rows) for entity, rows in frames.items()}


def main(arguments: Sequence[str] | None = None) -> int:
    """Print one line per kill; the exit code is 1 when a resumed run differs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("source")
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    given = list(sys.argv[1:] if arguments is None else arguments)
    cut = given.index("--") if "--" in given else len(given)
    options, more = parser.parse_args(given[:cut]), given[cut + 1 :]
    moments, worst = random.Random(options.seed), 0
    with tempfile.TemporaryDirectory() as folder:
        whole = Path(folder) / "whole"
        run(command(options.source, whole, more))  # fills the cache of a synthetic drive
        run([*command(options.source, whole, more), "--overwrite"])
        began = time.perf_counter()
        run([*command(options.source, whole, more), "--overwrite"])
        lasts_s = time.perf_counter() - began
        print(f"undisturbed: {lasts_s:.1f} s")
        for number in range(options.kills):
            out = Path(folder) / f"out-{number}"
            this = command(options.source, out, more)
            if number % 4 == 3:
                sign = out / moments.choice(("config.json", "extrinsics.csv", "rig.yaml", "trajectory.txt"))
                hit, when = killed_at(this, sign), f"as {sign.name} appears"
            else:
                delay_s = moments.uniform(0.2, 0.9) * lasts_s
                hit, when = killed_after(this, delay_s), f"after {delay_s:5.2f} s"
            left = out / "checkpoint.bin"
            size = left.stat().st_size if left.is_file() else 0
            run(this)
            found = differences(whole, out)
            worst |= bool(found)
            print(
                f"{number}: {'killed' if hit else 'ended'} {when}, checkpoint of {size} bytes: {found or 'the same'}",
                flush=True,
            )
    return worst


if __name__ == "__main__":
    sys.exit(main())
