"""Triangles of the things in a town: boxes, houses, cars, trees, poles."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.numeric.arrays import Array
from stereocalib_core.simulator.raster import FLAG_ALPHA, FLAG_TWO_SIDED
from stereocalib_core.simulator.shade import OBSTACLE


@dataclass(frozen=True)
class Mesh:
    """T triangles. vertices, normals (T, 3, 3); coordinates (T, 3, 2) texture u, v [texels]; tones (T,) factor on
    the texture; textures, flags (T,) int32; labels (T,) uint8. Seen from outside, corners go round clockwise."""

    vertices: Array
    normals: Array
    coordinates: Array
    tones: Array
    textures: NDArray[np.int32]
    flags: NDArray[np.int32]
    labels: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.tones)

    def moved(self, rotation: Array, translation: Array) -> Mesh:
        """The same elsewhere."""
        return Mesh(
            self.vertices @ rotation.T + translation,
            self.normals @ rotation.T,
            *(self.coordinates, self.tones, self.textures, self.flags, self.labels),
        )


def join(meshes: list[Mesh]) -> Mesh:
    """All triangles of several meshes."""
    return Mesh(*(np.concatenate([getattr(m, f.name) for m in meshes]) for f in fields(Mesh)))


def triangles(
    vertices: Array,
    coordinates: Array,
    texture: int,
    tone: float = 1.0,
    normals: Array | None = None,
    flags: int = 0,
    label: int = OBSTACLE,
    outward: Array | None = None,
) -> Mesh:
    """Triangles (T, 3, 3) of one material; flat normals unless given; turned to face `outward` (T, 3) if given."""
    face = np.cross(vertices[:, 1] - vertices[:, 0], vertices[:, 2] - vertices[:, 0])
    if outward is not None:
        turn = np.einsum("ij,ij->i", face, outward) < 0
        vertices, coordinates = vertices.copy(), coordinates.copy()
        vertices[turn] = vertices[turn][:, [0, 2, 1]]
        coordinates[turn] = coordinates[turn][:, [0, 2, 1]]
        if normals is not None:
            normals = normals.copy()
            normals[turn] = normals[turn][:, [0, 2, 1]]
        face = np.where(turn[:, None], -face, face)
    if normals is None:
        unit = face / np.maximum(np.linalg.norm(face, axis=1, keepdims=True), 1e-12)
        normals = np.repeat(unit[:, None, :], 3, axis=1)
    n = len(vertices)
    return Mesh(
        np.ascontiguousarray(vertices, dtype=np.float64),
        np.ascontiguousarray(normals, dtype=np.float64),
        np.ascontiguousarray(coordinates, dtype=np.float64),
        np.full(n, tone),
        np.full(n, texture, np.int32),
        np.full(n, flags, np.int32),
        np.full(n, label, np.uint8),
    )


def quad(corners: Array, uv: Array, texture: int, tone: float = 1.0, outward: Array | None = None) -> Mesh:
    """Four corners (4, 3) in order round the quad."""
    pick = np.array([[0, 1, 2], [0, 2, 3]])
    out = None if outward is None else np.repeat(np.asarray(outward, dtype=np.float64)[None], 2, axis=0)
    return triangles(corners[pick], uv[pick], texture, tone, outward=out)


def box(
    size: tuple[float, float, float], texture: int, texel_m: float, tone: float = 1.0, shift: float = 0.0
) -> Mesh:
    """Walls and lid of a box, x and z centred, standing on Y = 0 (Y down): width x, height, length z [m]."""
    w, h, d = size[0] / 2, size[1], size[2] / 2
    meshes = []
    for sx, sz in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        across = np.array([sz * w, 0, sx * d]) if sx == 0 else np.array([0, 0, d])
        center = np.array([sx * w, 0.0, sz * d])
        half = np.linalg.norm(across)
        corners = np.array([center - across, center + across, center + across, center - across])
        corners[2:, 1] = -h
        uv = np.array([[-half, 0], [half, 0], [half, -h], [-half, -h]]) / texel_m + [shift, 0.0]
        meshes.append(quad(corners, uv, texture, tone, np.array([sx, 0.0, sz])))
    lid = np.array([[-w, -h, -d], [w, -h, -d], [w, -h, d], [-w, -h, d]])
    meshes.append(quad(lid, lid[:, [0, 2]] / texel_m, texture, tone, np.array([0.0, -1.0, 0.0])))
    return join(meshes)


def house(
    width: float,
    depth: float,
    eaves: float,
    rise: float,
    facade: int,
    roof: int,
    tone: float,
    roof_tone: float,
) -> Mesh:
    """A house with its front at z = 0 towards -z, gabled along x; base at Y = 0, some of it below."""
    n, below = 0.02, 1.0
    w = width / 2
    meshes = []
    walls = [((-w, 0.0), (w, 0.0), (0, 0, -1)), ((w, 0.0), (w, depth), (1, 0, 0))]
    walls += [((w, depth), (-w, depth), (0, 0, 1)), ((-w, depth), (-w, 0.0), (-1, 0, 0))]
    for i, (a, b, out) in enumerate(walls):
        run = float(np.hypot(b[0] - a[0], b[1] - a[1]))
        corners = np.array(
            [[a[0], below, a[1]], [b[0], below, b[1]], [b[0], -eaves, b[1]], [a[0], -eaves, a[1]]]
        )
        start = 137.0 * i
        uv = np.array([[start, 512 + below / n], [start + run / n, 512 + below / n]])
        uv = np.concatenate([uv, [[start + run / n, 512 - eaves / n], [start, 512 - eaves / n]]])
        meshes.append(quad(corners, uv, facade, tone, np.array(out, dtype=np.float64)))
    for x in (-w, w):
        gable = np.array([[[x, -eaves, 0.0], [x, -eaves, depth], [x, -eaves - rise, depth / 2]]])
        uv = np.array([[[0, 30], [depth / n, 30], [depth / 2 / n, 12.0]]])
        meshes.append(triangles(gable, uv, facade, tone, outward=np.array([[np.sign(x), 0.0, 0.0]])))
    over = 0.45
    slant = float(np.hypot(depth / 2, rise))
    for z, away in ((-over, -1.0), (depth + over, 1.0)):
        low = -eaves + rise * over / (depth / 2)
        corners = np.array([[-w - over, low, z], [w + over, low, z]])
        ridge = [[w + over, -eaves - rise, depth / 2], [-w - over, -eaves - rise, depth / 2]]
        corners = np.concatenate([corners, ridge])
        uv = np.array([[0, 0], [width, 0], [width, slant], [0, slant]]) / n
        roofing = quad(corners, uv, roof, roof_tone, np.array([0.0, -1.0, away]))
        roofing.flags[:] |= FLAG_TWO_SIDED
        meshes.append(roofing)
    return join(meshes)


def loft(rings: Array, uv: Array, texture: int, tone: float, axis: Array) -> Mesh:
    """The skin over rings (N, M, 3) with coordinates (N, M, 2), smooth, facing away from points `axis` (N, 3)."""
    n, m = rings.shape[:2]
    away = rings - axis[:, None, :]
    along = np.gradient(rings, axis=0)
    round_ = np.gradient(rings, axis=1)
    normal = np.cross(along, round_)
    normal *= np.where(np.einsum("ijk,ijk->ij", normal, away) < 0, -1.0, 1.0)[..., None]
    normal /= np.maximum(np.linalg.norm(normal, axis=2, keepdims=True), 1e-9)
    i, j = (a.ravel() for a in np.mgrid[0 : n - 1, 0 : m - 1])
    index = np.concatenate(
        [np.stack([(i, j), (i + 1, j), (i + 1, j + 1)]), np.stack([(i, j), (i + 1, j + 1), (i, j + 1)])],
        axis=2,
    )
    a, b = index[:, 0].T, index[:, 1].T
    return triangles(
        rings[a, b], uv[a, b], texture, tone, normals=normal[a, b], outward=away[a, b].mean(axis=1)
    )


def pole(height: float, radius: float, texture: int, tone: float, sides: int = 6, taper: float = 0.8) -> Mesh:
    """A round pole standing on Y = 0, a little below."""
    angle = np.linspace(0, 2 * np.pi, sides + 1)
    ring = np.stack([np.cos(angle), np.zeros_like(angle), np.sin(angle)], axis=1)
    heights = np.array([0.4, -height])
    rings = np.stack([ring * radius, ring * radius * taper]) + np.array([[[0, y, 0]] for y in heights])
    uv = np.zeros((2, sides + 1, 2))
    uv[..., 0] = np.linspace(0, 64, sides + 1)
    uv[..., 1] = (heights / 0.02)[:, None]
    return loft(rings, uv, texture, tone, np.array([[0, y, 0] for y in heights]))


def tree(
    rng: np.random.Generator, bark: int, leaves: int, trunk_m: float, crown_m: float, tall: float, cards: int
) -> Mesh:
    """A tree on Y = 0: a trunk and `cards` branches full of leaves in an egg of radius `crown_m`, height `tall`."""
    meshes = [pole(trunk_m + 0.4 * tall, 0.05 + 0.035 * crown_m, bark, 0.8, 7, 0.5)]
    middle = np.array([0.0, -(trunk_m + 0.5 * tall), 0.0])
    size = 0.42 * crown_m + 0.25
    direction = rng.standard_normal((cards, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    # from the outside in: what is drawn first hides the rest and spares its filling
    reach = -np.sort(-(rng.uniform(0.25, 1.0, cards) ** 0.5))[:, None]
    offset = direction * reach * np.array([crown_m - 0.5 * size, 0.5 * tall, crown_m - 0.5 * size])
    centers = middle + offset
    facing = direction + 0.8 * rng.standard_normal((cards, 3))
    facing /= np.linalg.norm(facing, axis=1, keepdims=True)
    side = np.cross(facing, rng.standard_normal((cards, 3)))
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    up = np.cross(facing, side)
    half = size * rng.uniform(0.75, 1.3, (cards, 1))
    corner = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    corners = np.stack([centers + half * (a * side + b * up) for a, b in corner], axis=1)
    uv = np.broadcast_to(np.array([[0, 0], [512, 0], [512, 512], [0, 512]], float), (cards, 4, 2))
    pick = np.array([[0, 1, 2], [0, 2, 3]])
    normals = np.repeat(
        ((corners - middle) / np.array([crown_m, tall / 2, crown_m]))[:, pick].reshape(-1, 3, 3), 1, axis=0
    )
    normals /= np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-9)
    crown = triangles(
        corners[:, pick].reshape(-1, 3, 3),
        uv[:, pick].reshape(-1, 3, 2),
        leaves,
        normals=normals,
        flags=FLAG_ALPHA | FLAG_TWO_SIDED,
    )
    depth = np.repeat(0.45 + 0.6 * reach[:, 0] * rng.uniform(0.8, 1.2, cards), 2)
    crown.tones[:] = depth
    return join([*meshes, crown])


def car(side: int, top: int, front: int, rear: int, style: int) -> Mesh:
    """A car on Y = 0, nose to +z, its middle at the origin; tones are of mid grey paint."""
    length = 4.25 if style == 0 else 4.45
    roof_m = 1.46 if style == 0 else 1.50
    tail, nose = (0.40, 3.00) if style == 0 else (0.22, 3.22)
    z = np.array(
        [
            0.0,
            0.10,
            tail,
            tail + 0.25,
            tail + 0.55,
            1.3,
            1.9,
            nose - 0.62,
            nose - 0.3,
            nose,
            3.6,
            4.0,
            4.15,
            length,
        ]
    )
    z = np.sort(z)
    ridge = np.interp(
        z,
        [0, 0.1, tail, tail + 0.5, 1.5, nose - 0.6, nose, 4.0, 4.15, length],
        [0.80, 0.95, 0.98, roof_m - 0.05, roof_m, roof_m - 0.03, 0.98, 0.82, 0.74, 0.62],
    )
    wide = np.interp(z, [0, 0.15, 0.6, 3.4, 4.0, length], [0.74, 0.83, 0.88, 0.88, 0.83, 0.70])
    belt = np.minimum(0.92, ridge - 0.03)
    lean = np.where(ridge > 1.0, 0.80, 0.93)
    half = []
    for a, y in (
        (0.97, np.full_like(z, 0.02)),
        (1.0, np.full_like(z, 0.45)),
        (0.995, belt * 0.82),
        (0.97, belt),
    ):
        half.append(np.stack([wide * a, -y, z - length / 2], axis=1))
    shoulder = np.stack([wide * lean, -(ridge - 0.07 * (ridge > 1.0) - 0.01), z - length / 2], axis=1)
    half.append(shoulder)
    sides = np.stack(half, axis=1)
    axis = np.stack([np.zeros_like(z), np.full_like(z, -0.5), z - length / 2], axis=1)
    meshes = []
    for sign in (-1.0, 1.0):
        rings = sides * np.array([sign, 1.0, 1.0])
        uv = np.stack([(rings[..., 2] + length / 2) * 100, 255 + rings[..., 1] * 100], axis=-1)
        meshes.append(loft(rings, uv, side, 1.0, axis))
    across = np.linspace(-1, 1, 5)
    bow = 0.05 * (1 - across**2)
    roof = shoulder[:, None, :] * np.stack([across, np.ones(5), np.ones(5)], axis=1)[None]
    roof[..., 1] -= bow[None] + 0.02 * (1 - np.abs(across))
    uv = np.stack([(roof[..., 2] + length / 2) * 100, 128 + roof[..., 0] * 100], axis=-1)
    meshes.append(loft(roof, uv, top, 1.0, axis))
    for end, texture, out in ((0, rear, -1.0), (-1, front, 1.0)):
        ring = sides[end]
        left = ring * np.array([-1.0, 1.0, 1.0])
        strips = [(left[k], ring[k], ring[k + 1], left[k + 1]) for k in range(len(ring) - 1)]
        # and up to the bow of the bonnet or the boot
        level = np.stack([roof[end, :, 0], np.full(5, shoulder[end, 1]), roof[end, :, 2]], axis=1)
        strips += [(level[k], level[k + 1], roof[end, k + 1], roof[end, k]) for k in range(4)]
        for strip in strips:
            corners = np.array(strip)
            uv_end = np.stack([128 + corners[:, 0] * 100, 255 + corners[:, 1] * 100], axis=1)
            meshes.append(quad(corners, uv_end, texture, 1.0, np.array([0.0, 0.0, out])))
    return join(meshes)
