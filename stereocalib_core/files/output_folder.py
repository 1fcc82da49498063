"""The `--out` folder: new or empty unless told otherwise; bad input leaves nothing in it."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Iterator
from pathlib import Path

from stereocalib_core.errors import OutputError, StereoCalibError


class OutputFolder:
    """Checks a folder now, makes it later, and can undo its making.

    owned: glob patterns of what a command writes there; `overwrite` removes these and nothing else.
    """

    def __init__(
        self, path: Path, owned: tuple[str, ...], overwrite: bool = False, resume: bool = False
    ) -> None:
        self.path = path
        self._owned = owned
        self._overwrite = overwrite
        self._made: list[Path] = []
        try:
            if path.exists() and not path.is_dir():
                raise OutputError("output is a file", path, "name a folder")
            self._occupied = path.is_dir() and any(path.iterdir())
        except (OSError, ValueError) as error:
            raise OutputError("output cannot be read", path, str(error)) from error
        if self._occupied and not (overwrite or resume):
            raise OutputError(
                "output folder is not empty", path, "name a new one, or add --overwrite or --resume"
            )

    def create(self) -> Path:
        """Make the folder and its parents; with `overwrite`, remove what an earlier run wrote."""
        missing = [p for p in (self.path, *self.path.parents) if not p.exists()]
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            self._made = missing
            if self._overwrite:
                self._remove_owned()
        except OSError as error:
            remedy = error.strerror or "check its rights"
            raise OutputError("output folder cannot be made", self.path, remedy) from error
        return self.path

    def undo(self) -> None:
        """Remove what a command wrote, and the folders that `create` made if they are empty by then."""
        with contextlib.suppress(OSError):
            if not self._occupied:
                self._remove_owned()
            for folder in self._made:
                folder.rmdir()

    def _remove_owned(self) -> None:
        for pattern in self._owned:
            for path in sorted(self.path.glob(pattern)):
                if path.is_dir() and not path.is_symlink():
                    shutil.rmtree(path)
                else:
                    path.unlink(missing_ok=True)


@contextlib.contextmanager
def new_output(path: Path, owned: tuple[str, ...], overwrite: bool = False) -> Iterator[Path]:
    """The folder for the duration of a command; bad input inside undoes its making."""
    folder = OutputFolder(path, owned, overwrite)
    try:
        yield folder.create()
    except StereoCalibError:
        folder.undo()
        raise
