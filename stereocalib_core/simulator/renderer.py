"""One camera's view of the world: what it sees, how far, and what that is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.config.scene import (
    AHEAD_M,
    AMBIENT,
    BEHIND_M,
    HAZE_GREY,
    MOST_VISIBLE,
    SEEN_M,
    SUN,
    SUNLIGHT,
)
from stereocalib_core.geometry import StereoCamera, invert_transform
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.wide import DOUBLES, FLOATS
from stereocalib_core.simulator import raster
from stereocalib_core.simulator.furniture import Instance
from stereocalib_core.simulator.shade import KINDS, measure, shade, sort_kinds
from stereocalib_core.simulator.world import TEXTURE_GRAIN, TEXTURE_MAP, TEXTURE_SKY, World


@dataclass(frozen=True)
class View:
    """grey (H, W) of a perfect sensor, inverse_depth (H, W) [1/m], 0 = none, label (H, W) as in `FrameTruth`."""

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
    near = np.linalg.norm(centers, axis=1) - radius <= SEEN_M
    inside = (z >= -radius) & (x - radius * np.hypot(1.0, lens) <= np.maximum(z, 0.0) * lens)
    return [world.standing[k] for k in np.flatnonzero(near & inside)]


class Canvas:
    """What each sample of a picture (width, height) sees of a world; scratch memory, so one thread at a time.

    ids (H S, W S) int32, -1 = nothing; planes and source as `raster.set_up` fills them.
    """

    def __init__(self, width: int, height: int) -> None:
        self.size = (width, height)
        h, w = height * raster.SAMPLES, width * raster.SAMPLES
        # a register may reach beyond the end
        self.ids = np.empty(h * w + 2 * FLOATS, np.int32)[: h * w].reshape(h, w)
        self._inverse_depth = np.empty(h * w + 2 * FLOATS, np.float32)[: h * w].reshape(h, w)
        self.planes = np.empty((MOST_VISIBLE, raster.PLANES))
        self.count = 0
        self.source = np.empty(MOST_VISIBLE, np.int64)
        self._boxes = np.empty((MOST_VISIBLE, 4), np.int64)
        self._farthest = np.empty((-(-h // raster.TILE), -(-w // raster.TILE)), np.float32)

    def draw(self, world: World, draws: Draws, K: tuple[float, float, float]) -> None:
        """Find the nearest triangle in every sample, for focal length and principal point K [px]."""
        mesh, atlas = world.mesh, world.atlas
        self.count = raster.set_up(
            *(mesh.vertices, mesh.normals, mesh.coordinates, mesh.tones, mesh.flags),
            *(draws.ranges, draws.poses, draws.suns, draws.gains, K, self.size),
            *(self.planes, self.source, self._boxes),
        )
        self._inverse_depth.fill(0.0)
        self.ids.fill(-1)
        self._farthest.fill(0.0)
        raster.fill(
            *(self.count, self.planes, self.source, self._boxes, mesh.flags, mesh.textures),
            *(atlas.texels, atlas.table, atlas.levels, self._inverse_depth, self.ids, self._farthest),
        )


def shade_scratch(width: int) -> tuple[Array, NDArray[np.int64], NDArray[np.int64], Array, Array]:
    """Of a row of pixels: what `shade` notes of each part (u, v, samples) and (triangle, column), by kind, and how many
    there are; the row itself; eight points of the sky."""
    most = raster.SAMPLES**2 * width + DOUBLES
    parts, places = np.empty((KINDS, 3, most)), np.empty((KINDS, 2, most), np.int64)
    return parts, places, np.zeros(KINDS, np.int64), np.empty(width), np.empty((2, DOUBLES))


class Renderer:
    """Renders views of one world, one at a time."""

    def __init__(self, world: World, camera: StereoCamera) -> None:
        self.world = world
        self.camera = camera
        self._canvas = Canvas(camera.width, camera.height)
        self._kinds = np.empty(MOST_VISIBLE, np.uint8)
        self._texture_of = np.empty(MOST_VISIBLE, np.int64)
        self._scratch = shade_scratch(camera.width)

    def grey(
        self,
        T_world_camera: Array,
        s_m: float,
        things: list[Instance],
        shadows: Array,
        cx_px: float,
        drift: Array,
        contrast: float = 1.0,
        road_grey: float = 110.0,
    ) -> NDArray[np.float32]:
        """(H, W) what a perfect sensor would see.

        s_m: where along the course. things, shadows: what moves. drift: image motion during the exposure, as in
        `shade`. contrast: of the ground's texture, with `road_grey` in its place as it goes to 0.
        """
        camera, mesh, atlas, canvas = self.camera, self.world.mesh, self.world.atlas, self._canvas
        K = (camera.focal_px, cx_px, camera.cy_px)
        widest = max(cx_px, camera.width - cx_px) / camera.focal_px
        canvas.draw(self.world, list_draws(self.world, T_world_camera, s_m, things, widest), K)
        grey = np.empty((camera.height, camera.width), np.float32)
        texel_m = self.world.map_texel_m
        ground = np.array([contrast, TEXTURE_GRAIN, TEXTURE_MAP, road_grey, HAZE_GREY, texel_m])
        sort_kinds(canvas.count, canvas.source, mesh.flags, mesh.textures, self._kinds, self._texture_of)
        shade(
            *(
                canvas.planes,
                self._kinds,
                self._texture_of,
                canvas.ids,
                atlas.texels,
                atlas.starts,
                atlas.sizes,
            ),
            *(K, np.ascontiguousarray(T_world_camera[:3, :3]), TEXTURE_SKY, drift, shadows, ground),
            *(grey, self._scratch),
        )
        return grey

    def measured(self, grey: NDArray[np.float32]) -> View:
        """The view whose grey was the last that `grey` gave."""
        inverse_depth, label = np.empty_like(grey), np.empty(grey.shape, np.uint8)
        canvas = self._canvas
        measure(canvas.planes, canvas.source, self.world.mesh.labels, canvas.ids, inverse_depth, label)
        return View(grey, inverse_depth, label)
