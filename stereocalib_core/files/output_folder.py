"""The `--out` folder: new or empty unless told otherwise; bad input leaves nothing in it."""

from __future__ import annotations

import contextlib
import fcntl
import os
import platform
import shutil
from collections.abc import Iterator
from pathlib import Path

from stereocalib_core.errors import OutputError, StereoCalibError

RUNNING = ".running"
"""In the folder while a process works there; names it."""


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
        self.make()
        return self.clear()

    @contextlib.contextmanager
    def alone(self) -> Iterator[None]:
        """Make the folder and keep it for this process; raises OutputError where another one works in it."""
        self.make()
        path = self.path / RUNNING
        try:
            file = self._lock(path)
        except OSError as error:
            remedy = error.strerror or "check its rights"
            raise OutputError("output folder cannot be kept", self.path, remedy) from error
        try:
            yield
        finally:
            path.unlink(missing_ok=True)
            os.close(file)

    def _lock(self, path: Path) -> int:
        while True:
            file = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                who = os.read(file, 200).decode(errors="replace").strip() or "it"
                os.close(file)
                self._occupied = True  # what is in it is not ours to undo
                remedy = f"wait for the end of {who}, or stop it"
                raise OutputError("another run works there", self.path, remedy) from None
            with contextlib.suppress(FileNotFoundError):
                if os.fstat(file).st_ino == path.stat().st_ino:
                    os.truncate(file, 0)
                    os.write(file, f"process {os.getpid()} on {platform.node()}\n".encode())
                    return file
            os.close(file)  # the one before has just left, and taken the file with it

    def make(self) -> None:
        """Make the folder and its parents."""
        missing = [p for p in (self.path, *self.path.parents) if not p.exists()]
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            self._made = missing or self._made
        except OSError as error:
            remedy = error.strerror or "check its rights"
            raise OutputError("output folder cannot be made", self.path, remedy) from error

    def clear(self) -> Path:
        """With `overwrite`, remove what an earlier run wrote."""
        try:
            if self._overwrite:
                self._remove_owned()
        except OSError as error:
            remedy = error.strerror or "check its rights"
            raise OutputError("output folder cannot be emptied", self.path, remedy) from error
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
