"""The panel below the 3-D view: time line, plots, playback."""

from __future__ import annotations

from stereocalib_app.drive.moment import Moment
from stereocalib_app.drive.panel import Host, Panel
from stereocalib_app.drive.panels.table import PLOTS


class PlotsPanel:
    """Floats at the bottom of the 3-D view."""

    def __init__(self, host: Host) -> None:
        self.panel = host.add_panel()
        self.parts: dict[str, Panel] = {}
        for name, build in PLOTS:
            with self.panel.add_tab(name):
                self.parts[name] = build(host)

    def update(self, moment: Moment) -> None:
        """Show a moment in every tab."""
        for part in self.parts.values():
            part.update(moment)
