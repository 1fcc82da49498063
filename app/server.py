"""Opens a drive in the browser: `serve` runs until Ctrl-C."""

from __future__ import annotations

import sys
import time
from pathlib import Path

from app.hub import Hub
from app.library import Library, open_drive
from app.secure import LOCAL_NAMES, create_server, stop_server
from stereocalib_core.config import PipelineConfig


def start(
    spec: str,
    host: str = "127.0.0.1",
    port: int = 8080,
    config: PipelineConfig | None = None,
    autoplay: bool = False,
    frames: slice | None = None,
    rig: Path | None = None,
    root: Path | None = None,
) -> Hub:
    """Start the page and return at once; `hub.server.get_port()` says where.

    root: the folder below which the page may open other drives (default: where the command was started).
    """
    config = config or PipelineConfig()
    wanted = (None, None) if frames is None else (frames.start, frames.stop)
    session = open_drive(spec, config, wanted, rig)
    server = create_server(host, port)
    hub = Hub(server, session, Library(root or Path.cwd(), config))
    hub.start()
    if autoplay or spec.startswith("synthetic"):
        hub.shared.playback.play()
    return hub


def serve(
    spec: str,
    host: str = "127.0.0.1",
    port: int = 8080,
    config: PipelineConfig | None = None,
    autoplay: bool = False,
    frames: slice | None = None,
    rig: Path | None = None,
    root: Path | None = None,
) -> None:
    """Show a drive in the browser until Ctrl-C (raises KeyboardInterrupt). Prints the page's address when ready."""
    hub = start(spec, host, port, config, autoplay, frames, rig, root)
    shown = "127.0.0.1" if host in ("0.0.0.0", "::", *LOCAL_NAMES) else host
    if host not in LOCAL_NAMES:
        sys.stderr.write(
            f"stereocalib: warning: the page listens on {host}: whoever reaches this machine can see and "
            "steer it\n"
        )
    sys.stdout.write(f"http://{shown}:{hub.server.get_port()}\n")
    sys.stdout.flush()
    try:
        while True:
            # Short naps: a Ctrl-C just before a long one would only be seen at its end.
            time.sleep(0.2)
    finally:
        # Whoever presses Ctrl-C does not wait for the frame in work.
        hub.close(timeout_s=0.2)
        stop_server(hub.server)
