"""Pictures of a calibration: arrays in, arrays or matplotlib figures out. Nothing here estimates anything."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from stereocalib_core.boards.calibration import Calibration
from stereocalib_core.boards.camera import BoardCamera
from stereocalib_core.boards.observation import BoardSpec, PairObservation
from stereocalib_core.config.boards import BOARD_PICTURE
from stereocalib_core.numeric.arrays import Array

if TYPE_CHECKING:  # matplotlib takes most of a second to import, and only the figures need it
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Picture = NDArray[np.uint8]
GREEN, WHITE, RED = (80, 220, 80), (255, 255, 255), (60, 60, 255)


def visible_pixels(camera: BoardCamera, points_camera: Array) -> tuple[Array, NDArray[np.bool_]]:
    """(N, 3) points in the camera frame [m] to pixels (N, 2) and (N,) whether the picture shows them.

    A distortion polynomial may fold far-off rays back into the picture; rays outside the field that the
    picture's own border spans are not shown.
    """
    w, h = camera.width - 1.0, camera.height - 1.0
    s = np.linspace(0.0, 1.0, 20)
    zero = np.zeros_like(s)
    border = np.concatenate(
        [
            np.stack([s * w, zero], 1),
            np.stack([s * w, zero + h], 1),
            np.stack([zero, s * h], 1),
            np.stack([zero + w, s * h], 1),
        ]
    )
    edge = camera.normalise(border)
    widest = float(np.nanmax(np.linalg.norm(edge, axis=1)))
    z = points_camera[:, 2]
    ahead = (z > 0.05) & (
        np.hypot(points_camera[:, 0], points_camera[:, 1]) < 1.02 * widest * np.maximum(z, 0.0)
    )
    pixels = np.full((len(points_camera), 2), np.nan)
    pixels[ahead] = camera.project(points_camera[ahead])
    with np.errstate(invalid="ignore"):
        inside = (pixels[:, 0] >= 0) & (pixels[:, 0] <= w) & (pixels[:, 1] >= 0) & (pixels[:, 1] <= h)
    return pixels, inside


def overlay(
    picture: Picture,
    points_lidar: Array,
    T_camera_lidar: Array,
    camera: BoardCamera,
    width_px: int = BOARD_PICTURE.panel_width_px,
    dot_px: int = 2,
) -> Picture:
    """Cloud over picture: (H, W) grey and (N, 3) points to (h, width_px, 3) BGR, coloured by distance.

    Each point is a square of `dot_px`, nearer ones over farther ones.
    """
    scale = width_px / picture.shape[1]
    size = (width_px, round(picture.shape[0] * scale))
    canvas = cv2.cvtColor(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), cv2.COLOR_GRAY2BGR)
    points = points_lidar @ T_camera_lidar[:3, :3].T + T_camera_lidar[:3, 3]
    pixels, inside = visible_pixels(camera, points)
    if not inside.any():
        return np.asarray(canvas, dtype=np.uint8)
    distance = np.linalg.norm(points[inside], axis=1)
    share = np.log(
        np.clip(distance, BOARD_PICTURE.near_m, BOARD_PICTURE.far_m) / BOARD_PICTURE.near_m
    ) / np.log(BOARD_PICTURE.far_m / BOARD_PICTURE.near_m)
    colours = cv2.applyColorMap((255 * (1 - share)).astype(np.uint8).reshape(-1, 1), cv2.COLORMAP_TURBO)[:, 0]
    at = np.round((pixels[inside] + 0.5) * scale - 0.5).astype(int)
    far_first = np.argsort(-distance, kind="stable")
    steps = range(-((dot_px - 1) // 2), dot_px // 2 + 1)
    for dx, dy in ((dx, dy) for dy in steps for dx in steps):
        x = np.clip(at[far_first, 0] + dx, 0, size[0] - 1)
        y = np.clip(at[far_first, 1] + dy, 0, size[1] - 1)
        canvas[y, x] = colours[far_first]
    return np.asarray(canvas, dtype=np.uint8)


def draw_board(
    canvas: Picture, camera: BoardCamera, T_camera_board: Array, board: BoardSpec, ok: bool
) -> Picture:
    """The board's outline on a copy of a BGR picture of any size; green when its pair is used, red when refused."""
    scale = canvas.shape[1] / camera.width
    outline = board.outline_board
    edges = np.concatenate([np.linspace(outline[i], outline[(i + 1) % 4], 20) for i in range(4)])
    pixels = camera.project(edges @ T_camera_board[:3, :3].T + T_camera_board[:3, 3])
    result = canvas.copy()
    if np.isfinite(pixels).all():
        line = np.round(((pixels + 0.5) * scale - 0.5) * 8).astype(np.int32).reshape(-1, 1, 2)
        cv2.polylines(result, [line], True, GREEN if ok else RED, 1, cv2.LINE_AA, 3)
    return result


