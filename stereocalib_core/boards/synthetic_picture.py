"""Pictures of a chessboard with known pose, and poses drawn so that a camera sees the whole board."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from stereocalib_core.boards.camera import BoardCamera
from stereocalib_core.boards.observation import BoardSpec
from stereocalib_core.boards.rotations import rotation_from_vector
from stereocalib_core.geometry import invert_transform, transform
from stereocalib_core.numeric.arrays import Array


def draw_pose(rng: np.random.Generator, nearest: float = 1.8, farthest: float = 4.0) -> Array:
    """T_camera_board: in view, tilted up to 40 deg about a random axis and turned in its plane."""
    z = rng.uniform(nearest, farthest)
    center = np.array([rng.uniform(-0.35, 0.35) * z, rng.uniform(-0.12, 0.1) * z, z])
    axis = rng.uniform(0, 2 * np.pi)
    tilt = np.deg2rad(rng.uniform(12, 42)) * np.array([np.cos(axis), np.sin(axis), 0.0])
    R = rotation_from_vector(tilt) @ rotation_from_vector(np.array([0, 0, np.deg2rad(rng.uniform(-30, 30))]))
    return transform(R, center)


def draw_in_view(rng: np.random.Generator, camera: BoardCamera, board: BoardSpec) -> Array:
    """T_camera_board (4, 4) with the whole board in the picture."""
    while True:
        T = draw_pose(rng)
        outline = camera.project(board.outline_board @ T[:3, :3].T + T[:3, 3])
        if (
            np.isfinite(outline).all()
            and (outline > 4).all()
            and (outline < [camera.width - 4, camera.height - 4]).all()
        ):
            return T


@lru_cache(maxsize=4)
def pixel_rays(
    model: str, width: int, height: int, K: tuple[float, ...], D: tuple[float, ...]
) -> list[Array]:
    """(H, W, 2) undistorted x, y of every pixel, and their steps along v and u; the same for all pictures."""
    camera = BoardCamera(model, width, height, np.reshape(K, (3, 3)), np.array(D))  # type: ignore[arg-type]
    v, u = np.mgrid[0:height, 0:width].astype(float)
    xy = camera.normalise(np.stack([u, v], axis=-1).reshape(-1, 2)).reshape(height, width, 2)
    return [xy, *np.gradient(xy, axis=(0, 1))]


def render(
    camera: BoardCamera,
    board: BoardSpec,
    T_camera_board: Array,
    rng: np.random.Generator,
    aside: Array | None = None,
) -> NDArray[np.uint8]:
    """(H, W) uint8 picture: the board, 3x3 samples a pixel, over grey noise.

    T_camera_board is the pattern's pose; `aside` (2,) [m] is where the board's own middle lies on it.
    """
    middle = np.zeros(2) if aside is None else aside
    image = np.full((camera.height, camera.width), 120.0)
    image += cv2.GaussianBlur(rng.standard_normal(image.shape) * 60, (0, 0), 9)
    outline = (board.outline_board + np.append(middle, 0.0)) @ T_camera_board[:3, :3].T + T_camera_board[
        :3, 3
    ]
    edge = np.concatenate([np.linspace(outline[i], outline[(i + 1) % 4], 15) for i in range(4)])
    pixels = camera.project(edge)
    u0, v0 = np.maximum(np.floor(pixels.min(axis=0)).astype(int) - 2, 0)
    u1, v1 = np.minimum(np.ceil(pixels.max(axis=0)).astype(int) + 3, [camera.width, camera.height])
    key = camera.model, camera.width, camera.height, tuple(camera.K.ravel()), tuple(camera.D)
    xy, along_v, along_u = (values[v0:v1, u0:u1] for values in pixel_rays(*key))
    shape = xy.shape[:2]
    total, weight = np.zeros(shape), np.zeros(shape)
    T = invert_transform(T_camera_board)
    for du in (-1 / 3, 0, 1 / 3):
        for dv in (-1 / 3, 0, 1 / 3):
            sample = (xy + du * along_u + dv * along_v).reshape(-1, 2)
            rays = np.column_stack([sample, np.ones(len(sample))]) @ T[:3, :3].T
            reach = -T[2, 3] / rays[:, 2]
            place = (rays * reach[:, None] + T[:3, 3])[:, :2]
            local = np.abs(place - middle)
            inside = (local[:, 0] < board.width_m / 2) & (local[:, 1] < board.height_m / 2)
            cell = np.floor(
                place / board.square_m + np.array([board.columns + 1, board.rows + 1]) / 2
            ).astype(int)
            pattern = ((cell >= 0) & (cell < [board.columns + 1, board.rows + 1])).all(axis=1)
            black = pattern & ((cell.sum(axis=1) % 2) == 0)
            value = np.where(black, 30.0, 215.0).reshape(shape)
            total += np.where(inside.reshape(shape), value, 0.0)
            weight += inside.reshape(shape)
    patch = image[v0:v1, u0:u1]
    image[v0:v1, u0:u1] = (total + (9 - weight) * patch) / 9
    image = cv2.GaussianBlur(image, (0, 0), 0.6) + rng.normal(0, 2.0, image.shape)
    return np.clip(np.round(image), 0, 255).astype(np.uint8)
