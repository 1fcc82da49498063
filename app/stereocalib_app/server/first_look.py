"""A server whose page browsers can load before anything of a drive is on it.

A browser takes a second or two to build viser's page, and we take as long to load all that computes a drive: so the
server comes first, and both go on side by side. What a browser knows only from its first moment on is said here: the
look of the page, and where its camera begins.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from stereocalib_app.drive.viewpoint import FOLLOWING, UP
from stereocalib_app.server.docking import MAIN_WIDTH_PX
from stereocalib_app.server.security import LocalServer, create_server
from stereocalib_app.server.site import Site
from stereocalib_app.widgets.page_base import set_theme


@dataclass(frozen=True)
class Begun:
    """A server that runs, with the pages of ours beside viser's. note: what its page says until a drive is on it."""

    server: LocalServer
    site: Site
    note: Any


def begin(host: str, port: int, token: str | None = None) -> Begun:
    """Start one; a busy port becomes the next free one. token: what browsers must bring. Raises ConfigError."""
    site = Site(line=True)
    server = create_server(host, port, token, site)
    first_look(server)
    return Begun(server, site, server.gui.add_markdown("Opening the drive …"))


def first_look(server: LocalServer) -> None:
    """The look of the page of a drive, and where its browsers look from."""
    set_theme(server.gui)
    server.initial_camera.position = FOLLOWING.position
    server.initial_camera.look_at = FOLLOWING.look_at
    server.initial_camera.up = UP
    server.scene.set_up_direction("-y")
    server.scene.configure_default_lights(cast_shadow=False)
    server.gui.main_panel.dock_right()
    server.gui.main_panel.set_width(MAIN_WIDTH_PX)
