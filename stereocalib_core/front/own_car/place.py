"""Where the own car is in the picture, in blocks of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.config import OwnCarConfig
from stereocalib_core.geometry import StereoCamera
from stereocalib_core.numeric.arrays import Mask
from stereocalib_core.results import DisparityMap


@dataclass(frozen=True)
class Grid:
    """How a picture is shrunk and cut into blocks: `by` pixels per shrunk one, `block` (w, h) of these.

    rows, columns: of blocks. top: the first row of blocks that is searched, halfway down.
    """

    by: int
    block: tuple[int, int]
    rows: int
    columns: int
    top: int

    @classmethod
    def of(cls, camera: StereoCamera, config: OwnCarConfig) -> Grid:
        by = max(1, round(camera.width / config.columns))
        w, h = config.block
        rows, columns = camera.height // by // h, camera.width // by // w
        return cls(by, config.block, rows, columns, rows // 2)


@dataclass(frozen=True)
class OwnCar:
    """Where the own car is. tops: (C,) first row of blocks, from the top, that is its; the number of rows for none."""

    tops: NDArray[np.int16]
    grid: Grid

    def covers(self, disparity: DisparityMap) -> Mask:
        """(h, w) bool on the disparity grid: the cells that see the own car, or so near to it that a window does."""
        w, h = (side * self.grid.by for side in self.grid.block)
        none = self.tops >= self.grid.rows
        first_px = np.where(none, np.iinfo(np.int32).max, (self.tops.astype(np.int64) - 1) * h)
        beside = np.minimum(
            first_px, np.minimum(np.append(first_px[1:], first_px[-1]), np.append(first_px[0], first_px[:-1]))
        )
        columns = np.clip(disparity.columns_u() // w, 0, len(beside) - 1).astype(int)
        return np.asarray(disparity.rows_v()[:, None] >= beside[columns][None, :])

    def without(self, disparity: DisparityMap) -> DisparityMap:
        """The disparity of everything else."""
        return DisparityMap(
            np.where(self.covers(disparity), np.float32(np.nan), disparity.values), disparity.step_px
        )

    def rows_px(self, height: int) -> int:
        """The lowest so many rows of a picture of `height` rows have some of it, but for columns that are all of it."""
        rows = self.tops[self.tops > 0]
        edge = int(rows.min()) if len(rows) else self.grid.rows
        return 0 if edge == self.grid.rows else height - edge * self.grid.block[1] * self.grid.by
