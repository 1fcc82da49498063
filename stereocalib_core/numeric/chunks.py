"""Compiled loops over pairs on every core: each worker writes its own rows, so the result never varies."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

from stereocalib_core.numeric.threads import shared_pool

CHUNKS_PER_CORE = 4
"""Enough to even out slow stretches of a drive."""

_WORTHWHILE = 64
"""Fewer pairs than this take less time than handing them out."""


def in_chunks(work: Callable[..., None], count: int, *arguments: Any) -> None:
    """Call `work(first, last, *arguments)` until 0 ... count is covered; it must release the GIL to gain by it."""
    cores = os.cpu_count() or 1
    if count < _WORTHWHILE or cores == 1:
        work(0, count, *arguments)
        return
    edges = [count * k // (cores * CHUNKS_PER_CORE) for k in range(cores * CHUNKS_PER_CORE + 1)]
    pool = shared_pool("odometry", cores)
    for _ in pool.map(lambda *part: work(*part, *arguments), edges[:-1], edges[1:]):
        pass
