"""A `Difference` as JSON, in metres and degrees."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from stereocalib_core.results import TO_DEGREES
from stereocalib_core.results.difference import Difference

DEGREES = float(TO_DEGREES[1])


def difference_of(difference: Difference, a: str, b: str) -> dict[str, Any]:
    """The difference between the drives named `a` and `b`."""
    both = difference.a, difference.b
    frames, path = difference.frames, difference.path
    mount = {}
    for axis, found in difference.mount.items():
        unit = DEGREES if axis.endswith("_rad") else 1.0
        mount[axis.replace("_rad", "_deg")] = found and {
            "a": unit * found.a.value,
            "b": unit * found.b.value,
            "difference": unit * found.difference,
            "sigma": unit * found.sigma,
            "significant": found.significant,
        }
    axes = {}
    for axis, over in {} if frames is None else frames.axes.items():
        unit = DEGREES if axis.endswith("_rad") else 1.0
        scaled = {name: unit * getattr(over, name) for name in ("median", "rms", "largest")} if over else {}
        axes[axis.replace("_rad", "_deg")] = over and {**dataclasses.asdict(over), **scaled}
    values = None if path is None else dataclasses.asdict(path)
    if values is not None:
        values["final_heading_difference_deg"] = float(np.rad2deg(values.pop("final_heading_difference_rad")))
    return {
        "a": a,
        "b": b,
        "source": [drive.source for drive in both],
        "frames_ok": [f"{drive.frames_ok} of {len(drive.frames)}" for drive in both],
        "mount": mount,
        "frames": frames and {k: v for k, v in dataclasses.asdict(frames).items() if k != "axes"} | axes,
        "path": values,
        "rectification": [drive.pair.verdict for drive in both],
        "shifts": [len(drive.shifts) for drive in both],
    }
