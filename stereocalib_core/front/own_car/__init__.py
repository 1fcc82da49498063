"""What of the own car is in the picture: its bonnet, found because it never moves, and black borders.

Two things may be in a block of the picture: the road, which moves on by the homography of its plane and the car's
motion, or what stands where it stood. Every look compares the picture with the last one, carried on as the road would
be, and with one of some metres before, as it was. Where there is no detail, both explain it as well, and nothing is
said: smooth asphalt is no bonnet. A bonnet has edges that keep their place, hides all that is below them, and has
nothing in it that moves as the road does, whatever it reflects. So in each column of blocks the evidence is summed from
the bottom up, and the edge is the one that has most of it below and goes on from column to column.
"""

from __future__ import annotations

import numpy as np

from stereocalib_core.config import OwnCarConfig
from stereocalib_core.front.own_car.evidence import on_road
from stereocalib_core.front.own_car.place import Grid, OwnCar
from stereocalib_core.front.own_car.search import Search, go_on, take_up
from stereocalib_core.geometry import Extrinsics, StereoCamera

__all__ = ["OwnCar", "Search", "go_on", "take_up"]


def warm_up() -> None:
    """Compile the loops of this room."""
    config, road = OwnCarConfig(), Extrinsics(1.65, 0.0, 0.0)
    camera = StereoCamera(160, 80, 100.0, 80.0, 20.0, 0.5)
    picture = np.zeros((camera.height, camera.width), np.uint8) + np.uint8(100)
    search, ahead = Search(), np.array([0.0, 0.0, 0.0, 0.0, 0.0, -2.0])
    for i in range(8):
        search = go_on(search, i, (picture, picture), ahead, road, camera, config)
    grid, seen = Grid.of(camera, config), next(iter(search.pictures.values()))
    on_road(np.ones((grid.rows - grid.top, grid.columns), np.bool_), seen, seen, road, camera, grid, config)
