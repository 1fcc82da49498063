"""One camera's view of the world: what it sees, how far, and what that is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.geometry import StereoCamera, invert_transform
from stereocalib_core.synthetic import raster
from stereocalib_core.synthetic.furniture import Instance
from stereocalib_core.synthetic.ground import AHEAD_M, BEHIND_M
from stereocalib_core.synthetic.shade import shade
from stereocalib_core.synthetic.world import (
    AMBIENT,
    SUN,
    SUNLIGHT,
    TEXTURE_GRAIN,
    TEXTURE_MAP,
    TEXTURE_SKY,
    World,
)

Array = NDArray[np.float64]
FAR_M = 170.0
_MAX_VISIBLE = 60_000
_HAZE_GREY = 190.0


@dataclass(frozen=True)
class View:
    """grey (H, W) float32 of a perfect sensor; depth_m (H, W) float32, 0 = none; label (H, W) uint8."""

    grey: NDArray[np.float32]
    inverse_depth: NDArray[np.float32]
    label: NDArray[np.uint8]


@dataclass(frozen=True)
class Draws:
    """Ranges of triangles (D, 2), their poses to the camera (D, 3, 4), suns (D, 3), gains (D, 2)."""

    ranges: NDArray[np.int64]
    poses: Array
    suns: Array
    gains: Array


def list_draws(world: World, T_world_camera: Array, s_m: float, things: list[Instance], lens: float) -> Draws:
    """What may be in view, nearest first. `lens`: tangent of the wider half of the field of view."""
    T = invert_transform(T_world_camera)[:3]
    near, far = np.searchsorted(world.rows_s_m, [s_m - BEHIND_M, s_m + AHEAD_M])
    near, far = max(int(near) - 1, 0), min(int(far), len(world.rows_s_m) - 1)
    ranges = [(near * world.ground_row_triangles, far * world.ground_row_triangles)]
    poses, suns, gains, keys = [T], [SUN], [(AMBIENT, SUNLIGHT)], [0.0]
    if world.rest[1] > world.rest[0]:
        ranges.append(world.rest)
        poses.append(T)
        suns.append(SUN)
        gains.append((AMBIENT, SUNLIGHT))
        keys.append(1e9)
    for thing in (*_in_sight(world, T, lens), *things):
        first, last, _ = world.templates[thing.kind]
        center = T[:, :3] @ thing.position + T[:, 3]
        ranges.append((first, last))
        pose = np.empty((3, 4))
        pose[:, :3] = T[:, :3] @ thing.rotation
        pose[:, 3] = center
        poses.append(pose)
        suns.append(SUN @ thing.rotation)
        gains.append((AMBIENT * thing.tone, SUNLIGHT * thing.tone))
        keys.append(float(np.linalg.norm(center)))
    order = np.argsort(np.array(keys), kind="stable")
    return Draws(
        np.array(ranges, np.int64)[order],
        np.array(poses)[order],
        np.array(suns)[order],
        np.array(gains)[order],
    )


def _in_sight(world: World, T_camera_world: Array, lens: float) -> list[Instance]:
    """The standing things whose spheres reach into the field of view."""
    if not world.standing:
        return []
    centers = world.positions @ T_camera_world[:, :3].T + T_camera_world[:, 3]
    x, z, radius = np.abs(centers[:, 0]), centers[:, 2], world.radii
    near = np.linalg.norm(centers, axis=1) - radius <= FAR_M
    inside = (z >= -radius) & (x - radius * np.hypot(1.0, lens) <= np.maximum(z, 0.0) * lens)
    return [world.standing[k] for k in np.flatnonzero(near & inside)]


class Renderer:
    """Renders views of one world; keeps its scratch memory, so one thread at a time."""

    def __init__(self, world: World, camera: StereoCamera) -> None:
        self.world = world
        self.camera = camera
        h, w = camera.height * raster.SAMPLES, camera.width * raster.SAMPLES
        self._inverse_depth = np.zeros((h, w), np.float32)
        self._ids = np.full((h, w), -1, np.int32)
        self._planes = np.empty((_MAX_VISIBLE, raster.PLANES))
        self._source = np.empty(_MAX_VISIBLE, np.int64)
        self._boxes = np.empty((_MAX_VISIBLE, 4), np.int64)

    def view(
        self,
        T_world_camera: Array,
        s_m: float,
        things: list[Instance],
        shadows: Array,
        cx_px: float,
        drift: Array,
        contrast: float = 1.0,
        road_grey: float = 110.0,
    ) -> View:
        """The view from one camera.

        s_m: where along the course. things, shadows: what moves. drift: image motion during the exposure, as in
        `shade`. contrast: of the ground's texture, with `road_grey` in its place as it goes to 0.
        """
        camera, world, mesh = self.camera, self.world, self.world.mesh
        K = (camera.focal_px, cx_px, camera.cy_px)
        widest = max(cx_px, camera.width - cx_px) / camera.focal_px
        draws = list_draws(world, T_world_camera, s_m, things, widest)
        count = raster.set_up(
            *(mesh.vertices, mesh.normals, mesh.coordinates, mesh.tones, mesh.flags),
            *(draws.ranges, draws.poses, draws.suns, draws.gains, K, (camera.width, camera.height)),
            *(self._planes, self._source, self._boxes),
        )
        self._inverse_depth.fill(0.0)
        self._ids.fill(-1)
        atlas = world.atlas
        textures = (atlas.texels, atlas.table, atlas.levels)
        raster.fill(
            *(count, self._planes, self._source, self._boxes, mesh.flags, mesh.textures),
            *(*textures, self._inverse_depth, self._ids),
        )
        grey = np.empty((camera.height, camera.width), np.float32)
        inverse_depth, label = np.empty_like(grey), np.empty(grey.shape, np.uint8)
        ground = np.array([contrast, TEXTURE_GRAIN, TEXTURE_MAP, road_grey, _HAZE_GREY, world.map_texel_m])
        shade(
            *(self._planes, self._source, mesh.flags, mesh.textures, mesh.labels, self._ids, *textures, K),
            *(np.ascontiguousarray(T_world_camera[:3, :3]), TEXTURE_SKY, drift, shadows, ground),
            *(grey, inverse_depth, label),
        )
        return View(grey, inverse_depth, label)
