"""The pictures: the left image with the road on it, and the stages of the method."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from app.moment import Moment
from app.render import WIDTH_PX
from app.settings import LAYOUTS

if TYPE_CHECKING:
    from app.page import Page

EXPLAIN = {
    "all stages": "Every stage of one stereo pair, from matching to the free map.",
    "disparity": "How far each pixel moves between the two images. Near is bright; dark has no match.",
    "u-disparity": "Each column counts how often a disparity occurs. What stands upright keeps one disparity "
    "over many rows and piles up (orange); the road spreads evenly (blue).",
    "free map": "What is left after the upright things are taken out. Green agrees with the fitted road.",
    "v-disparity": "Each row counts how often a disparity occurs in the free map. A flat road is a straight "
    "line: its slope gives the height, where it meets disparity 0 the pitch.",
}


def set_jpeg(handle: Any, data: bytes) -> None:
    """Hand encoded bytes to a viser image, so that one encoding serves every browser."""
    handle._format = "jpeg"
    handle._data = data


class ViewsPanel:
    """Docked left."""

    def __init__(self, page: Page) -> None:
        gui = page.gui
        self.panel = page.add_panel()
        blank = np.full((8, WIDTH_PX, 3), 24, np.uint8)
        with self.panel.add_tab("Views"):
            self._left = gui.add_image(blank, format="jpeg")
            self._stages = gui.add_image(blank, format="jpeg")
            self._layout = gui.add_dropdown(
                "Show", LAYOUTS, initial_value="all stages", hint="One stage large, or all of them."
            )
            self._explain = gui.add_markdown(EXPLAIN["all stages"])
        page.on_input(self._layout, lambda value: page.change(layout=value))

    def update(self, moment: Moment) -> None:
        """Show the frame's pictures."""
        if moment.settings_changed:
            self._layout.value = moment.settings.layout
            self._explain.content = EXPLAIN[moment.settings.layout]
        if moment.view is not None:
            set_jpeg(self._left, moment.view.left_jpeg)
            set_jpeg(self._stages, moment.view.stages_jpeg)
