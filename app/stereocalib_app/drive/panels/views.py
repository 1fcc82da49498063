"""The picture: the left image with the road on it, and the stages of the method below."""

from __future__ import annotations

from stereocalib_app.drive.moment import Moment
from stereocalib_app.drive.panel import Host
from stereocalib_app.drive.render import WIDTH_PX
from stereocalib_app.drive.settings import LAYOUTS
from stereocalib_app.widgets.picture import PictureView
from stereocalib_app.widgets.style import style_sheet

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


class ViewsPanel:
    """Docked left."""

    def __init__(self, host: Host) -> None:
        gui = host.gui
        self.panel = host.add_panel()
        with self.panel.add_tab("Views"):
            self._picture = PictureView(gui, WIDTH_PX)
            self._layout = gui.add_dropdown(
                "Show", LAYOUTS, initial_value="all stages", hint="One stage large, or all of them."
            )
            self._explain = gui.add_markdown(EXPLAIN["all stages"])
            gui.add_html(style_sheet())
        host.on_input(self._layout, lambda value: host.change(layout=value))

    def update(self, moment: Moment) -> None:
        """Show the frame's pictures."""
        if moment.settings_changed:
            self._layout.value = moment.settings.layout
            self._explain.content = EXPLAIN[moment.settings.layout]
        if moment.view is not None:
            self._picture.show(moment.view.jpeg)
