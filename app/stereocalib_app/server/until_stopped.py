"""Says where a page is served, and waits for Ctrl-C."""

from __future__ import annotations

import sys
import time

import viser

from stereocalib_app.server.security import LOCAL_NAMES


def say_address(server: viser.ViserServer, host: str, token: str | None = None) -> None:
    """Print the page's address, and a warning where other machines reach it."""
    shown = "127.0.0.1" if host in ("0.0.0.0", "::", *LOCAL_NAMES) else host
    if host not in LOCAL_NAMES:
        sys.stderr.write(
            f"stereocalib: warning: the page listens on {host}: "
            + ("whoever has its whole address" if token else "whoever reaches this machine")
            + " can see and steer it, and open what lies below the folder it was started in\n"
        )
    sys.stdout.write(f"http://{shown}:{server.get_port()}{f'/?token={token}' if token else ''}\n")
    sys.stdout.flush()


def until_stopped() -> None:
    """Wait for Ctrl-C: ends by KeyboardInterrupt only."""
    while True:
        # Short naps: a Ctrl-C just before a long one would only be seen at its end.
        time.sleep(0.2)
