"""Whether a folder of boards has grown: looked at now and then, and believed when it has come to rest."""

from __future__ import annotations

import time
from pathlib import Path

from stereocalib_core.boards import state_of

LOOK_EVERY_S = 1.0
"""A person puts the next board up in some ten seconds; a file that has grown a second later is still being written."""
WATCHED = ("images", "clouds", "camera.yaml", "board.yaml")
State = tuple[tuple[str, int, int], ...]


def state_of_folder(path: Path) -> State:
    """Names, sizes and times of everything that a result hangs on."""
    files: list[Path] = []
    for name in WATCHED:
        part = path / name
        files += sorted(part.iterdir()) if part.is_dir() else [part]
    return tuple(state_of(file) for file in files if not file.name.startswith("."))


class FolderWatch:
    """Remembers what was seen last; one look costs a stat of every file."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._taken = self._last = state_of_folder(path)

    def settled(self) -> bool:
        """Whether something is new since this last said so, and looked the same at the look before."""
        now = state_of_folder(self._path)
        rests, self._last = now == self._last, now
        if not rests or now == self._taken:
            return False
        self._taken = now
        return True


def has_pairs(path: Path) -> bool:
    """Whether there is anything yet in the folders of pictures and clouds."""
    return any(
        file.is_file() and not file.name.startswith(".")
        for name in ("images", "clouds")
        for file in ((path / name).iterdir() if (path / name).is_dir() else ())
    )


def wait_for_pairs(path: Path, every_s: float = LOOK_EVERY_S) -> None:
    """Return when the first file has come to rest in a folder that has its two subfolders."""
    while (path / "images").is_dir() and (path / "clouds").is_dir():
        before = state_of_folder(path)
        if has_pairs(path):
            time.sleep(every_s)
            if state_of_folder(path) == before:
                return
        else:
            time.sleep(every_s)
