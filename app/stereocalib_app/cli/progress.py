"""Progress of long work on a terminal; silence in a pipe."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator

from stereocalib_core.system import opening

Progress = Callable[[int, int, str], None]


@contextlib.contextmanager
def terminal_progress() -> Iterator[Progress | None]:
    """A callback (done, total, what) that draws a bar on stderr, None where stderr is no terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Bars

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Bars(*columns, console=Console(stderr=True), transient=True) as bars:
        task = bars.add_task("opening", total=None)

        def show(done: int, total: int, what: str) -> None:
            bars.update(task, completed=done, total=total, description=what)

        with opening.told_to(lambda done, total: show(done, total, "opening")):
            yield show
