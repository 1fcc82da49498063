"""Rooms with a chessboard, seen by a ray-cast LiDAR and a rendered camera: ground truth for the tests."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
import yaml

from stereocalib_core.boards.camera import BoardCamera
from stereocalib_core.boards.observation import BoardSpec
from stereocalib_core.boards.rotations import rotation_from_vector
from stereocalib_core.geometry import invert_transform, transform
from stereocalib_core.numeric.arrays import Array

FLU_TO_RDF = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])


def grid_rays(elevations_deg: Array, azimuth_deg: Array) -> Array:
    az, el = np.meshgrid(np.deg2rad(azimuth_deg), np.deg2rad(elevations_deg))
    return np.stack([np.cos(az) * np.cos(el), np.sin(az) * np.cos(el), np.sin(el)], axis=-1).reshape(-1, 3)


def vlp16() -> Array:
    return grid_rays(np.arange(-15, 16, 2.0), np.arange(-180, 180, 0.2))


def hdl64() -> Array:
    return grid_rays(np.linspace(-24.8, 2.0, 64), np.arange(-180, 180, 0.18))


def dense(count: int = 120_000) -> Array:
    rng = np.random.default_rng(1)
    az, el = rng.uniform(-40, 40, count), rng.uniform(-25, 25, count)
    az, el = np.deg2rad(az), np.deg2rad(el)
    return np.stack([np.cos(az) * np.cos(el), np.sin(az) * np.cos(el), np.sin(el)], axis=-1)


@dataclass(frozen=True)
class Rectangle:
    """T (4, 4) lidar from rectangle (z normal), width, height [m]."""

    T: Array
    width: float
    height: float


def cast(rays: Array, rectangles: list[Rectangle], noise_m: float, rng: np.random.Generator) -> Array:
    best = np.full(len(rays), np.inf)
    for r in rectangles:
        normal, center = r.T[:3, 2], r.T[:3, 3]
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = (normal @ center) / (rays @ normal)
            local = (rays * reach[:, None] - center) @ r.T[:3, :2]
            ok = (reach > 0.2) & (np.abs(local[:, 0]) < r.width / 2) & (np.abs(local[:, 1]) < r.height / 2)
        best = np.where(ok & (reach < best), reach, best)
    hit = np.isfinite(best) & (best < 80)
    reach = best[hit] + noise_m * rng.standard_normal(int(hit.sum()))
    return rays[hit] * reach[:, None]


def upright(center: tuple[float, float, float], yaw_deg: float, width: float, height: float) -> Rectangle:
    """A standing rectangle whose normal is turned by yaw from the LiDAR's x axis."""
    z = rotation_from_vector(np.deg2rad([0, 0, yaw_deg]))
    R = z @ np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    return Rectangle(transform(R, np.array(center)), width, height)


def box(center: tuple[float, float, float], size: tuple[float, float, float]) -> list[Rectangle]:
    (x, y, z), (a, b, c) = center, size
    return [
        upright((x - a / 2, y, z), 0, b, c),
        upright((x + a / 2, y, z), 0, b, c),
        upright((x, y - b / 2, z), 90, a, c),
        upright((x, y + b / 2, z), 90, a, c),
        Rectangle(transform(np.eye(3), np.array([x, y, z + c / 2])), a, b),
        Rectangle(transform(np.eye(3), np.array([x, y, z - c / 2])), a, b),
    ]


def room(sensor_height_m: float = 1.2) -> list[Rectangle]:
    h = sensor_height_m
    result = [
        Rectangle(transform(np.eye(3), np.array([2.0, 0.0, -h])), 14.0, 10.0),
        Rectangle(transform(np.eye(3), np.array([2.0, 0.0, 3.0 - h])), 14.0, 10.0),
        upright((8.5, 0.0, 0.3), 0, 10.0, 3.4),
        upright((-4.0, 0.0, 0.3), 0, 10.0, 3.4),
        upright((2.0, 4.5, 0.3), 90, 14.0, 3.4),
        upright((2.0, -4.5, 0.3), 90, 14.0, 3.4),
        upright((8.45, 1.5, 0.4), 0, 0.8, 1.0),
    ]
    for center, size in (
        ((5.0, 3.2, -h + 0.4), (1.6, 0.8, 0.8)),
        ((6.0, -3.0, -h + 0.9), (0.5, 1.0, 1.8)),
        ((3.0, -3.6, -h + 0.25), (0.5, 0.5, 0.5)),
        ((-1.5, 2.0, -h + 0.5), (1.0, 1.0, 1.0)),
    ):
        result += box(center, size)
    return result


def holder(T_lidar_board: Array, board: BoardSpec, sensor_height_m: float = 1.2) -> list[Rectangle]:
    """Someone who stands beside the board, near its plane and nearly at its edge."""
    side = T_lidar_board[:3, 3] + T_lidar_board[:3, 0] * (board.diagonal_m / 2 + 0.17)
    return box((float(side[0]), float(side[1]), -sensor_height_m + 0.85), (0.25, 0.35, 1.7))


def draw_pose(
    rng: np.random.Generator, T_camera_lidar: Array, nearest: float = 1.8, farthest: float = 4.0
) -> Array:
    """T_camera_board: in view, tilted up to 40 deg about a random axis and turned in its plane."""
    z = rng.uniform(nearest, farthest)
    center = np.array([rng.uniform(-0.35, 0.35) * z, rng.uniform(-0.12, 0.1) * z, z])
    axis = rng.uniform(0, 2 * np.pi)
    tilt = np.deg2rad(rng.uniform(12, 42)) * np.array([np.cos(axis), np.sin(axis), 0.0])
    R = rotation_from_vector(tilt) @ rotation_from_vector(np.array([0, 0, np.deg2rad(rng.uniform(-30, 30))]))
    return transform(R, center)


@lru_cache(maxsize=4)
def pixel_rays(
    model: str, width: int, height: int, K: tuple[float, ...], D: tuple[float, ...]
) -> list[Array]:
    """(H, W, 2) undistorted x, y of every pixel, and their steps along v and u; the same for all pictures."""
    camera = BoardCamera(model, width, height, np.reshape(K, (3, 3)), np.array(D))  # type: ignore[arg-type]
    v, u = np.mgrid[0:height, 0:width].astype(float)
    xy = camera.normalise(np.stack([u, v], axis=-1).reshape(-1, 2)).reshape(height, width, 2)
    return [xy, *np.gradient(xy, axis=(0, 1))]


def render(camera: BoardCamera, board: BoardSpec, T_camera_board: Array, rng: np.random.Generator) -> Array:
    """(H, W) uint8 picture: the board, 3x3 samples a pixel, over grey noise."""
    image = np.full((camera.height, camera.width), 120.0)
    image += cv2.GaussianBlur(rng.standard_normal(image.shape) * 60, (0, 0), 9)
    outline = board.outline_board @ T_camera_board[:3, :3].T + T_camera_board[:3, 3]
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
            inside = (np.abs(place[:, 0]) < board.width_m / 2) & (np.abs(place[:, 1]) < board.height_m / 2)
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
        T_camera_board = draw_in_view(rng, camera, board, T_camera_lidar)
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


def draw_in_view(
    rng: np.random.Generator, camera: BoardCamera, board: BoardSpec, T_camera_lidar: Array
) -> Array:
    while True:
        T = draw_pose(rng, T_camera_lidar)
        outline = camera.project(board.outline_board @ T[:3, :3].T + T[:3, 3])
        if (
            np.isfinite(outline).all()
            and (outline > 4).all()
            and (outline < [camera.width - 4, camera.height - 4]).all()
        ):
            return T
