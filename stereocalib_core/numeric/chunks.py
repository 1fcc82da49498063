"""Compiled loops over pairs on every core: each worker writes its own rows, so the result never varies."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from stereocalib_core.numeric.spill import let_go, spilled
from stereocalib_core.numeric.threads import cores, shared_pool

CHUNKS_PER_CORE = 4
"""Enough to even out slow stretches of a drive."""

MOST_AT_ONCE = 200
"""Pairs of a chunk, where arrays lie on the disk and only what is worked on is to be in memory."""

_WORTHWHILE = 64
"""Fewer pairs than this take less time than handing them out."""


def in_chunks(work: Callable[..., None], count: int, *arguments: Any) -> None:
    """Call `work(first, last, *arguments)` until 0 ... count is covered; it must release the GIL to gain by it."""
    workers, on_disk = cores(), spilled(arguments)
    if count < _WORTHWHILE or (workers == 1 and not on_disk):
        work(0, count, *arguments)
        return
    chunks = workers * CHUNKS_PER_CORE
    if on_disk:
        chunks = max(chunks, -(-count // MOST_AT_ONCE))
    edges = [count * k // chunks for k in range(chunks + 1)]

    def part(first: int, last: int) -> None:
        work(first, last, *arguments)
        let_go(*on_disk)

    for _ in shared_pool("odometry", workers).map(part, edges[:-1], edges[1:]):
        pass
