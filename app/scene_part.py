"""Keeps the 3-D scene of a page on the moment."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from app import text
from app.moment import Moment
from app.scene import Scene
from stereocalib_core.geometry import Extrinsics

if TYPE_CHECKING:
    from app.page import Page


class ScenePart:
    """The camera over the road, its cloud, and the paths."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self.scene = Scene(page.api, page.session.source.camera, page.name)

    def update(self, moment: Moment) -> None:
        """Show the frame."""
        best = moment.best
        if moment.view is not None:
            self.scene.show_cloud(moment.view.points, moment.view.colors)
            picture = None if moment.clock.playing else self._page.small_picture(moment.frame)
            self.scene.show_image(picture)
        self.scene.show_road(None if best is None else best[0], self._caption(moment))
        self.scene.place_car(
            self._T_world_road(moment, None if best is None else best[0]), moment.settings.follow
        )

    def _caption(self, moment: Moment) -> str:
        best = moment.best
        if best is None:
            return "no road measured" if moment.result is not None else "not computed yet"
        e, origin = best
        numbers = (
            f"h {text.number(e.height_m, 3, ' m')}  pitch {text.number(e.pitch_deg, 2, '°')}  "
            f"roll {text.number(e.roll_deg, 2, '°')}"
        )
        return numbers if origin == "this pair" else f"{numbers}  ({origin})"

    def _T_world_road(self, moment: Moment, extrinsics: Extrinsics | None) -> np.ndarray:
        analysis = moment.snapshot.analysis
        poses = None if analysis is None else analysis.poses
        if poses is None or moment.frame >= len(poses):
            return np.eye(4)
        if extrinsics is None:
            return np.asarray(poses[moment.frame])
        return np.asarray(poses[moment.frame] @ extrinsics.T_camera_road)

    def close(self) -> None:
        """Remove the nodes."""
        self.scene.close()
