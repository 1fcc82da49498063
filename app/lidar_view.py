"""Opens a folder of chessboard poses in the browser: `serve` runs until Ctrl-C."""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from pathlib import Path

from app.lidar_page import LidarPage
from app.lidar_session import LidarSession
from app.secure import LOCAL_NAMES, LocalServer, create_server, stop_server


@dataclass(frozen=True)
class LidarView:
    """A page that is running."""

    server: LocalServer
    session: LidarSession
    page: LidarPage

    def close(self) -> None:
        """Stop the worker and the server."""
        self.session.close()
        stop_server(self.server)


def start(folder: Path, host: str = "127.0.0.1", port: int = 8080) -> LidarView:
    """Start the page and return at once; `server.get_port()` says where. Raises for a folder that is none."""
    session = LidarSession(folder)
    server = create_server(host, port)
    page = LidarPage(server, session)
    session.start()
    return LidarView(server, session, page)


def serve(folder: Path, host: str = "127.0.0.1", port: int = 8080) -> None:
    """Show a folder in the browser until Ctrl-C. Prints the page's address when it is ready."""
    view = start(folder, host, port)
    shown = "127.0.0.1" if host in ("0.0.0.0", "::", *LOCAL_NAMES) else host
    if host not in LOCAL_NAMES:
        sys.stderr.write(
            f"stereocalib: warning: the page listens on {host}: whoever reaches this machine can see and "
            "steer it\n"
        )
    sys.stdout.write(f"http://{shown}:{view.server.get_port()}\n")
    sys.stdout.flush()
    try:
        while True:
            # Short naps: a Ctrl-C just before a long one would only be seen at its end.
            time.sleep(0.2)
    finally:
        view.close()
