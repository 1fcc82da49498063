"""Opens a folder of chessboard poses in the browser: `serve` runs until Ctrl-C."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

from stereocalib_app.boards.page import LidarPage
from stereocalib_app.boards.session import LidarSession
from stereocalib_app.boards.watch import has_pairs, wait_for_pairs
from stereocalib_app.server.security import LocalServer, create_server, stop_server
from stereocalib_app.server.until_stopped import say_address, until_stopped


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


def start(
    folder: Path, host: str = "127.0.0.1", port: int = 8080, token: str | None = None, watch: bool = False
) -> LidarView:
    """Start the page and return at once; `server.get_port()` says where. Raises for a folder that is none.

    With `watch`, pairs that are put into the folder while the page is open are taken in.
    """
    session = LidarSession(folder, watch=watch)
    server = create_server(host, port, token)
    page = LidarPage(server, session)
    session.start()
    return LidarView(server, session, page)


def serve(
    folder: Path, host: str = "127.0.0.1", port: int = 8080, token: str | None = None, watch: bool = False
) -> None:
    """Show a folder in the browser until Ctrl-C. Prints the page's address when it is ready.

    With `watch`, a folder without pairs is waited for.
    """
    if watch and not has_pairs(folder):
        sys.stdout.write(f"waiting for the first picture or cloud in {folder} (Ctrl-C ends it)\n")
        sys.stdout.flush()
        wait_for_pairs(folder)
    view = start(folder, host, port, token, watch)
    try:
        say_address(view.server, host, token)
        until_stopped()
    finally:
        view.close()
