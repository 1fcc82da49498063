"""Folders of boards in rooms with known truth, with any camera, board and LiDAR."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import yaml

from stereocalib_core.boards.camera import BoardCamera
from stereocalib_core.boards.observation import BoardSpec
from stereocalib_core.boards.synthetic_picture import draw_in_view, render
from stereocalib_core.boards.synthetic_room import (
    FLU_TO_RDF,
    Rectangle,
    cast,
    dense,
    hdl64,
    holder,
    room,
    vlp16,
)
from stereocalib_core.geometry import invert_transform
from stereocalib_core.numeric.arrays import Array

__all__ = ["FLU_TO_RDF", "Rectangle", "cast", "dense", "hdl64", "render", "room", "vlp16", "write_folder"]


def write_folder(
    folder: Path, camera: BoardCamera, board: BoardSpec, T_camera_lidar: Array, rays: Array, count: int, seed: int,
    noise_m: float = 0.02, held: bool = True, suffix: str = ".bin", model: str | None = None,
) -> None:  # fmt: skip
    """A whole folder of `count` pairs as the command reads it."""
    rng = np.random.default_rng(seed)
    (folder / "images").mkdir(parents=True)
    (folder / "clouds").mkdir()
    settings = {"model": model or camera.model, "width": camera.width, "height": camera.height}
    if model != "estimate":
        settings |= {"K": camera.K.tolist(), "D": camera.D.tolist()}
    (folder / "camera.yaml").write_text(yaml.safe_dump(settings))
    (folder / "board.yaml").write_text(
        yaml.safe_dump({"columns": board.columns, "rows": board.rows, "square_m": board.square_m})
    )
    for index in range(count):
        T_camera_board = draw_in_view(rng, camera, board)
        T_lidar_board = invert_transform(T_camera_lidar) @ T_camera_board
        things = [*room(), Rectangle(T_lidar_board, board.width_m, board.height_m)]
        if held:
            things += holder(T_lidar_board, board)
        cloud = cast(rays, things, noise_m, rng).astype(np.float32)
        name = f"pair{index:02d}"
        cv2.imwrite(str(folder / "images" / f"{name}.png"), render(camera, board, T_camera_board, rng))
        if suffix == ".bin":
            np.column_stack([cloud, np.zeros(len(cloud), np.float32)]).astype("<f4").tofile(
                folder / "clouds" / f"{name}.bin"
            )
        else:
            np.save(folder / "clouds" / f"{name}.npy", cloud)
