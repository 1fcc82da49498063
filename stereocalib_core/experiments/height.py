"""`stereocalib experiments height`."""

from stereocalib_core.experiments.extrinsics import run_height as run

__all__ = ["run"]
