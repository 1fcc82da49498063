"""Compile everything that is compiled, once, so that no user waits for it: `python -m stereocalib_core.benches.warmup`.

The compiled loops, and the byte code of what is imported: an installer that leaves none (PYTHONDONTWRITEBYTECODE)
would make every start of the program three times as long.
"""

from __future__ import annotations

import contextlib
import importlib
import py_compile
import sys
from pathlib import Path

WARM_PACKAGES = (
    "stereocalib_core.sources",
    "stereocalib_core.front.rows",
    "stereocalib_core.front.road",
    "stereocalib_core.front.tracks",
    "stereocalib_core.front.scan",
    "stereocalib_core.back.rig",
    "stereocalib_core.back.odometry",
    "stereocalib_core.simulator",
    "stereocalib_core.boards",
)
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


def warm_up() -> None:
    """Call the `warm_up()` of every package that has one."""
    for name in WARM_PACKAGES:
        package = importlib.import_module(name)
        if hasattr(package, "warm_up"):
            package.warm_up()


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


if __name__ == "__main__":
    warm_up()
    compile_modules()
