"""Opens a folder of chessboard poses in the browser: `serve` runs until Ctrl-C."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from stereocalib_app.boards.page import LidarPage
from stereocalib_app.boards.session import LidarSession
from stereocalib_app.server.security import LocalServer, create_server, stop_server
from stereocalib_app.server.until_stopped import until_stopped


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


def start(folder: Path, host: str = "127.0.0.1", port: int = 8080, token: str | None = None) -> LidarView:
    """Start the page and return at once; `server.get_port()` says where. Raises for a folder that is none."""
    session = LidarSession(folder)
    server = create_server(host, port, token)
    page = LidarPage(server, session)
    session.start()
    return LidarView(server, session, page)


def serve(folder: Path, host: str = "127.0.0.1", port: int = 8080, token: str | None = None) -> None:
    """Show a folder in the browser until Ctrl-C. Prints the page's address when it is ready."""
    view = start(folder, host, port, token)
    try:
        until_stopped(view.server, host, token)
    finally:
        view.close()
