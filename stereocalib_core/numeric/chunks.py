"""Compiled loops over pairs on every core: each worker writes its own rows, so the result never varies."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from stereocalib_core.numeric.threads import cores, shared_pool

CHUNKS_PER_CORE = 4
"""Enough to even out slow stretches of a drive."""

_WORTHWHILE = 64
"""Fewer pairs than this take less time than handing them out."""


def in_chunks(work: Callable[..., None], count: int, *arguments: Any) -> None:
    """Call `work(first, last, *arguments)` until 0 ... count is covered; it must release the GIL to gain by it."""
    workers = cores()
    if count < _WORTHWHILE or workers == 1:
        work(0, count, *arguments)
        return
    edges = [count * k // (workers * CHUNKS_PER_CORE) for k in range(workers * CHUNKS_PER_CORE + 1)]
    pool = shared_pool("odometry", workers)
    for _ in pool.map(lambda *part: work(*part, *arguments), edges[:-1], edges[1:]):
        pass
