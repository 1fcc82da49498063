"""The picture: one stage of the method large, to zoom and pan, and the others small below it."""

from __future__ import annotations

from stereocalib_app.drive.moment import Moment
from stereocalib_app.drive.panel import Host
from stereocalib_app.drive.settings import LAYOUTS
from stereocalib_app.widgets.style import style_sheet

EXPLAIN = {
    "left image": "The left image. Orange stands upright, blue is free, green agrees with the fitted road; yellow is "
    "the horizon, white the road in metres.",
    "disparity": "How far each pixel moves between the two images. Near is bright; dark has no match.",
    "u-disparity": "Each column counts how often a disparity occurs. What stands upright keeps one disparity "
    "over many rows and piles up (orange, rejected); the road spreads evenly (blue, accepted).",
    "free map": "What is left after the upright things are taken out. Green agrees with the fitted road.",
    "v-disparity": "Each row counts how often a disparity occurs in the free map. A flat road is a straight "
    "line (yellow, with its σ): its slope gives the height, where it meets disparity 0 the pitch. Green cells agree "
    "with it, blue ones are free but do not, orange ones were rejected as upright.",
    "left − right": "The left image minus the right one, warped over the road plane. Where height, pitch and roll are "
    "right, the road is an even grey; red and blue stripes show where they are not. This is what the direct alignment "
    "makes small.",
    "LiDAR": "The LiDAR's points in the left image, coloured by their height over the road that the stereo pair "
    "measured: dark at 0.3 m below it, yellow from 2 m above. On the road all should be one colour.",
}


class ViewsPanel:
    """Docked left."""

    def __init__(self, host: Host) -> None:
        gui = host.gui
        self.panel = host.add_panel()
        with self.panel.add_tab("Views"):
            gui.add_html("<stereocalib-picture></stereocalib-picture>")
            self._layout = gui.add_dropdown(
                "Show", LAYOUTS, initial_value=LAYOUTS[0], hint="Which stage is large."
            )
            self._explain = gui.add_markdown(EXPLAIN[LAYOUTS[0]])
            gui.add_html(style_sheet())
        host.on_input(self._layout, lambda value: host.change(layout=value))

    def update(self, moment: Moment) -> None:
        """Say which stage is large."""
        if moment.settings_changed:
            self._layout.value = moment.settings.layout
            self._explain.content = EXPLAIN[moment.settings.layout]
