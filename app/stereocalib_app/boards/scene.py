"""The 3-D view of a camera and a LiDAR: boards from both sensors, the whole cloud, the sigma ellipsoid.

World axes are the camera's (x right, y down, z forward). What the LiDAR measured hangs below one frame that
stands where the calibration puts the LiDAR, so a nudge moves a single node.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import viser.transforms as vtf
from numpy.typing import NDArray

from stereocalib_app.boards.render import color_of
from stereocalib_app.boards.session import LidarSnapshot, PairFiles
from stereocalib_app.widgets import palette
from stereocalib_app.widgets.canvas import lookup_table
from stereocalib_core.boards import Answer, Calibration, PairObservation
from stereocalib_core.boards.trial import sigma_ellipsoid
from stereocalib_core.numeric.arrays import Array

MOST_CLOUD_POINTS, MOST_BOARD_POINTS = 40_000, 300
NEAR_M, FAR_M = 1.0, 12.0
NORMAL_M = 0.35
ELLIPSOID_GAINS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
ELLIPSOID_SHOWN_M = 0.25
CAMERA_RGB, LIDAR_RGB = palette.ROAD, palette.OBSTACLE
NEXT_RGB = (90, 170, 255)
_AXES_RGB = np.array([[230, 80, 60], [60, 180, 80], [80, 130, 240]], dtype=np.uint8)
_OCTAHEDRON = 0.045 * np.array(
    [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=np.float32
)
_FACES = np.array(
    [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]], dtype=np.uint32
)


def evenly(points: Array, most: int) -> Array:
    """At most `most` of the points, taken evenly."""
    return points[:: max(1, int(np.ceil(len(points) / most)))]


def distance_colors(points: Array) -> NDArray[np.uint8]:
    """(N, 3) RGB by the distance from the sensor, near is bright."""
    reach = np.linalg.norm(points, axis=1)
    share = np.log(np.clip(reach, NEAR_M, FAR_M) / NEAR_M) / np.log(FAR_M / NEAR_M)
    return lookup_table("viridis")[(255 * (1 - share)).astype(np.uint8)]


def outlines(poses: list[Array], outline: Array) -> NDArray[np.float32]:
    """(4 M, 2, 3) edges of posed boards."""
    edges = np.stack([outline, np.roll(outline, -1, axis=0)], axis=1)
    placed = [edges @ T[:3, :3].T + T[:3, 3] for T in poses]
    return np.concatenate(placed).astype(np.float32) if placed else np.zeros((0, 2, 3), np.float32)


def dashes(segments: NDArray[np.float32], count: int = 12) -> NDArray[np.float32]:
    """(N, 2, 3) segments to (N count, 2, 3) dashes along them, each as long as the gap behind it."""
    shares = np.arange(count, dtype=np.float32)[:, None] / count + np.array([0.0, 0.5 / count], np.float32)
    start, way = segments[:, None, None, 0], segments[:, None, None, 1] - segments[:, None, None, 0]
    return np.asarray(start + shares[None, :, :, None] * way, np.float32).reshape(-1, 2, 3)


def ellipsoid_segments(covariance: Array, gain: float, sides: int = 36) -> NDArray[np.float32]:
    """(3 sides, 2, 3) the three main ellipses of a (3, 3) covariance, `gain` times one sigma."""
    axes, turn = sigma_ellipsoid(covariance)
    angle = np.linspace(0, 2 * np.pi, sides + 1)
    rings = []
    for a, b in ((0, 1), (1, 2), (2, 0)):
        ring = np.zeros((sides + 1, 3))
        ring[:, a], ring[:, b] = gain * axes[a] * np.cos(angle), gain * axes[b] * np.sin(angle)
        ring = ring @ turn.T
        rings.append(np.stack([ring[:-1], ring[1:]], axis=1))
    return np.concatenate(rings).astype(np.float32)


def ellipsoid_gain(covariance: Array) -> int:
    """How many times it must be enlarged to be seen."""
    largest = float(sigma_ellipsoid(covariance)[0][-1])
    fitting = [g for g in ELLIPSOID_GAINS if g * largest <= ELLIPSOID_SHOWN_M]
    return fitting[-1] if fitting else 1


class LidarScene:
    """The nodes; `chosen(index)` is called when a board is clicked."""

    def __init__(self, api: Any, chosen: Callable[[Any, int], None]) -> None:
        self._scene, self._chosen = api.scene, chosen
        self._scene.set_up_direction("-y")
        self._scene.configure_default_lights(cast_shadow=False)
        self._lidar = self._scene.add_frame("/lidar", show_axes=False)
        self._scene.add_frame("/camera", show_axes=False)
        self._axes("/camera", 0.35)
        self._axes("/lidar", 0.35)
        self._scene.add_label("/camera/name", "camera", position=(0.0, 0.12, 0.0), anchor="top-center")
        self._name = self._scene.add_label(
            "/lidar/name", "LiDAR", position=(0.0, 0.0, 0.15), anchor="bottom-center"
        )
        self._next_name = self._scene.add_label(
            "/camera/next_name", "hold the next board here", position=(0.0, 0.0, 0.0), visible=False
        )
        self._cloud = self._scene.add_point_cloud(
            "/lidar/cloud", np.zeros((1, 3), np.float32), np.zeros((1, 3), np.uint8),
            point_size=0.02, precision="float32", point_shading="flat",
        )  # fmt: skip
        self._frustum: Any | None = None
        self._markers: Any | None = None
        self._marked: list[int] = []
        self._shown_pair, self._shown_cloud = -1, ""
        self._shown_result: Calibration | None = None
        self._shown_answer: Answer | None = None
        self._has_cloud = False
        self._options = (True, True, True, True)

    def _axes(self, root: str, length_m: float) -> None:
        ends = length_m * np.stack([np.zeros((3, 3)), np.eye(3)], axis=1)
        self._lines(f"{root}/axes", ends, np.repeat(_AXES_RGB[:, None], 2, axis=1), 4.0)

    def _lines(self, name: str, points: NDArray[Any], colors: Any, thickness: float) -> None:
        """Draw or redraw segments; none are moved out of sight, because empty ones are refused."""
        if not len(points):
            points, colors = np.full((1, 2, 3), 1e4), palette.PAPER
        self._scene.add_line_segments(
            name, np.asarray(points, np.float32), colors, thickness=thickness, thickness_units="screen"
        )

    def update(
        self, snapshot: LidarSnapshot, name: str, files: PairFiles, options: tuple[bool, bool, bool, bool]
    ) -> None:
        """Show the pair. options: whole cloud, board points, normals, ellipsoid."""
        detection, result = snapshot.detection, snapshot.result
        if detection is None or result is None:
            return
        T = result.T_camera_lidar if snapshot.trial is None else snapshot.trial.T_camera_lidar
        self._lidar.wxyz, self._lidar.position = vtf.SO3.from_matrix(T[:3, :3]).wxyz, T[:3, 3]
        pair = snapshot.wish.pair
        changed = result is not self._shown_result or pair != self._shown_pair or options != self._options
        if changed:
            self._show_boards(snapshot, options)
            self._show_ellipsoid(snapshot, options[3])
        if snapshot.answer is not self._shown_answer:
            self._show_next(snapshot)
        if self._shown_cloud != name:
            self._show_frustum(snapshot, files)
            cloud = np.zeros((0, 3)) if files.cloud is None else evenly(files.cloud, MOST_CLOUD_POINTS)
            if len(cloud):
                self._cloud.colors = np.zeros((1, 3), np.uint8)
                self._cloud.points = cloud.astype(np.float32)
                self._cloud.colors = distance_colors(cloud)
            self._has_cloud = bool(len(cloud))
        self._cloud.visible = options[0] and self._has_cloud
        self._shown_pair, self._shown_result, self._shown_cloud = pair, result, name
        self._options, self._shown_answer = options, snapshot.answer

    def _show_boards(self, snapshot: LidarSnapshot, options: tuple[bool, bool, bool, bool]) -> None:
        detection, result = snapshot.detection, snapshot.result
        assert detection is not None and result is not None, "asked for when there is a result"
        current = snapshot.wish.pair
        seen = [i for i, o in enumerate(detection.observations) if o.T_camera_board is not None]
        poses = [self._pose(detection.observations[i], result.pairs[i].T_camera_board) for i in seen]
        colors = [
            palette.NOW if i == current else tuple(int(0.75 * c) for c in color_of(result.pairs[i]))
            for i in seen
        ]
        outline = detection.board.outline_board
        lines = np.repeat(np.array(colors, np.uint8).reshape(-1, 1, 3), 4, axis=0).repeat(2, axis=1)
        self._lines("/camera/boards", outlines(poses, outline), lines, 2.0)
        now = [T for i, T in zip(seen, poses, strict=True) if i == current]
        self._lines("/camera/current", outlines(now, outline), palette.NOW, 5.0)
        self._show_points(detection.observations, current, options[1])
        normals = options[2]
        self._lines("/camera/normals", _normals(detection.observations, "camera", normals), CAMERA_RGB, 3.0)
        self._lines("/lidar/normals", _normals(detection.observations, "lidar", normals), LIDAR_RGB, 3.0)
        self._show_markers(seen, poses, np.array(colors, np.uint8).reshape(-1, 3))

    @staticmethod
    def _pose(observation: PairObservation, refined: Array | None) -> Array:
        pose = observation.T_camera_board if refined is None else refined
        assert pose is not None, "only boards that the picture shows"
        return pose

    def _show_points(self, observations: tuple[PairObservation, ...], current: int, visible: bool) -> None:
        parts, colors = [np.zeros((0, 3))], [np.zeros((0, 3), np.uint8)]
        for i, o in enumerate(observations):
            points = evenly(o.points_lidar, MOST_BOARD_POINTS)
            parts.append(points)
            color = palette.NOW if i == current else LIDAR_RGB
            colors.append(np.tile(np.array(color, np.uint8), (len(points), 1)))
        points = np.concatenate(parts)
        if not len(points):
            points, colors = np.full((1, 3), 1e4), [np.zeros((1, 3), np.uint8)]
        self._scene.add_point_cloud(
            "/lidar/board_points", points.astype(np.float32), np.concatenate(colors), point_size=0.022,
            precision="float32", point_shading="flat", visible=visible,
        )  # fmt: skip

    def _show_markers(self, seen: list[int], poses: list[Array], colors: NDArray[np.uint8]) -> None:
        self._marked = seen
        if not poses:
            return
        positions = np.array([T[:3, 3] for T in poses], np.float32)
        if self._markers is not None and len(self._markers.batched_positions) != len(poses):
            self._markers.remove()
            self._markers = None
        if self._markers is not None:
            self._markers.batched_positions, self._markers.batched_colors = positions, colors
            return
        wxyzs = np.tile(np.array([1.0, 0.0, 0.0, 0.0], np.float32), (len(poses), 1))
        self._markers = self._scene.add_batched_meshes_simple(
            "/camera/markers", _OCTAHEDRON, _FACES, wxyzs, positions, batched_colors=colors,
            wireframe=True, lod="off", cast_shadow=False, receive_shadow=False,
        )  # fmt: skip

        @self._markers.on_click
        def _(event: Any) -> None:
            if event.instance_index is not None and event.instance_index < len(self._marked):
                self._chosen(event, self._marked[event.instance_index])

    def _show_ellipsoid(self, snapshot: LidarSnapshot, visible: bool) -> None:
        result = snapshot.result
        assert result is not None, "asked for when there is a result"
        covariance = result.covariance[3:, 3:]
        gain = ellipsoid_gain(covariance)
        known = visible and bool(result.iterations)
        placed = ellipsoid_segments(covariance, gain) + result.T_camera_lidar[:3, 3]
        self._lines("/sigma", placed if known else placed[:0], palette.COMPARED, 2.0)
        self._name.text = f"LiDAR · 1 σ ×{gain}" if known else "LiDAR"

    def _show_next(self, snapshot: LidarSnapshot) -> None:
        """The pose to add as a ghost: the board's outline in dashes, and a label."""
        pose = None if snapshot.answer is None else snapshot.answer.pose
        assert snapshot.detection is not None, "asked for when there is a result"
        places = [] if pose is None else [pose.T_camera_board]
        self._lines(
            "/camera/next", dashes(outlines(places, snapshot.detection.board.outline_board)), NEXT_RGB, 3.0
        )
        self._next_name.visible = pose is not None
        if pose is not None:
            self._next_name.position = tuple(pose.T_camera_board[:3, 3])

    def _show_frustum(self, snapshot: LidarSnapshot, files: PairFiles) -> None:
        assert snapshot.detection is not None, "asked for when there is a result"
        camera = snapshot.detection.camera
        image = None
        if files.picture is not None:
            height = round(360 * camera.height / camera.width)
            image = cv2.resize(files.picture, (360, height), interpolation=cv2.INTER_AREA)
            image = cv2.cvtColor(image, cv2.COLOR_GRAY2RGB)
        if self._frustum is not None:
            self._frustum.image = image
            return
        # A fisheye's picture is drawn on the pinhole that fits into the view: a sign, not a measurement.
        fov = min(2 * np.arctan2(camera.height / 2, camera.K[1, 1]), np.deg2rad(80.0))
        self._frustum = self._scene.add_camera_frustum(
            "/camera/frustum", fov=float(fov), aspect=camera.width / camera.height, scale=0.35,
            thickness=2.0, thickness_units="screen", color=palette.HORIZON, image=image,
        )  # fmt: skip


def _normals(observations: tuple[PairObservation, ...], sensor: str, visible: bool) -> NDArray[np.float32]:
    """(M, 2, 3) the boards' normals as one sensor has them, towards it, in its own frame."""
    if not visible:
        return np.zeros((0, 2, 3), np.float32)
    planes = [o.camera_plane if sensor == "camera" else o.lidar_plane for o in observations]
    ends = [[p.center, p.center - NORMAL_M * p.plane.normal] for p in planes if p is not None]
    return np.array(ends, dtype=np.float32).reshape(-1, 2, 3)


def look_from(snapshot: LidarSnapshot) -> tuple[Array, Array]:
    """Position and target of a first view: from behind, above and beside the sensors onto the boards."""
    centers = [np.array([0.0, 0.0, 2.0])]
    if snapshot.detection is not None:
        found = [o.camera_plane.center for o in snapshot.detection.observations if o.camera_plane is not None]
        centers = found or centers
    target = np.median(np.array(centers), axis=0)
    reach = float(np.linalg.norm(target))
    return reach * np.array([-0.4, -0.5, -0.8]), 0.42 * target
