"""How wide panels are in a window, and where a browser has put them: read from what it says, which may be anything."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

MAIN_WIDTH_PX = 345
VIEWS_WIDTH_PX = (260, 700)
SCENE_WIDTH_PX = 400
"""What the 3-D view keeps at least."""
TIMELINE_WIDTH_PX = (300, 900)
PICTURE_SHAPE = 1.36
"""Height over width of all stages together."""
PANELS = ("views", "plots", "main")
WIDTH_PX = (180, 2400)
FARTHEST_PX = 10_000


def views_width(height_px: int, window_px: int) -> int:
    """Width of the docked pictures so that all stages fit a browser's height, and the 3-D view keeps its own."""
    wanted = int((height_px - 165) / PICTURE_SHAPE) + 26
    most = min(VIEWS_WIDTH_PX[1], window_px - MAIN_WIDTH_PX - SCENE_WIDTH_PX)
    return max(VIEWS_WIDTH_PX[0], min(wanted, most))


def timeline_width(room_px: int) -> int:
    """Width of the time line between the docked panels: all of it, within reason."""
    return int(np.clip(room_px - 16, *TIMELINE_WIDTH_PX))


@dataclass(frozen=True)
class Docked:
    """One panel: at the `left` or the `right` edge, or `float` at x, y [px]; a negative y counts from below."""

    at: str
    width_px: int
    x: int = 0
    y: int = 0


def read_docking(said: Any) -> dict[str, Docked]:
    """The panels that a browser remembers; what makes no sense is left out."""
    if not isinstance(said, Mapping):
        return {}
    found = {}
    for name in PANELS:
        docked = _docked(said.get(name))
        if docked is not None:
            found[name] = docked
    return found


def _docked(said: Any) -> Docked | None:
    if not isinstance(said, Mapping) or said.get("at") not in ("left", "right", "float"):
        return None
    width = _number(said.get("width"))
    if width is None or not WIDTH_PX[0] <= width <= WIDTH_PX[1]:
        return None
    if said["at"] != "float":
        return Docked(str(said["at"]), width)
    x, y = _number(said.get("x")), _number(said.get("y"))
    return None if x is None or y is None else Docked("float", width, x, y)


def _number(said: Any) -> int | None:
    if isinstance(said, bool) or not isinstance(said, int | float) or not math.isfinite(said):
        return None
    return int(said) if abs(said) <= FARTHEST_PX else None
