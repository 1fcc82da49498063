"""`python -m stereocalib_app.benches.long_page`: how soon the page of a drive of an hour can be looked at.

A short drive is looked at once; its pictures are linked again and again, and its frames written again and again as
those of one run, so that the page has as much to read as after an hour of driving. Then `stereocalib view` opens that
run as anybody would. Times are told with the CPU time that the server has used by then: wall times grow with whatever
else the machine does.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import psutil

from stereocalib_app.benches.chromium import FLAGS, find_browser
from stereocalib_app.benches.page import READY, served
from stereocalib_app.benches.raw_client import LinkClient, RawClient, name_in
from stereocalib_core.back.analyse import analyse
from stereocalib_core.benches.long_drive import PERIOD_S, repeated
from stereocalib_core.config import PipelineConfig
from stereocalib_core.files.frames_bin import Checkpoint, RunKey
from stereocalib_core.files.run_folder import REPORT, write_run
from stereocalib_core.run.calibrate import follow, told
from stereocalib_core.run.drive import FRAMES
from stereocalib_core.run.synth import write_drive
from stereocalib_core.sources import open_source
from stereocalib_core.sources.formats.synthetic import SyntheticSource

SHORT = "synthetic:town?frames=60"
PATIENCE_S = 120.0


def long_recording(frames: int, folder: Path) -> Path:
    """A recording of so many frames: the pictures of a short drive, linked again and again."""
    short = folder / "short"
    write_drive(SyntheticSource.from_spec(SHORT), short)
    given, made = short / "sequences" / "00", folder / "recording"
    names = sorted(path.name for path in (given / "image_0").iterdir())
    for side in ("image_0", "image_1"):
        (made / side).mkdir(parents=True)
        for i in range(frames):
            # as `repeated` has the frames
            name = names[i if i < len(names) else 1 + (i - len(names)) % (len(names) - 1)]
            os.link(given / side / name, made / side / f"{i:06d}.png")
    shutil.copy(given / "calib.txt", made)
    (made / "times.txt").write_text("".join(f"{PERIOD_S * i:.6f}\n" for i in range(frames)), encoding="ascii")
    return made


def long_run(frames: int, folder: Path) -> Path:
    """The output of a run over such a recording; made once where the folder stays."""
    out = folder / "run"
    if (out / REPORT).is_file():
        return out
    out.mkdir(parents=True)
    source, config = open_source(SHORT), PipelineConfig()
    spec = str(long_recording(frames, folder))
    recording = open_source(spec)
    short = [step.done for step in follow(source, config)]
    key = RunKey(recording.content_key, recording.camera, config, None, {}, 0, None, "bench")
    checkpoint = Checkpoint(out / FRAMES, key)
    for done in repeated(short, frames):
        checkpoint.append(done)
    all_of_them = checkpoint[:]
    checkpoint.close()
    drive = analyse([done.result for done in all_of_them], recording.camera, config)
    write_run(told(drive, spec, recording, all_of_them, 1.0), out)
    return out


def cpu_s(process: psutil.Process) -> float:
    """What a process has used so far [s]."""
    return float(sum(process.cpu_times()[:2]))


def opened(run: Path) -> dict[str, tuple[float, float]]:
    """Wall and CPU seconds of the server from its start to each step, and its memory [MB] at the end."""
    began = time.monotonic()
    with served(str(run)) as (address, started_s, process):
        steps = {"address": (started_s, cpu_s(process))}
        port = int(address.rsplit(":", 1)[1])
        me: dict[str, Any] = {}
        browser = RawClient(port)
        browser.say_hello()
        while not me:
            me = name_in([browser.receive(1.0)])
        line = LinkClient(port, me)
        line.until(lambda seen: seen.pictured)
        steps["first picture"] = time.monotonic() - began, cpu_s(process)
        line.until(lambda seen: bool(seen.head.get("done")), PATIENCE_S)
        steps["all is read"] = time.monotonic() - began, cpu_s(process)
        memory = process.memory_info()
        steps["memory, with and without pages of files [MB]"] = (
            memory.rss / 1e6,
            (memory.rss - memory.shared) / 1e6,
        )
        line.close()
        browser.close()
    return steps


def in_chromium(run: Path, browser: str) -> float:
    """Seconds from the server's start until a headless Chromium, which runs already, has drawn the first picture."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright, tempfile.TemporaryDirectory() as profile:
        context = playwright.chromium.launch_persistent_context(
            profile, executable_path=browser, args=list(FLAGS), viewport={"width": 1280, "height": 720}
        )
        page = context.pages[0]
        began = time.monotonic()
        with served(str(run)) as (address, _, _):
            page.goto(address)
            page.wait_for_function(READY, timeout=1e3 * PATIENCE_S)
            seen = time.monotonic() - began
            context.close()
    return seen


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description="How soon the page of a long drive can be looked at.")
    parser.add_argument("--frames", type=int, default=36_000)
    parser.add_argument("--times", type=int, default=3)
    parser.add_argument("--browser", default=find_browser())
    parser.add_argument("--folder", type=Path, help="where the run is made and kept for the next time")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="stereocalib-bench-") as fresh:
        run = long_run(arguments.frames, arguments.folder or Path(fresh))
        sys.stdout.write(f"{arguments.frames} frames{'':<34}{'wall':>9}{'CPU':>9}\n")
        for _ in range(arguments.times):
            for name, (wall, used) in opened(run).items():
                sys.stdout.write(f"  {name:<44}{wall:9.2f}{used:9.2f}\n")
            if arguments.browser and find_spec("playwright"):
                seen = in_chromium(run, arguments.browser)
                sys.stdout.write(f"  {'first picture in Chromium':<44}{seen:9.2f}\n")
            sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
