"""A straight drive past boxes that face the camera, in closed form: what scan and picture keep of their edges."""

from __future__ import annotations

import numpy as np

from stereocalib_core.back.lidar.residual_transform import moved, shown_by_road
from stereocalib_core.geometry import (
    Extrinsics,
    StereoCamera,
    invert_transform,
    rotation_y,
    rotation_z,
    transform,
)
from stereocalib_core.results import FrameResult, RoadEstimate, RoadResidual, ScanSample

CAMERA = StereoCamera(1226, 370, 707.0, 601.5, 183.0, 0.537)
AXES = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
CALIBRATED = transform(rotation_y(-0.01) @ rotation_z(0.006) @ AXES, [-0.01, -0.08, -0.27])
ROAD = Extrinsics(1.65, 0.014, -0.007)
STEP_M, PERIOD_S = 1.0, 0.1


def boxes(rng: np.random.Generator, length_m: float, every_m: float) -> np.ndarray:
    """(B, 4) left, right, top and z of fronts beside the road, on average one for each `every_m` and side."""
    count = int(length_m / every_m)
    side = np.where(np.arange(2 * count) % 2, 1.0, -1.0)
    centre, half = side * rng.uniform(2.5, 9.0, 2 * count), rng.uniform(0.1, 1.0, 2 * count)
    z = rng.uniform(5.0, length_m + 40.0, 2 * count)
    return np.column_stack([centre - half, centre + half, -rng.uniform(0.0, 2.5, 2 * count), z])


def drive(
    frames: int = 60,
    true: dict[int, np.ndarray] | None = None,
    sweep: float = 0.0,
    stated_sweep: float | None = 0.0,
    every_m: float = 3.0,
    seed: int = 0,
    swap: int = 0,
    camera_jump: dict[int, np.ndarray] | None = None,
) -> tuple[list[FrameResult], np.ndarray]:
    """Results and poses of a drive.

    true: from which frame on the LiDAR stands how otherwise than calibrated, (6,). sweep: how it truly turns;
    stated_sweep: what the recording says of that. swap: each scan is that of so many frames later.
    camera_jump: (3,) shifts of the camera on the car at frames; the LiDAR's own place is not touched by them.
    """
    rng = np.random.default_rng(seed)
    world = boxes(rng, frames * STEP_M, every_m)
    place = np.zeros(3)
    results, poses = [], np.tile(np.eye(4), (frames, 1, 1))
    six = np.zeros(6)
    for frame in range(frames):
        six = (true or {}).get(frame, six)
        place = place + (camera_jump or {}).get(frame, np.zeros(3))
        poses[frame, :3, 3] = [place[0], place[1], place[2] + STEP_M * frame]
        T = moved(CALIBRATED, six)
        beams, points = _scan(world, poses[frame, :3, 3] + [0, 0, STEP_M * swap], T, sweep, rng)
        edges, patches = _picture(world, poses[frame, :3, 3], rng)
        sample = ScanSample.pack(CALIBRATED, beams, edges, points, patches, stated_sweep)
        sigma = np.array([0.004, *np.deg2rad([0.03, 0.06])])
        shown = shown_by_road(ROAD.plane().normal, CALIBRATED) @ six + sigma * rng.standard_normal(3)
        road = RoadEstimate(ROAD, np.diag(sigma**2), 300, 0.5, (5.5, 20.0))
        residual = RoadResidual(shown, np.diag(sigma**2), 3000)
        results.append(FrameResult(frame, PERIOD_S * frame, road, lidar=residual, scan=sample))
    return results, poses


def _seen(world: np.ndarray, at: np.ndarray) -> np.ndarray:
    """The boxes 5 to 40 m ahead, from the camera."""
    here = world - [at[0], at[0], at[1], at[2]]
    return here[(here[:, 3] > 5.0) & (here[:, 3] < 40.0)]


def _scan(
    world: np.ndarray, at: np.ndarray, T: np.ndarray, sweep: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Beam edges and surface points of one scan."""
    seen = _seen(world, at)
    rows = [np.arange(top, 1.6, 0.007 * z) for top, z in seen[:, 2:]]
    left, right, _, z = np.repeat(seen, [len(some) for some in rows], axis=0).T
    y = np.concatenate([*rows, np.zeros(0)])
    half = np.full(len(y), 0.5)
    # the beam that falls next to the edge is up to half a step off
    beside = rng.uniform(np.column_stack([-half, -half, left]), np.column_stack([half, half, right]))
    off = beside[:, :2] * np.deg2rad(0.18) * z[:, None]
    x = np.column_stack([left, right]) + off
    corners = np.stack([x, *np.broadcast_arrays(y[:, None], z[:, None], x)[:2]], axis=2).reshape(-1, 3)
    sides = np.tile([1.0, -1.0], len(y))
    edges = np.column_stack([_swept(corners, invert_transform(T), sweep), sides])
    points = _swept(np.column_stack([beside[:, 2], y, z]), invert_transform(T), sweep)
    for some in (edges, points):
        ranges = np.linalg.norm(some[:, :3], axis=1, keepdims=True)
        some[:, :3] *= 1.0 + 0.02 * rng.standard_normal((len(some), 1)) / ranges
    return edges, points


def _swept(points: np.ndarray, to_lidar: np.ndarray, sweep: float) -> np.ndarray:
    """Points (N, 3) of the camera's frame at the shutter as the LiDAR has them when it looks there."""
    seen = points @ to_lidar[:3, :3].T + to_lidar[:3, 3]
    for _ in range(3):
        late = sweep * PERIOD_S * np.arctan2(seen[:, 1:2], seen[:, :1]) / (2 * np.pi)
        seen = (points - [0, 0, STEP_M / PERIOD_S] * late) @ to_lidar[:3, :3].T + to_lidar[:3, 3]
    return seen


def _picture(world: np.ndarray, at: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Picture edges and patches of one pair."""
    f, cx, cy = CAMERA.focal_px, CAMERA.cx_px, CAMERA.cy_px
    edges, patches = [], []
    for left, right, top, z in _seen(world, at):
        disparity = f * CAMERA.baseline_m / z
        rows = np.arange(np.ceil((f * top / z + cy) / 4) * 4, f * 1.6 / z + cy, 4)
        for v in rows[(rows > 0) & (rows < CAMERA.height)]:
            for x, side in ((left, 1.0), (right, -1.0)):
                u = f * x / z + cx + 0.5 * rng.standard_normal()
                edges.append([u, v, disparity + 0.25 * rng.standard_normal(), side, 30.0])
        for u in np.arange(f * left / z + cx + 8, f * right / z + cx - 8, 16):
            for v in rows[2:-2:4]:
                patches.append([u, v, disparity + 0.1 * rng.standard_normal(), 0.0, 0.0])
    # and some that are of nothing that the scan shows
    clutter = np.column_stack(
        [
            rng.uniform(0, CAMERA.width, 300),
            4 * rng.integers(0, CAMERA.height // 4, 300),
            rng.uniform(10, 70, 300),
            rng.choice([-1.0, 1.0], 300),
            np.full(300, 30.0),
        ]
    )
    edges, patches = (
        np.concatenate([np.array(edges).reshape(-1, 5), clutter]),
        np.array(patches).reshape(-1, 5),
    )
    edges = edges[(edges[:, 0] > 0) & (edges[:, 0] < CAMERA.width - 1)]
    return edges[np.argsort(edges[:, 1], kind="stable")], patches[np.argsort(patches[:, 1], kind="stable")]
