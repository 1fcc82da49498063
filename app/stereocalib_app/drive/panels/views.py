"""The picture: the left image with the road on it, and the stages of the method below."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from stereocalib_app.drive.moment import Moment
from stereocalib_app.drive.render import WIDTH_PX
from stereocalib_app.drive.settings import LAYOUTS
from stereocalib_app.widgets.style import style_sheet

if TYPE_CHECKING:
    from stereocalib_app.drive.page import Page

EXPLAIN = {
    "all stages": "One stereo pair, stage by stage. Orange stands upright, blue is free, green agrees with the "
    "fitted road; the yellow line is the road's profile.",
    "disparity": "How far each pixel moves between the two images. Near is bright; dark has no match.",
    "u-disparity": "Each column counts how often a disparity occurs. What stands upright keeps one disparity "
    "over many rows and piles up (orange, rejected); the road spreads evenly (blue, accepted).",
    "free map": "What is left after the upright things are taken out. Green agrees with the fitted road.",
    "v-disparity": "Each row counts how often a disparity occurs in the free map. A flat road is a straight "
    "line (yellow, with its σ): its slope gives the height, where it meets disparity 0 the pitch. Green cells agree "
    "with it, blue ones are free but do not, orange ones were rejected as upright.",
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
            self._picture = gui.add_image(blank, format="jpeg")
            self._layout = gui.add_dropdown(
                "Show", LAYOUTS, initial_value="all stages", hint="One stage large, or all of them."
            )
            self._explain = gui.add_markdown(EXPLAIN["all stages"])
            gui.add_html(style_sheet())
        page.on_input(self._layout, lambda value: page.change(layout=value))

    def update(self, moment: Moment) -> None:
        """Show the frame's pictures."""
        if moment.settings_changed:
            self._layout.value = moment.settings.layout
            self._explain.content = EXPLAIN[moment.settings.layout]
        if moment.view is not None:
            set_jpeg(self._picture, moment.view.jpeg)
