"""What was found in files that have not changed since: a folder that grows is searched again, its old pairs are not."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from pathlib import Path
from typing import TypeVar, cast

Found = TypeVar("Found")


class Memo:
    """Results by what they were made from. Kept in memory only, as long as the session that grows lives."""

    def __init__(self) -> None:
        self._kept: dict[Hashable, object] = {}

    def recall(self, key: Hashable, look: Callable[[], Found]) -> Found:
        """The result of `look()` under this key, looked up or made."""
        if key not in self._kept:
            self._kept[key] = look()
        return cast(Found, self._kept[key])


def state_of(path: Path | None) -> tuple[str, int, int]:
    """Name, size [bytes] and time of change [ns] of a file; nothing of one that is not there."""
    try:
        if path is not None:
            seen = path.stat()
            return str(path), seen.st_size, seen.st_mtime_ns
    except OSError:
        pass
    return "", 0, 0
