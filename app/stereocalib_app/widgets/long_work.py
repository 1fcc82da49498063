"""What takes a while says how far it is and how long it will still take, in the browser that asked for it."""

from __future__ import annotations

import time
from typing import Any

from stereocalib_app.widgets import text

FIRST_S, EVERY_S = 0.7, 0.5
"""Nothing is said of what is done sooner; after that so often."""


class LongWork:
    """A note with a share and the time left, there while the work goes on. `with LongWork(client, "Recording"): ...`"""

    def __init__(self, client: Any, title: str, clock: Any = time.monotonic) -> None:
        self._client, self._title, self._clock = client, title, clock
        self._began = self._told = clock()
        self._note: Any = None

    def __enter__(self) -> LongWork:
        return self

    def __exit__(self, *_: object) -> None:
        if self._note is not None:
            self._note.remove()

    def at(self, done: int, total: int) -> None:
        """So many of so many parts are done."""
        now = self._clock()
        if now - self._began < FIRST_S or (self._note is not None and now - self._told < EVERY_S):
            return
        self._told = now
        words = f"{done} of {total}"
        if done > 0:
            words += f" · {text.duration((now - self._began) * (total - done) / done)} left"
        if self._note is None:
            self._note = self._client.add_notification(
                self._title, words, loading=True, with_close_button=False
            )
        else:
            self._note.body = words
