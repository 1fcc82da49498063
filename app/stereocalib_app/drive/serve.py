"""Opens a drive in the browser: `serve` runs until Ctrl-C."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from stereocalib_app.drive.drive_parts import Limits
from stereocalib_app.drive.settings import Settings
from stereocalib_app.server.library import Library, open_drive
from stereocalib_core.config import PipelineConfig

if TYPE_CHECKING:
    from stereocalib_app.server.hub import Hub


@dataclass(frozen=True)
class Opening:
    """How a drive is opened.

    frames: zero-based, half open, None = from the first, to the last. rig: rig.yaml of an earlier drive.
    limits: what the mount is judged by, tolerance: the file that they are from. settings, frame: what the page
    shows first; without a frame a synthetic drive plays. root: the folder below which the page may open other
    drives (default: where the command was started). token: what browsers must bring in the address.
    """

    frames: tuple[int | None, int | None] = (None, None)
    rig: Path | None = None
    limits: Limits = field(default_factory=dict)
    tolerance: Path | None = None
    settings: Settings = field(default_factory=Settings)
    frame: int | None = None
    root: Path | None = None
    token: str | None = None
    config: PipelineConfig = field(default_factory=PipelineConfig)


def start(spec: str, host: str = "127.0.0.1", port: int = 8080, opening: Opening | None = None) -> Hub:
    """Start the page and return at once; `hub.server.get_port()` says where."""
    how = opening or Opening()
    session = open_drive(spec, how.config, how.frames, how.rig, how.limits)
    # the first frames are under way while the page is loaded and built
    session.start()
    from stereocalib_app.server.hub import Hub
    from stereocalib_app.server.security import create_server
    from stereocalib_app.server.site import Site

    site = Site()
    server = create_server(host, port, how.token, site)
    library = Library(how.root or Path.cwd(), how.config, how.limits, how.tolerance)
    hub = Hub(server, session, library, how.settings)
    site.talker = hub.desk.links.talk
    site.contents["thumb"] = hub.desk.thumb
    if how.frame is not None:
        hub.shared.playback.seek(how.frame)
    hub.start()
    if spec.startswith("synthetic") and how.frame is None:
        hub.shared.playback.play()
    return hub


def serve(spec: str, host: str = "127.0.0.1", port: int = 8080, opening: Opening | None = None) -> None:
    """Show a drive in the browser until Ctrl-C (raises KeyboardInterrupt). Prints the page's address when ready."""
    hub = start(spec, host, port, opening)
    from stereocalib_app.server.security import stop_server
    from stereocalib_app.server.until_stopped import until_stopped

    try:
        until_stopped(hub.server, host, None if opening is None else opening.token)
    finally:
        # Whoever presses Ctrl-C does not wait for the frame in work.
        hub.close(timeout_s=0.2)
        stop_server(hub.server)
