"""The paper's simulated rig: a pinhole camera and a VLP-16 that look at one board after the other.

Zheng et al. leave some things open; what is assumed here is written into every report (`ASSUMPTIONS`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stereocalib_core.boards.camera import BoardCamera
from stereocalib_core.boards.chessboard import board_pose, plane_of_board
from stereocalib_core.boards.observation import BoardSpec, PairObservation
from stereocalib_core.boards.planes import fit_plane
from stereocalib_core.boards.rotations import rotation_from_roll_pitch_yaw, rotation_from_vector
from stereocalib_core.geometry import invert_transform, transform
from stereocalib_core.numeric.arrays import Array

BOARD = BoardSpec(columns=8, rows=8, square_m=0.09, width_m=0.81, height_m=0.81)
CAMERA = BoardCamera(
    "pinhole", 640, 480, np.array([[714.0, 0.0, 319.5], [0.0, 714.0, 239.5], [0.0, 0.0, 1.0]]), np.zeros(0)
)
ELEVATIONS_RAD = np.deg2rad(np.arange(-15.0, 16.0, 2.0))
AZIMUTH_STEP_RAD = np.deg2rad(0.4)
LEAST_BEAMS = 3
LEAST_INCIDENCE = 0.25
RIGHT_FORWARD_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""Rotation of the paper's LiDAR axes (x right, y forward, z up) into those of a camera."""
T_CAMERA_LIDAR = transform(
    rotation_from_vector(np.deg2rad([3.0, -2.0, 1.5])) @ RIGHT_FORWARD_UP, np.array([0.08, 0.15, -0.06])
)
ASSUMPTIONS = (
    "camera 640x480, focal length 714 px (the paper gives none), no distortion, intrinsics known",
    "LiDAR axes x right, y forward, z up; 16 beams from -15 to 15 deg in steps of 2 deg, 0.4 deg in azimuth (the "
    "paper says 0.1-0.4 deg)",
    "board centre uniform in range 2-4 m, azimuth and elevation within 30 deg; roll within 30 deg, pitch within "
    "90 deg, yaw 60-120 deg of R = Rz(yaw) Ry(pitch) Rx(roll), normal = R e_z, each uniform",
    "a board counts when all corners are in the picture, at least 3 beams cross it, and neither sensor's line of "
    "sight to it is flatter than 14.5 deg",
    "noise: Gaussian, 0.5 px on each corner coordinate, 0.03 m on each range along its ray; which points are on the "
    "board is known",
    "true transform: 0.08, 0.15, -0.06 m and a turn of 3, -2, 1.5 deg against parallel axes",
)


@dataclass(frozen=True)
class SimulatedNoise:
    """Gaussian sigmas: corner coordinate [px], range [m]."""

    corner_px: float = 0.5
    range_m: float = 0.03


def simulate_boards(
    count: int, rng: np.random.Generator, noise: SimulatedNoise, T_camera_lidar: Array = T_CAMERA_LIDAR
) -> list[PairObservation]:
    """`count` boards as both sensors see them, drawn until each is fully in view."""
    boards: list[PairObservation] = []
    while len(boards) < count:
        observation = observe(f"board{len(boards):02d}", draw_pose(rng), rng, noise, T_camera_lidar)
        if observation is not None:
            boards.append(observation)
    return boards


def draw_pose(rng: np.random.Generator) -> Array:
    """T_lidar_board (4, 4): a random board after the paper's ranges."""
    azimuth, elevation = np.deg2rad(rng.uniform(-30.0, 30.0, 2))
    reach = rng.uniform(2.0, 4.0)
    center = reach * np.array(
        [np.sin(azimuth) * np.cos(elevation), np.cos(azimuth) * np.cos(elevation), np.sin(elevation)]
    )
    roll, pitch, yaw = np.deg2rad([rng.uniform(-30, 30), rng.uniform(-90, 90), rng.uniform(60, 120)])
    R = rotation_from_roll_pitch_yaw(roll, pitch, yaw)
    # The pattern is on the side that the sensors see: turn the board's back away from them.
    return transform(R if R[:, 2] @ center > 0 else R @ np.diag([1.0, -1.0, -1.0]), center)


def observe(
    name: str, T_lidar_board: Array, rng: np.random.Generator, noise: SimulatedNoise, T_camera_lidar: Array
) -> PairObservation | None:
    """One posed board through both sensors; None when it is not fully in the picture or hardly hit by beams."""
    T_camera_board = T_camera_lidar @ T_lidar_board
    corners = CAMERA.project(BOARD.corners_board @ T_camera_board[:3, :3].T + T_camera_board[:3, 3])
    if not (np.isfinite(corners).all() and (corners >= 0).all() and (corners <= [639, 479]).all()):
        return None
    if min(_incidence(T_camera_board), _incidence(T_lidar_board)) < LEAST_INCIDENCE:
        return None
    points = cast_rays(T_lidar_board)
    beams = np.unique(np.round(np.arcsin(points[:, 2] / np.linalg.norm(points, axis=1)), 3))
    if len(beams) < LEAST_BEAMS:
        return None
    corners = corners + noise.corner_px * rng.standard_normal(corners.shape)
    reach = np.linalg.norm(points, axis=1, keepdims=True)
    points = points * (1.0 + noise.range_m * rng.standard_normal(reach.shape) / reach)
    posed = board_pose(CAMERA, corners, BOARD)
    if posed is None:
        return None
    T, covariance, rms = posed
    return PairObservation(
        name,
        corners=corners,
        T_camera_board=T,
        points_lidar=points,
        camera_plane=plane_of_board(T, covariance * max(noise.corner_px, 1e-6) ** 2),
        lidar_plane=fit_plane(points, max(noise.range_m, 1e-6), T_lidar_board[:3, 3]),
        corner_rms_px=rms,
    )


def _incidence(T_sensor_board: Array) -> float:
    center = T_sensor_board[:3, 3]
    return float(abs(T_sensor_board[:3, 2] @ center) / np.linalg.norm(center))


def cast_rays(T_lidar_board: Array) -> Array:
    """(N, 3) noise-free returns of the VLP-16 from a board [m]."""
    center = T_lidar_board[:3, 3]
    middle = np.arctan2(center[0], center[1])
    width = np.arcsin(min(1.0, 0.5 * BOARD.diagonal_m / float(np.hypot(center[0], center[1]))))
    first, last = np.ceil((middle - width) / AZIMUTH_STEP_RAD), np.floor((middle + width) / AZIMUTH_STEP_RAD)
    azimuth, elevation = np.meshgrid(np.arange(first, last + 1) * AZIMUTH_STEP_RAD, ELEVATIONS_RAD)
    rays = np.stack(
        [np.sin(azimuth) * np.cos(elevation), np.cos(azimuth) * np.cos(elevation), np.sin(elevation)], axis=-1
    ).reshape(-1, 3)
    normal = T_lidar_board[:3, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = (normal @ center) / (rays @ normal)
    points = rays[(reach > 0.1) & (reach < 100.0)] * reach[(reach > 0.1) & (reach < 100.0), None]
    on_board = points @ invert_transform(T_lidar_board)[:3, :3].T + invert_transform(T_lidar_board)[:3, 3]
    inside = (np.abs(on_board[:, 0]) < BOARD.width_m / 2) & (np.abs(on_board[:, 1]) < BOARD.height_m / 2)
    return np.asarray(points[inside])
