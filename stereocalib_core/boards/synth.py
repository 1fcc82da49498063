"""`stereocalib synth-boards`: a folder of rendered pictures and ray-cast clouds, with the truth beside them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import yaml

from stereocalib_core.boards.camera import BoardCamera
from stereocalib_core.boards.observation import BoardSpec
from stereocalib_core.boards.rotations import rotation_from_vector
from stereocalib_core.boards.synthetic_picture import draw_in_view, render
from stereocalib_core.boards.synthetic_room import FLU_TO_RDF, Rectangle, cast, holder, room, vlp16
from stereocalib_core.errors import OutputError
from stereocalib_core.geometry import invert_transform, transform
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.system.whole_file import write_json

Progress = Callable[[str, int, int], None]
CAMERA = BoardCamera(
    "pinhole", 960, 640, np.array([[720.0, 0.0, 483.0], [0.0, 721.0, 317.0], [0.0, 0.0, 1.0]]),
    np.array([-0.2, 0.06, 0.0004, -0.0003, 0.0]),
)  # fmt: skip
BOARD = BoardSpec(7, 5, 0.11)
T_CAMERA_LIDAR = transform(
    rotation_from_vector(np.deg2rad([2.0, -3.0, 1.0])) @ FLU_TO_RDF, np.array([0.10, -0.25, -0.15])
)


@dataclass(frozen=True)
class SynthSettings:
    """pairs: how many. range_sigma_m: of every range. camera_as: what camera.yaml says, "pinhole" or "estimate".

    beam_sigma_m: of each beam's own range, the same in all clouds of a set. print_sigma: of the printed square, as a
    share of the stated one; centre_sigma_m: of the pattern's place on its board; one of each for a set.
    held: whether someone stands beside the board.
    """

    pairs: int = 12
    seed: int = 0
    range_sigma_m: float = 0.015
    beam_sigma_m: float = 0.005
    print_sigma: float = 0.003
    centre_sigma_m: float = 0.010
    held: bool = True
    camera_as: str = "pinhole"


def write_set(
    out: Path,
    settings: SynthSettings | None = None,
    progress: Progress | None = None,
    poses: list[Array] | None = None,
) -> None:
    """Write images/, clouds/, camera.yaml, board.yaml and truth.json into `out`.

    `poses`, T_camera_board (4, 4) each, take the place of drawn ones. The same settings give the same bytes.
    """
    settings = settings or SynthSettings()
    rng = np.random.default_rng([settings.seed, 2018])
    rays = vlp16()
    heights = np.unique(np.round(rays[:, 2], 6))
    bias = settings.beam_sigma_m * rng.standard_normal(len(heights))
    printed = replace(BOARD, square_m=BOARD.square_m * (1.0 + settings.print_sigma * rng.standard_normal()))
    aside = settings.centre_sigma_m * rng.standard_normal(2)
    for name in ("images", "clouds"):
        (out / name).mkdir(parents=True, exist_ok=True)
    count = settings.pairs if poses is None else len(poses)
    truth = []
    for index in range(count):
        T = draw_in_view(rng, CAMERA, BOARD) if poses is None else poses[index]
        truth.append(T)
        cloud = _cloud(T @ transform(np.eye(3), np.append(aside, 0.0)), rays, heights, bias, settings, rng)
        name = f"pair{index:02d}"
        target = out / "images" / f"{name}.png"
        if not cv2.imwrite(str(target), render(CAMERA, printed, T, rng, aside)):
            raise OutputError("picture cannot be written", target, "check the folder and the disk")
        cloud.tofile(out / "clouds" / f"{name}.bin")
        if progress is not None:
            progress("rendering pairs", index + 1, count)
    _write_settings(out, settings)
    write_json(
        out / "truth.json",
        {
            "T_camera_lidar": T_CAMERA_LIDAR.tolist(),
            "T_camera_board": [T.tolist() for T in truth],
            "camera": {"model": CAMERA.model, "K": CAMERA.K.tolist(), "D": CAMERA.D.tolist()},
            "square_m": printed.square_m,
            "board_centre_m": aside.tolist(),
            "range_sigma_m": settings.range_sigma_m,
            "beam_bias_m": bias.tolist(),
        },
    )


def _cloud(
    T_camera_board: Array, rays: Array, heights: Array, bias: Array, settings: SynthSettings, rng: np.random.Generator
) -> Array:  # fmt: skip
    """(N, 4) float32 x y z reflectance of the room with the board in it."""
    T = invert_transform(T_CAMERA_LIDAR) @ T_camera_board
    things = [*room(), Rectangle(T, BOARD.width_m, BOARD.height_m)]
    if settings.held:
        things += holder(T, BOARD)
    hits = cast(rays, things, 0.0, rng)
    reach = np.linalg.norm(hits, axis=1)
    direction = hits / reach[:, None]
    own = np.argmin(np.abs(direction[:, 2:] - heights), axis=1)
    reach = reach + bias[own] + settings.range_sigma_m * rng.standard_normal(len(reach))
    points = direction * reach[:, None]
    return np.column_stack([points, np.zeros(len(points))]).astype("<f4")


def _write_settings(out: Path, settings: SynthSettings) -> None:
    camera = {"model": settings.camera_as, "width": CAMERA.width, "height": CAMERA.height}
    if settings.camera_as != "estimate":
        camera |= {"K": CAMERA.K.tolist(), "D": CAMERA.D.tolist()}
    (out / "camera.yaml").write_text(yaml.safe_dump(camera, sort_keys=False), encoding="utf-8")
    board = {"columns": BOARD.columns, "rows": BOARD.rows, "square_m": BOARD.square_m}
    (out / "board.yaml").write_text(yaml.safe_dump(board, sort_keys=False), encoding="utf-8")
