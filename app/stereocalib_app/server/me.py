"""Which browser a page is in: an element of viser's own page that names it, with a key that nobody can guess."""

from __future__ import annotations

import html
import secrets
from typing import Any


class Names:
    """Gives every browser a key, and knows it again by it."""

    def __init__(self) -> None:
        self._keys: dict[int, str] = {}

    def name(self, client: Any) -> None:
        """Tell a browser who it is."""
        key = self._keys[client.client_id] = secrets.token_urlsafe(16)
        client.gui.add_html(me_html(client.client_id, key), order=1e7)

    def knows(self, number: int, key: str) -> bool:
        """Whether that is the key of that browser."""
        return secrets.compare_digest(self._keys.get(number, "\0").encode(), key.encode())

    def forget(self, number: int) -> None:
        """A browser has gone."""
        self._keys.pop(number, None)


def me_html(number: int, key: str) -> str:
    """The element, which shows nothing."""
    return f'<stereocalib-me data-client="{number}" data-key="{html.escape(key)}"></stereocalib-me>'
