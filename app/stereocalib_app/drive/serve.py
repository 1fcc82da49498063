"""Opens a drive in the browser: `serve` runs until Ctrl-C."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from stereocalib_app.drive.settings import Settings
from stereocalib_app.server.first_look import Begun, begin

if TYPE_CHECKING:
    from stereocalib_app.server.hub import Hub
    from stereocalib_core.config import PipelineConfig
    from stereocalib_core.results import Tolerance


def _default_config() -> PipelineConfig:
    from stereocalib_core.config import PipelineConfig

    return PipelineConfig()


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
    limits: Mapping[str, Tolerance] = field(default_factory=dict)
    tolerance: Path | None = None
    settings: Settings = field(default_factory=Settings)
    frame: int | None = None
    root: Path | None = None
    token: str | None = None
    config: PipelineConfig = field(default_factory=_default_config)


def start(
    spec: str,
    host: str = "127.0.0.1",
    port: int = 8080,
    opening: Opening | None = None,
    begun: Begun | None = None,
) -> Hub:
    """Start the page and return at once; `hub.server.get_port()` says where.

    begun: the server that shall show it, where there is one already; host, port and token are those of that one. A
    browser may wait there for the page, whose pictures come first then.
    """
    how = opening or Opening()
    from stereocalib_app.server.library import Library, open_drive

    session = open_drive(spec, how.config, how.frames, how.rig, how.limits)
    from stereocalib_app.drive.debut import Debut
    from stereocalib_app.server.hub import Hub

    debut = Debut(over=begun is None)
    session.held = debut.enough
    begun = begun or begin(host, port, how.token)
    library = Library(how.root or Path.cwd(), how.config, how.limits, how.tolerance)
    hub = Hub(begun.server, session, library, how.settings, debut)
    begun.note.remove()
    begun.site.contents["thumb"] = hub.desk.thumb
    if how.frame is not None:
        hub.shared.playback.seek(how.frame)
    hub.start()
    begun.site.open_line(hub.desk.links.talk)
    if spec.startswith("synthetic") and how.frame is None:
        hub.shared.playback.play()
    return hub


def serve(spec: str, host: str = "127.0.0.1", port: int = 8080, opening: Opening | None = None) -> None:
    """Show a drive in the browser until Ctrl-C (raises KeyboardInterrupt).

    Prints the page's address as soon as the drive is sure to be opened: of a rendered one, or of an earlier run, at
    once, so that a browser builds the empty page while all that computes and shows a drive is loaded.
    """
    from stereocalib_app.server import until_stopped
    from stereocalib_app.server.security import stop_server

    token = None if opening is None else opening.token
    begun = begin(host, port, token)
    hub = None
    try:
        sure = _sure_to_open(spec)
        if sure:
            until_stopped.say_address(begun.server, host, token)
        hub = start(spec, host, port, opening, begun)
        if not sure:
            until_stopped.say_address(begun.server, host, token)
        until_stopped.until_stopped()
    finally:
        # Whoever presses Ctrl-C does not wait for the frame in work.
        if hub is not None:
            hub.close(timeout_s=0.2)
        stop_server(begun.server)


def _sure_to_open(spec: str) -> bool:
    """Whether a drive is there for sure before it is opened. Raises ConfigError for a rendered one that is not
    understood, SourceError for what is no drive at all."""
    from stereocalib_core.simulator.settings import parse_spec
    from stereocalib_core.sources import SourceKind, source_kind

    kind = source_kind(spec)
    if kind is SourceKind.SYNTHETIC:
        parse_spec(spec)
    return kind in (SourceKind.SYNTHETIC, SourceKind.RUN)
