"""Where a browser looks from: behind the car, or from above with the whole drive in sight."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Point = tuple[float, float, float]


@dataclass(frozen=True)
class Viewpoint:
    """Position and what is looked at, in world axes (x right, y down, z forward) [m]; far: depth of sight."""

    position: Point
    look_at: Point
    far_m: float = 1000.0


FOLLOWING = Viewpoint((-6.0, -6.0, -9.5), (0.9, 4.4, 4.5))
UP = (0.0, -1.0, 0.0)


def overview(positions: NDArray[np.float64]) -> Viewpoint:
    """From above and behind, so that all of (N, 3) positions lie in the upper half of the view, over the time line."""
    known = positions[np.isfinite(positions).all(axis=1)]
    if len(known) == 0:
        return FOLLOWING
    low, high = known.min(axis=0), known.max(axis=0)
    middle, size = (low + high) / 2, max(float((high - low).max()), 20.0)
    position = middle + size * np.array([0.0, -1.6, -1.0])
    look_at = middle + size * np.array([0.0, 0.0, -0.55])
    return Viewpoint(_point(position), _point(look_at), max(1000.0, 6.0 * size))


def _point(values: NDArray[np.float64]) -> Point:
    x, y, z = (float(v) for v in values)
    return x, y, z


def place_camera(client: Any, view: Viewpoint) -> None:
    """Move the camera of one browser."""
    with client.atomic():
        client.camera.up_direction = UP
        client.camera.position = view.position
        client.camera.look_at = view.look_at
        client.camera.far = view.far_m
