"""How far the opening of a recording is: told by whatever unpacks it, heard by whoever shows it."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from contextvars import ContextVar

Listener = Callable[[int, int], None]
_LISTENER: ContextVar[Listener | None] = ContextVar("opening", default=None)


@contextlib.contextmanager
def told_to(listener: Listener) -> Iterator[None]:
    """While it lasts, what this thread opens is told to `listener(done, total)`, in units of the work's own."""
    token = _LISTENER.set(listener)
    try:
        yield
    finally:
        _LISTENER.reset(token)


def tell(done: int, total: int) -> None:
    """So many of so many parts are done; nothing happens where nobody listens."""
    listener = _LISTENER.get()
    if listener is not None:
        listener(done, total)
