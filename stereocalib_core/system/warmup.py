"""Compile everything that is compiled, once, so that no user waits for it: `python -m stereocalib_core.system.warmup`.

The compiled loops, and the byte code of what is imported: an installer that leaves none (PYTHONDONTWRITEBYTECODE)
would make every start of the program three times as long.
"""

from __future__ import annotations

import contextlib
import gc
import importlib
import py_compile
import sys
from collections.abc import Sequence
from pathlib import Path

from stereocalib_core.system.compiled import SECONDS, remember

IMPORTED_LATE = (
    "stereocalib_core.run.drive",
    "stereocalib_core.back.analyse",
    "stereocalib_core.run.batch",
    "matplotlib.backends.backend_agg",
    "pykitti",
    "rich.progress",
    "viser",
    "rerun.blueprint",
    "distributed",
)
"""Imported by a command only when it needs them; what is an extra may be missing."""


def warm_up(room: str) -> None:
    """Compile what a room compiles, by its own `warm_up()`."""
    importlib.import_module(f"stereocalib_core.{room}").warm_up()


def compile_modules() -> int:
    """Write the byte code of every module that a command imports, where there is none; how many were written."""
    for name in IMPORTED_LATE:
        with contextlib.suppress(ImportError):
            importlib.import_module(name)
    written = 0
    for module in list(sys.modules.values()):
        spec = getattr(module, "__spec__", None)
        source, target = getattr(spec, "origin", None), getattr(spec, "cached", None)
        if not source or not source.endswith(".py") or not target or Path(target).is_file():
            continue
        with contextlib.suppress(OSError):
            written += py_compile.compile(source, target, quiet=2) is not None
    return written


def main(rooms: Sequence[str]) -> None:
    """Compile these rooms, or everything there is; the name of each as it is done."""
    gc.disable()  # a compiler's garbage is searched for a tenth of its time, and this process ends soon
    for room in rooms or SECONDS:
        warm_up(room)
        sys.stdout.write(f"{room}\n")
        sys.stdout.flush()
    if "simulator" in (rooms or SECONDS):
        importlib.import_module("stereocalib_core.sources.formats.synthetic").keep_town_of_this_version()
    if not rooms:
        compile_modules()
        remember(list(SECONDS))


if __name__ == "__main__":
    main(sys.argv[1:])
