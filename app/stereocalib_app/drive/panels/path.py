"""The paths: which are shown, what they are coloured by, and how far each ends from the truth."""

from __future__ import annotations

from functools import partial
from types import MappingProxyType
from typing import Any

from stereocalib_app.drive.moment import Moment
from stereocalib_app.drive.panel import Host
from stereocalib_app.drive.summary import error_scale, path_table
from stereocalib_app.widgets import palette


class PathPanel:
    """A tab of the main panel."""

    def __init__(self, host: Host) -> None:
        self._host = host
        gui = host.gui
        truth = host.session.source.ground_truth
        names = [
            n
            for n in palette.VARIANT
            if n != "ground_truth" or (truth is not None and truth.poses is not None)
        ]
        self._shown: dict[str, Any] = {}
        self._table = gui.add_html("")
        self._follow = gui.add_checkbox(
            "Follow the car", True, hint="Keep the car in view; off shows the whole drive from above."
        )
        self._cloud = gui.add_checkbox("Point cloud", True, hint="The coloured points of this pair.")
        self._markers = gui.add_checkbox(
            "Pose markers", False, hint="A click on a marker goes to its frame. Slow without a graphics card."
        )
        self._error = gui.add_checkbox(
            "Colour by error", False, hint="Colours the autocalibrated path by its distance from the truth."
        )
        self._scale = gui.add_html("")
        host.on_input(self._follow, host.set_follow)
        host.on_input(self._cloud, lambda value: host.change(cloud=value))
        host.on_input(self._markers, lambda value: host.change(markers=value))
        host.on_input(self._error, lambda value: host.change(color_by_error=value))
        with gui.add_folder("Paths on show"):
            for name in names:
                self._shown[name] = gui.add_checkbox(
                    palette.VARIANT_NAME[name], True, hint="Show or hide this path."
                )
                host.on_input(self._shown[name], partial(self._show, name))

    def _show(self, name: str, value: bool) -> None:
        self._host.change(paths=MappingProxyType({**self._host.settings.paths, name: value}))

    def update(self, moment: Moment) -> None:
        """Show what is set, and the table."""
        if moment.settings_changed:
            self._follow.value, self._cloud.value = moment.settings.follow, moment.settings.cloud
            self._markers.value = moment.settings.markers
            self._error.value = moment.settings.color_by_error
            for name, handle in self._shown.items():
                handle.value = moment.settings.paths.get(name, True)
        if moment.drive_changed or moment.settings_changed:
            self._table.content = path_table(moment.paths, moment.settings.corrections.model)
            self._scale.content = error_scale(moment.paths) if moment.settings.color_by_error else ""
