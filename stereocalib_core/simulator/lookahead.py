"""Makes items ahead of whoever reads them, in a thread of its own."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Generic, TypeVar

T = TypeVar("T")

AHEAD = 12


class Lookahead(Generic[T]):
    """Item i of `make(i)`, made in order ahead of the last one asked for.

    Any thread may ask for any item; what is asked for comes next. At most one item is queued beyond what
    somebody waits for, so that a program which ends does not wait for more than that. An exception of `make`
    reaches who asks for the item.
    """

    def __init__(self, make: Callable[[int], T], count: int, ahead: int = AHEAD) -> None:
        self._make, self._count, self._ahead = make, count, ahead
        self._items: dict[int, Future[T]] = {}
        self._last = -1
        self._lock = threading.Lock()
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="synthetic-drive")

    def get(self, index: int) -> T:
        """Item `index`, waiting for it if it must be."""
        with self._lock:
            self._last = index
            item = self._items.get(index)
            if item is None:
                item = self._items[index] = self._pool.submit(self._make, index)
            kept = range(index - 1, index + self._ahead + 1)
            for key in [k for k, f in self._items.items() if k not in kept and f.done()]:
                del self._items[key]
        result = item.result()
        self._advance(item)
        return result

    def _advance(self, _: Future[T]) -> None:
        """Queue the next item that is missing, unless one is under way."""
        with self._lock:
            if any(not f.done() for f in self._items.values()):
                return
            for index in range(self._last + 1, min(self._last + 1 + self._ahead, self._count)):
                if index not in self._items:
                    try:
                        item = self._items[index] = self._pool.submit(self._make, index)
                    except RuntimeError:  # the interpreter is shutting down
                        return
                    break
            else:
                return
        item.add_done_callback(self._advance)
