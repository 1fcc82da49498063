"""`stereocalib experiments roll`."""

from stereocalib_core.experiments.extrinsics import run_roll as run

__all__ = ["run"]