def before_and_after(
    picture: Picture, points_lidar: Array, result: Calibration, observation: PairObservation, board: BoardSpec
) -> Picture:
    """`overlay_NAME.png`: the linear solution on the left, the refined one on the right, BGR."""
    outcome = next((p for p in result.pairs if p.name == observation.name), None)
    panels = []
    for title, T in (("linear", result.linear), ("refined", result.T_camera_lidar)):
        canvas = overlay(picture, points_lidar, T, result.camera)
        if observation.T_camera_board is not None:
            canvas = draw_board(
                canvas, result.camera, observation.T_camera_board, board, bool(outcome and outcome.ok)
            )
        panels.append(_caption(canvas, f"{observation.name}: {title}"))
    return np.hstack(panels)


def _caption(canvas: Picture, text: str) -> Picture:
    result = canvas.copy()
    for colour, thickness in (((0, 0, 0), 3), (WHITE, 1)):
        cv2.putText(result, text, (10, 22), cv2.FONT_HERSHEY_SIMPLEX, 0.6, colour, thickness, cv2.LINE_AA)
    return result


def residual_figure(result: Calibration) -> Figure:
    """Bars per pair: cloud points to board, corners, angle between the normals; refused pairs in red."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 6.5), layout="constrained")
    axes = figure.subplots(3, 1, sharex=True)
    names = [p.name for p in result.pairs]
    colours = ["#3a7d44" if p.ok else "#c0392b" for p in result.pairs]
    for ax, label, values in (
        (axes[0], "points to board [mm]", [1000 * p.plane_rms_m for p in result.pairs]),
        (axes[1], "corners [px]", [p.reprojection_rms_px for p in result.pairs]),
        (axes[2], "normals [deg]", [p.normal_error_deg for p in result.pairs]),
    ):
        ax.bar(range(len(names)), np.nan_to_num(np.array(values, dtype=float)), color=colours)
        ax.set_ylabel(label)
        good = [v for v, p in zip(values, result.pairs, strict=True) if p.ok and np.isfinite(v)]
        # Perfect data has residuals of nothing: an axis still needs a height.
        ax.set_ylim(0, 1.6 * max(good, default=0.0) or 1.0)
    axes[2].set_xticks(range(len(names)), names, rotation=60, ha="right")
    axes[0].set_title("residuals per pair (green: used, red: refused)")
    return figure


def iteration_figure(result: Calibration) -> Figure:
    """Cost and corner reprojection over the iterations of the refinement (the paper's Fig. 8)."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 4), layout="constrained")
    left = figure.subplots()
    steps = range(len(result.iterations))
    left.plot(steps, [i.cost for i in result.iterations], "o-", color="#1f4e79")
    left.set_xlabel("iteration")
    left.set_ylabel("cost", color="#1f4e79")
    right = left.twinx()
    right.plot(steps, [i.reprojection_rms_px for i in result.iterations], "s--", color="#c0562b")
    right.set_ylabel("reprojection rms [px]", color="#c0562b")
    left.set_title(f"joint refinement, kappa = {result.noise.kappa:.1f} px/m")
    return figure


def boards_figure(result: Calibration, observations: tuple[PairObservation, ...], board: BoardSpec) -> Figure:
    """Boards and their cloud points in the camera frame, seen from above and from the side."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 5), layout="constrained")
    top, side = figure.subplots(1, 2)
    used = {p.name: p for p in result.pairs if p.ok}
    T = result.T_camera_lidar
    for o in observations:
        if o.name not in used or used[o.name].T_camera_board is None:
            continue
        pose = used[o.name].T_camera_board
        assert pose is not None
        outline = board.outline_board[[0, 1, 2, 3, 0]] @ pose[:3, :3].T + pose[:3, 3]
        points = o.points_lidar @ T[:3, :3].T + T[:3, 3]
        for ax, across in ((top, 0), (side, 1)):
            ax.plot(outline[:, 2], outline[:, across], lw=1)
            ax.plot(points[::3, 2], points[::3, across], ".", ms=1, color="0.35")
    origin = T[:3, 3]
    for ax, across, name in ((top, 0, "x"), (side, 1, "y")):
        _sensors(ax, float(origin[2]), float(origin[across]), name)
    return figure


def _sensors(ax: Axes, z: float, across: float, name: str) -> None:
    ax.plot(0, 0, "^", color="#1f4e79", label="camera")
    ax.plot(z, across, "o", color="#c0562b", label="LiDAR")
    ax.set_xlabel("camera z [m]")
    ax.set_ylabel(f"camera {name} [m]")
    ax.set_aspect("equal")
    ax.invert_yaxis()
    ax.legend(loc="upper left")
