"""Compile everything that is compiled, once, so that no user waits for it: `python -m stereocalib_core.warmup`."""

from __future__ import annotations

import importlib

WARM_PACKAGES = (
    "stereocalib_core.road",
    "stereocalib_core.rig",
    "stereocalib_core.odometry",
    "stereocalib_core.synthetic",
    "stereocalib_core.lidar_camera",
)


def warm_up() -> None:
    """Call the `warm_up()` of every package that has one."""
    for name in WARM_PACKAGES:
        package = importlib.import_module(name)
        if hasattr(package, "warm_up"):
            package.warm_up()


if __name__ == "__main__":
    warm_up()
