"""Keeps the 3-D scene of a page on the moment."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereocalib_app.drive.debut import Debut
from stereocalib_app.drive.frame_views import FrameView
from stereocalib_app.drive.moment import Moment
from stereocalib_app.drive.panel import Host
from stereocalib_app.drive.scene import Scene
from stereocalib_app.drive.viewpoint import FOLLOWING, Viewpoint, overview
from stereocalib_app.widgets import canvas, palette, text
from stereocalib_core.geometry import Extrinsics

MARKERS = 120
PLAYING_M, RESTING_M = 0.10, 0.06
"""Size of a point of the cloud: while playing there are fewer of them."""


class ScenePart:
    """The camera over the road, its cloud, and the paths."""

    def __init__(self, host: Host, api: Any, name: str, debut: Debut) -> None:
        self._host, self._api, self._name, self._debut = host, api, name, debut
        self.scene: Scene | None = None
        self._view: FrameView | None = None
        if debut.over:
            self._build()
        self._shown_paths: tuple[Any, ...] = ()
        self._marked: tuple[int, ...] = ()
        self._positions: dict[str, NDArray[np.float64]] = {}

    @property
    def due(self) -> bool:
        """Whether there is a scene to be built, now."""
        return self.scene is None and self._debut.over

    def _build(self) -> Scene:
        self.scene = Scene(self._api, self._host.session.source.camera, self._name)
        return self.scene

    def update(self, moment: Moment) -> None:
        """Show the frame."""
        best, view = moment.best, moment.view
        if view is not None:
            self._view = view
        scene = self.scene
        if scene is None:
            if not self._debut.over:
                return
            scene, view = self._build(), self._view
        if view is not None:
            size_m = PLAYING_M if moment.clock.playing else RESTING_M
            scene.show_cloud(view.points, view.colors, moment.settings.cloud, size_m)
            # Three pictures a tick would slow browsers down: while playing, the frustum stays empty.
            scene.show_image(None if moment.clock.playing else view.small)
        road = None if best is None else best[0]
        scene.show_road(road, self._caption(moment))
        scene.place_car(self._T_world_road(moment, road), moment.settings.follow)
        self.show_paths(moment)

    def show_paths(self, moment: Moment) -> None:
        """Redraw the paths where they, or what is shown of them, changed."""
        if self.scene is None:
            return
        state = (
            moment.paths,
            moment.settings.paths,
            moment.settings.color_by_error,
            moment.settings.markers,
            moment.compared,
        )
        if len(self._shown_paths) == len(state) and all(
            a is b for a, b in zip(state, self._shown_paths, strict=True)
        ):
            return
        positions = {name: poses[:, :3, 3] for name, poses in moment.paths.poses.items()}
        compared = moment.compared
        if compared is not None and compared.poses is not None:
            positions["compared"] = compared.poses[:, :3, 3]
        self._positions = positions
        colors = {}
        if moment.settings.color_by_error and "autocalibrated" in moment.paths.errors:
            errors = moment.paths.errors["autocalibrated"].miss_m
            if errors is not None:
                colors["autocalibrated"] = error_colors(errors, len(positions["autocalibrated"]))
        self.scene.show_paths(positions, moment.settings.paths, colors)
        self._show_markers(self.scene, positions.get("autocalibrated"), moment.settings.markers)
        self._shown_paths = state

    def _show_markers(self, scene: Scene, positions: NDArray[np.float64] | None, visible: bool) -> None:
        """Pose markers, at most MARKERS of them; a click goes to the frame."""
        if positions is None or len(positions) == 0:
            return
        step = max(1, int(np.ceil(len(positions) / MARKERS)))
        frames = tuple(range(0, len(positions), step))
        node = scene.show_markers(positions[list(frames)], visible)
        self._marked = frames
        if node is None:
            return
        host = self._host

        @node.on_click
        def _(event: Any) -> None:
            index = event.instance_index
            if index is not None and 0 <= index < len(self._marked):
                host.run_for_client(event, lambda _client: host.playback.seek(self._marked[index]))

    def overview(self) -> Viewpoint:
        """A viewpoint with every path in sight."""
        shown = [p for p in self._positions.values() if len(p)]
        return overview(np.concatenate(shown)) if shown else FOLLOWING

    def _caption(self, moment: Moment) -> str:
        if not moment.settings.follow:
            return f"frame {moment.frame}"
        best = moment.best
        if best is None:
            return "no road measured" if moment.result is not None else "not computed yet"
        e, origin = best
        height = f"height {text.number(e.height_m, 3, ' m')}"
        return height if origin == "this pair" else f"{height} ({origin})"

    def _T_world_road(self, moment: Moment, extrinsics: Extrinsics | None) -> NDArray[np.float64]:
        poses = moment.paths.poses.get("autocalibrated")
        if poses is None or moment.frame >= len(poses) or not np.isfinite(poses[moment.frame]).all():
            return np.eye(4)
        if extrinsics is None:
            return np.asarray(poses[moment.frame])
        return np.asarray(poses[moment.frame] @ extrinsics.T_camera_road)

    def close(self) -> None:
        """Remove the nodes."""
        if self.scene is not None:
            self.scene.close()


def error_colors(errors: NDArray[np.float64], count: int) -> NDArray[np.uint8]:
    """(count, 3) colours by error; frames without a truth are grey."""
    values = np.full(count, np.nan)
    values[: min(count, len(errors))] = errors[:count]
    top = float(np.nanmax(values)) if np.isfinite(values).any() else 1.0
    return canvas.colorize(values[None], 0.0, max(top, 1e-6), canvas.ERRORS, palette.INK_SOFT)[0]
