"""What one pair of picture and cloud says: the board as each sensor sees it.

Frames: ``camera`` is the optical frame (x right, y down, z forward); ``lidar`` is the cloud's own;
``board`` has its origin at the centre of the pattern, x along the columns, y along the rows, z away
from the viewer. Planes are ``n . X = d`` with d >= 0, so every normal points away from its sensor.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from stereocalib_core.errors import ConfigError
from stereocalib_core.geometry import Plane
from stereocalib_core.numeric.arrays import Array


@dataclass(frozen=True)
class BoardSpec:
    """A chessboard: inner corners, square size [m], and the physical board around the pattern [m].

    Without `width_m`, `height_m` the board is taken as the pattern plus one square of margin all round,
    that is (columns + 1) by (rows + 1) squares. The pattern sits in the middle of the board.
    """

    columns: int
    rows: int
    square_m: float
    width_m: float = 0.0
    height_m: float = 0.0

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < 3 or max(self.columns, self.rows) > 100:
            raise ConfigError(
                "board pattern is none", f"{self.columns} x {self.rows}", "give 3 to 100 inner corners a side"
            )
        if not (np.isfinite(self.square_m) and 0.001 <= self.square_m <= 10.0):
            raise ConfigError("square size is none", f"{self.square_m} m", "give square_m in metres")
        pattern = ((self.columns - 1) * self.square_m, (self.rows - 1) * self.square_m)
        for name, size, corners, count in (
            ("width_m", self.width_m, pattern[0], self.columns),
            ("height_m", self.height_m, pattern[1], self.rows),
        ):
            if size == 0.0:
                object.__setattr__(self, name, (count + 1) * self.square_m)
            elif not (np.isfinite(size) and corners <= size <= corners + 10.0):
                raise ConfigError(
                    f"board {name} does not hold its pattern",
                    f"{size} m",
                    f"give at least {corners:g} m, or leave it out",
                )

    @cached_property
    def corners_board(self) -> Array:
        """(rows * columns, 3) corners in the board frame [m], row by row."""
        x = (np.arange(self.columns) - (self.columns - 1) / 2) * self.square_m
        y = (np.arange(self.rows) - (self.rows - 1) / 2) * self.square_m
        grid = np.zeros((self.rows, self.columns, 3))
        grid[..., 0], grid[..., 1] = x[None, :], y[:, None]
        return grid.reshape(-1, 3)

    @property
    def outline_board(self) -> Array:
        """(4, 3) corners of the physical board in the board frame [m], in order round it."""
        w, h = self.width_m / 2, self.height_m / 2
        return np.array([[-w, -h, 0.0], [w, -h, 0.0], [w, h, 0.0], [-w, h, 0.0]])

    @property
    def short_side_m(self) -> float:
        """The shorter side of the physical board [m]."""
        return min(self.width_m, self.height_m)

    @property
    def diagonal_m(self) -> float:
        """The diagonal of the physical board [m]."""
        return float(np.hypot(self.width_m, self.height_m))


@dataclass(frozen=True)
class PlaneEstimate:
    """A board plane with its uncertainty.

    plane: n (3,), d [m], in the sensor's frame. center: (3,) the board's centre, on the plane [m].
    covariance: (4, 4) of (n, d), of rank 3. rms_m: scatter of the points about the plane (0 in a picture).
    """

    plane: Plane
    center: Array
    covariance: Array
    rms_m: float = 0.0

    @property
    def incidence(self) -> float:
        """Cosine between the normal and the line of sight to the centre: 0 = seen edge-on."""
        distance = float(np.linalg.norm(self.center))
        return self.plane.offset_m / distance if distance > 0 else 0.0


@dataclass(frozen=True)
class PairObservation:
    """One picture with its cloud, after detection; a pair without a board keeps its reason.

    corners: (N, 2) chessboard corners [px], row by row, or None. T_camera_board: (4, 4) or None.
    points_lidar: (M, 3) cloud points on the board [m] (M may be 0).
    camera_plane, lidar_plane: the board as each sensor sees it, or None.
    corner_rms_px: reprojection of the corners with this picture alone.
    """

    name: str
    image: Path | None = None
    cloud: Path | None = None
    corners: Array | None = None
    T_camera_board: Array | None = None
    points_lidar: Array = field(default_factory=lambda: np.zeros((0, 3)))
    camera_plane: PlaneEstimate | None = None
    lidar_plane: PlaneEstimate | None = None
    corner_rms_px: float = float("nan")
    status: str = "ok"
    reason: str = ""

    @property
    def ok(self) -> bool:
        """Whether both sensors see the board."""
        return self.status == "ok"
