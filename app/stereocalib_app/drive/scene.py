"""The 3-D view: the camera over the measured road with the cloud of the frame, and the drive's paths.

World axes are those of the first left camera (x right, y down, z forward). When the view follows the car, the
world is moved under it instead, so that every browser keeps its own viewpoint.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import viser.transforms as vtf
from numpy.typing import NDArray

from stereocalib_app.widgets import palette
from stereocalib_core.geometry import Extrinsics, StereoCamera, invert_transform
from stereocalib_core.numeric.arrays import Array

_LATERAL_M = np.array([-6.0, -1.75, 1.75, 6.0])
_AHEAD_M = np.arange(0.0, 40.1, 5.0)
_FINE_X_M, _FINE_Z_M = np.arange(-6.0, 6.1, 1.0), np.arange(0.0, 40.1, 1.0)
_FINE_RGB = (52, 92, 84)
_AXES_RGB = np.array([[230, 80, 60], [60, 180, 80], [80, 130, 240]], dtype=np.uint8)
_OCTAHEDRON = 0.28 * np.array(
    [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=np.float32
)
_OCTAHEDRON_FACES = np.array(
    [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]], dtype=np.uint32
)


def _grid(x_m: Array, z_m: Array) -> NDArray[np.float32]:
    """(N, 2, 3) segments of a grid on the road."""
    along = [[[x, 0, z_m[0]], [x, 0, z_m[-1]]] for x in x_m]
    across = [[[x_m[0], 0, z], [x_m[-1], 0, z]] for z in z_m]
    return np.array(along + across, dtype=np.float32)


def path_segments(positions: Array) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """(N, 3) positions with NaN gaps to (M, 2, 3) segments of known neighbours, and their first frames."""
    pairs = np.stack([positions[:-1], positions[1:]], axis=1)
    known = np.flatnonzero(np.isfinite(pairs).all(axis=(1, 2)))
    return pairs[known].astype(np.float32), known


class Scene:
    """The nodes of one page (shared or of one browser)."""

    def __init__(self, api: Any, camera: StereoCamera, prefix: str) -> None:
        self._scene, self._camera, self._root_name = api.scene, camera, f"/{prefix}"
        scene, root = self._scene, self._root_name
        scene.set_up_direction("-y")
        self.root = scene.add_frame(root, show_axes=False)
        self._car = scene.add_frame(f"{root}/car", show_axes=False)
        self._road = scene.add_line_segments(
            f"{root}/car/road",
            _grid(_LATERAL_M, _AHEAD_M),
            palette.ROAD,
            thickness=1.5,
            thickness_units="screen",
        )
        # Lines, not a surface: a transparent mesh of this size takes seconds a frame without a graphics card.
        self._fine = scene.add_line_segments(
            f"{root}/car/fine",
            _grid(_FINE_X_M, _FINE_Z_M),
            _FINE_RGB,
            thickness=1.0,
            thickness_units="screen",
        )
        self._mount = scene.add_frame(f"{root}/car/camera", show_axes=False)
        ends = 0.5 * np.stack([np.zeros((3, 3)), np.eye(3)], axis=1)
        scene.add_line_segments(
            f"{root}/car/camera/axes",
            ends,
            np.repeat(_AXES_RGB[:, None], 2, axis=1),
            thickness=3.0,
            thickness_units="screen",
        )
        self._frustum = scene.add_camera_frustum(
            f"{root}/car/camera/frustum",
            fov=float(2 * np.arctan2(camera.height / 2, camera.focal_px)),
            aspect=camera.width / camera.height,
            scale=0.9,
            thickness=2.0,
            thickness_units="screen",
            color=palette.HORIZON,
        )
        self._cloud = scene.add_point_cloud(
            f"{root}/car/camera/cloud",
            np.zeros((1, 3), np.float32),
            np.zeros((1, 3), np.uint8),
            point_size=0.06,
            precision="float32",
            point_shading="flat",
        )
        # viser makes a new material for every change of colours; while no other cloud holds the old one's program, a
        # browser compiles it again, which takes longer than all the rest of a frame without a graphics card.
        scene.add_point_cloud(
            f"{root}/program",
            np.zeros((2, 3), np.float32),
            np.zeros((2, 3), np.uint8),
            point_size=1e-6,
            precision="float32",
            point_shading="flat",
        )
        self._plumb = scene.add_line_segments(
            f"{root}/car/plumb",
            np.array([[[0, 0, 0], [0, -1.65, 0]]], np.float32),
            palette.INK_SOFT,
            thickness=3,
            thickness_units="screen",
        )
        self._label = scene.add_label(f"{root}/car/label", "", position=(0.0, -2.1, 0.0))
        self._paths: dict[str, Any] = {}
        self._markers: Any | None = None

    def show_road(self, extrinsics: Extrinsics | None, caption: str) -> None:
        """Put the camera over the road; without an estimate the road disappears."""
        known = extrinsics is not None
        for node in (self._road, self._fine, self._plumb):
            node.visible = known
        self._label.text = caption
        if extrinsics is not None:
            T = invert_transform(extrinsics.T_camera_road)
            self._mount.wxyz = vtf.SO3.from_matrix(T[:3, :3]).wxyz
            self._mount.position = T[:3, 3]
            self._plumb.points = np.array([[[0, 0, 0], [0, -extrinsics.height_m, 0]]], np.float32)
            self._label.position = (0.35, -0.5 * extrinsics.height_m, 0.0)

    def show_cloud(
        self, points: NDArray[np.float32], colors: NDArray[np.uint8], visible: bool, size_m: float
    ) -> None:
        """The coloured points of the frame, in the camera frame [m]."""
        self._cloud.visible = visible
        self._cloud.point_size = size_m
        self._cloud.points = points
        self._cloud.colors = colors

    def show_image(self, image: NDArray[np.uint8] | None) -> None:
        """The picture in the frustum, or none."""
        self._frustum.image = image

    def place_car(self, T_world_road: Array, follow: bool) -> None:
        """Move the car through the world, or the world under the car."""
        rotation = vtf.SO3.from_matrix(T_world_road[:3, :3])
        self._car.wxyz, self._car.position = rotation.wxyz, T_world_road[:3, 3]
        if follow:
            T = invert_transform(T_world_road)
            self.root.wxyz, self.root.position = vtf.SO3.from_matrix(T[:3, :3]).wxyz, T[:3, 3]
        else:
            self.root.wxyz, self.root.position = (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0)

    def show_paths(
        self, paths: Mapping[str, Array], visible: Mapping[str, bool], colors: Mapping[str, NDArray[np.uint8]]
    ) -> None:
        """(N, 3) positions by name, with (N, 3) colours where given; ground truth is dashed."""
        for name, positions in paths.items():
            segments, known = path_segments(positions)
            if name == "ground_truth":
                segments, known = segments[::2], known[::2]
            color: Any = palette.VARIANT.get(name, palette.COMPARED)
            if name in colors and len(segments):
                color = np.stack([colors[name][known], colors[name][known + 1]], axis=1)
            if len(segments) == 0:
                segments = np.zeros((1, 2, 3), np.float32)
            self._show_path(name, segments, color, visible.get(name, True))
        for name in set(self._paths) - set(paths):
            self._paths.pop(name).remove()

    def _show_path(self, name: str, segments: NDArray[np.float32], color: Any, visible: bool) -> None:
        node = self._paths.get(name)
        if node is None:
            self._paths[name] = self._scene.add_line_segments(
                f"{self._root_name}/paths/{name}",
                segments,
                color,
                thickness=5 if name == "autocalibrated" else 3,
                thickness_units="screen",
                visible=visible,
            )
            return
        # Points and colours must match in length at every moment.
        node.colors = np.asarray(palette.INK_SOFT, np.uint8)
        node.points = segments
        node.colors = np.asarray(color, dtype=np.uint8)
        node.visible = visible

    def show_markers(self, positions: Array, visible: bool) -> Any | None:
        """(N, 3) clickable poses; the node where it is new, else None."""
        wxyzs = np.tile([1.0, 0.0, 0.0, 0.0], (len(positions), 1))
        held = np.nan_to_num(positions)
        if self._markers is not None:
            self._markers.visible = visible
            self._markers.batched_wxyzs = wxyzs.astype(np.float32)
            self._markers.batched_positions = held.astype(np.float32)
            return None
        self._markers = self._scene.add_batched_meshes_simple(
            f"{self._root_name}/paths/markers",
            _OCTAHEDRON,
            _OCTAHEDRON_FACES,
            wxyzs,
            held,
            batched_colors=palette.VARIANT["autocalibrated"],
            wireframe=True,
            lod="off",
            cast_shadow=False,
            receive_shadow=False,
            visible=visible,
        )
        return self._markers

    def close(self) -> None:
        """Remove every node."""
        self.root.remove()
