"""Which parts the page has, in the order of their tabs: a new one is a file and a line here."""

from __future__ import annotations

from typing import Final

from stereocalib_app.drive.panel import PanelMaker
from stereocalib_app.drive.panels.corrections import CorrectionsPanel
from stereocalib_app.drive.panels.debug import DebugPanel
from stereocalib_app.drive.panels.errors import ErrorsPanel
from stereocalib_app.drive.panels.exports import ExportPanel
from stereocalib_app.drive.panels.inspect import InspectPanel
from stereocalib_app.drive.panels.lidar import LidarPanel
from stereocalib_app.drive.panels.opener import OpenPanel
from stereocalib_app.drive.panels.pair import PairPanel
from stereocalib_app.drive.panels.path import PathPanel
from stereocalib_app.drive.panels.playback import PlaybackPanel
from stereocalib_app.drive.panels.teach import TeachPanel
from stereocalib_app.drive.panels.timeline import TimelinePanel

Table = tuple[tuple[str, PanelMaker], ...]

GUIDES: Final[Table] = (
    ("Inspect", InspectPanel),
    ("Teach", TeachPanel),
    ("Debug", DebugPanel),
)
"""Folders of the tab Guide: one for each preset, of which one is on show."""

TABS: Final[Table] = (
    ("Correct", CorrectionsPanel),
    ("Paths", PathPanel),
    ("Export", ExportPanel),
    ("Open", OpenPanel),
)
"""Tabs of the main panel, after the guide."""

PLOTS: Final[Table] = (
    ("Time line", TimelinePanel),
    ("Path errors", ErrorsPanel),
    ("LiDAR", LidarPanel),
    ("Pair", PairPanel),
    ("Playback", PlaybackPanel),
)
"""Tabs of the panel below the 3-D view."""
